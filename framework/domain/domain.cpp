// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/domain.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <tuple>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/domain/check.h"

namespace variform {
namespace {

/// Local vertices of facet i of a cell, the facet opposite vertex i, oriented outwards in a positive cell.
constexpr std::array<std::array<int, 2>, 3> kTriangleFacets = {{{1, 2}, {2, 0}, {0, 1}}};
constexpr std::array<std::array<int, 3>, 4> kTetrahedronFacets = {{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

DomainKind kind_of(const Mesh& mesh) {
  if (mesh.cells.cols() == 4) return DomainKind::tetrahedral;
  return flattened(mesh).positions.cols() == 2 ? DomainKind::planar : DomainKind::surface;
}

}  // namespace

std::string to_string(DomainKind kind) {
  switch (kind) {
    case DomainKind::planar: return "planar";
    case DomainKind::surface: return "surface";
    case DomainKind::tetrahedral: return "tetrahedral";
  }
  return {};
}

Domain::Domain(const Mesh& mesh) : Domain(mesh, kind_of(mesh)) {}

Domain::Domain(const Mesh& mesh, DomainKind kind)
    : kind_(kind), m_(kind == DomainKind::tetrahedral ? 3 : 2), p_(kind == DomainKind::planar ? 2 : 3) {
  if (mesh.cells.rows() > 0 && mesh.cells.cols() != m_ + 1) {
    throw DataError(fmt::format("a {} domain needs cells of {} vertices, the mesh has {}", to_string(kind), m_ + 1,
                                mesh.cells.cols()));
  }
  if (mesh.positions.cols() < p_) {
    throw DataError(
        fmt::format("a {} domain needs {} coordinates, the mesh has {}", to_string(kind), p_, mesh.positions.cols()));
  }
  const Mesh own = kind == DomainKind::planar ? flattened(mesh) : mesh;
  if (kind == DomainKind::planar && own.positions.cols() != 2) {
    throw DataError("a planar domain needs a mesh that is flat along x, y or z");
  }
  if (const std::vector<Defect> defects = check_mesh(own); !defects.empty()) throw DataError(defects.front().message);
  positions_ = own.positions;
  cells_ = own.cells;
  build_connectivity();
  build_components();
  update_geometry();
}

void Domain::build_connectivity() {
  // A half facet is facet i of cell t, numbered t (m+1) + i.
  const int corners = m_ + 1;
  const Index half_count = cell_count() * corners;
  const auto facet_vertex = [this](Index t, int i, int k) {
    return cells_(t, m_ == 2 ? kTriangleFacets[i][k] : kTetrahedronFacets[i][k]);
  };
  const auto for_each_half = [&](const auto& visit) {
    Index half = 0;
    for (Index t = 0; t < cell_count(); ++t) {
      for (int i = 0; i < corners; ++i) visit(half++, t, i);
    }
  };
  // Half facets at their smallest vertices, few at each, by their other vertices: those of one facet are neighbours.
  struct HalfFacet {
    std::array<Index, 2> others;  // sorted; the second is -1 for edges
    Index half;

    bool operator<(const HalfFacet& b) const { return std::tie(others, half) < std::tie(b.others, b.half); }
  };
  const auto sorted_vertices = [&](Index t, int i) {
    std::array<Index, 3> v = {facet_vertex(t, i, 0), facet_vertex(t, i, 1), -1};
    if (v[0] > v[1]) std::swap(v[0], v[1]);
    if (m_ == 3) {
      v[2] = facet_vertex(t, i, 2);
      if (v[1] > v[2]) std::swap(v[1], v[2]);
      if (v[0] > v[1]) std::swap(v[0], v[1]);
    }
    return v;
  };
  std::vector<Index> offsets(static_cast<std::size_t>(vertex_count()) + 1, 0);
  for_each_half([&](Index, Index t, int i) { ++offsets[sorted_vertices(t, i)[0] + 1]; });
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  std::vector<HalfFacet> halves(static_cast<std::size_t>(half_count));
  {
    std::vector<Index> next(offsets.begin(), offsets.end() - 1);
    for_each_half([&](Index half, Index t, int i) {
      const std::array<Index, 3> v = sorted_vertices(t, i);
      halves[next[v[0]]++] = {{v[1], v[2]}, half};
    });
  }
  std::vector<Index> twins(static_cast<std::size_t>(half_count), -1);
  parallel_for(vertex_count(), [&](Index v) {
    const auto begin = halves.begin() + offsets[v];
    const auto end = halves.begin() + offsets[v + 1];
    std::sort(begin, end);
    for (auto it = begin; it != end; ++it) {
      if (it + 1 == end || it->others != (it + 1)->others) continue;
      twins[it->half] = (it + 1)->half;
      twins[(it + 1)->half] = it->half;
      ++it;
    }
  });

  // Facets in the order of their left cells: neighbours in memory are neighbours in space.
  const auto boundary_count = static_cast<Index>(std::count(twins.begin(), twins.end(), -1));
  facet_cells_.resize((half_count - boundary_count) / 2, 2);
  facet_vertices_.resize(facet_cells_.rows(), m_);
  boundary_facets_.resize(boundary_count, m_);
  boundary_cells_.resize(boundary_count);
  boundary_vertices_.assign(vertex_count(), false);
  Index facet = 0;
  Index boundary = 0;
  for_each_half([&](Index half, Index t, int i) {
    if (twins[half] > half) {
      facet_cells_(facet, 0) = t;
      facet_cells_(facet, 1) = twins[half] / corners;
      for (int k = 0; k < m_; ++k) facet_vertices_(facet, k) = facet_vertex(t, i, k);
      ++facet;
    } else if (twins[half] < 0) {
      boundary_cells_[boundary] = t;
      for (int k = 0; k < m_; ++k) {
        boundary_facets_(boundary, k) = facet_vertex(t, i, k);
        boundary_vertices_[boundary_facets_(boundary, k)] = true;
      }
      ++boundary;
    }
  });
}

void Domain::build_components() {
  std::vector<Index> parent(cell_count());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&parent](Index t) {
    while (parent[t] != t) t = parent[t] = parent[parent[t]];
    return t;
  };
  for (Index f = 0; f < facet_count(); ++f) {
    const Index a = root(facet_cells_(f, 0));
    const Index b = root(facet_cells_(f, 1));
    parent[std::max(a, b)] = std::min(a, b);
  }
  cell_components_.resize(cell_count());
  component_count_ = 0;
  for (Index t = 0; t < cell_count(); ++t) {
    const Index r = root(t);
    cell_components_[t] = r == t ? component_count_++ : cell_components_[r];
  }
}

void Domain::set_positions(const Matrix& positions) {
  if (positions.rows() != positions_.rows() || positions.cols() != positions_.cols()) {
    throw UsageError(fmt::format("set_positions: expected {} x {} coordinates, got {} x {}", positions_.rows(),
                                 positions_.cols(), positions.rows(), positions.cols()));
  }
  previous_positions_ = positions_;
  positions_ = positions;
  try {
    update_geometry();
  } catch (const DataError&) {
    positions_.swap(previous_positions_);
    update_geometry();
    throw;
  }
}

void Domain::update_geometry() {
  const Index cells = cell_count();
  const int corners = m_ + 1;
  using Point = Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, 3>;
  const Point low = positions_.colwise().minCoeff();
  const Point high = positions_.colwise().maxCoeff();
  diameter_ = (high - low).norm();
  cell_measures_.resize(cells);
  gradients_.resize(static_cast<std::size_t>(cells) * p_ * corners);
  if (kind_ == DomainKind::surface) normals_.resize(cells, 3);
  parallel_for(cells, [&](Index t) {
    Eigen::Map<Eigen::MatrixXd> G(gradients_.data() + static_cast<std::size_t>(t) * p_ * corners, p_, corners);
    const auto x = [&](int i) { return positions_.row(cells_(t, i)); };
    if (m_ == 2 && p_ == 2) {
      const Eigen::Vector2d a = (x(1) - x(0)).transpose();
      const Eigen::Vector2d b = (x(2) - x(0)).transpose();
      const double doubled = a[0] * b[1] - a[1] * b[0];
      cell_measures_[t] = 0.5 * doubled;
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector2d e = (x((i + 2) % 3) - x((i + 1) % 3)).transpose();
        G.col(i) << -e[1] / doubled, e[0] / doubled;
      }
    } else if (m_ == 2) {
      const Eigen::Vector3d a = (x(1) - x(0)).transpose();
      const Eigen::Vector3d b = (x(2) - x(0)).transpose();
      const Eigen::Vector3d cross = a.cross(b);
      const double doubled = cross.norm();
      const Eigen::Vector3d n = cross / doubled;
      cell_measures_[t] = 0.5 * doubled;
      normals_.row(t) = n.transpose();
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d e = (x((i + 2) % 3) - x((i + 1) % 3)).transpose();
        G.col(i) = n.cross(e) / doubled;
      }
    } else {
      const Eigen::Vector3d e1 = (x(1) - x(0)).transpose();
      const Eigen::Vector3d e2 = (x(2) - x(0)).transpose();
      const Eigen::Vector3d e3 = (x(3) - x(0)).transpose();
      const double sixfold = e1.dot(e2.cross(e3));
      cell_measures_[t] = sixfold / 6.0;
      G.col(1) = e2.cross(e3) / sixfold;
      G.col(2) = e3.cross(e1) / sixfold;
      G.col(3) = e1.cross(e2) / sixfold;
      G.col(0) = -(G.col(1) + G.col(2) + G.col(3));
    }
  });
  for (Index t = 0; t < cells; ++t) {
    if (!(cell_measures_[t] > 0.0) || !std::isfinite(cell_measures_[t])) {
      throw DataError(fmt::format("cell {} degenerates: its measure is {:.3g}", t, cell_measures_[t]));
    }
  }
  total_measure_ = parallel_sum(cells, [&](Index t) { return cell_measures_[t]; });
  facet_measures_.resize(facet_count());
  parallel_for(facet_count(), [&](Index f) {
    const auto x = [&](int i) { return positions_.row(facet_vertices_(f, i)); };
    if (m_ == 2) {
      facet_measures_[f] = (x(1) - x(0)).norm();
    } else {
      const Eigen::Vector3d a = (x(1) - x(0)).transpose();
      const Eigen::Vector3d b = (x(2) - x(0)).transpose();
      facet_measures_[f] = 0.5 * a.cross(b).norm();
    }
  });
}

}  // namespace variform
