// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/domain.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

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

double Domain::diameter() const { return (positions_.colwise().maxCoeff() - positions_.colwise().minCoeff()).norm(); }

void Domain::build_connectivity() {
  struct HalfFacet {
    std::array<Index, 3> key;  // sorted vertices; unused entries are -1
    Index cell;
    int local;
  };
  const auto facet_vertex = [this](const HalfFacet& half, int k) {
    return cells_(half.cell, m_ == 2 ? kTriangleFacets[half.local][k] : kTetrahedronFacets[half.local][k]);
  };
  std::vector<HalfFacet> halves;
  halves.reserve(static_cast<std::size_t>(cell_count()) * (m_ + 1));
  for (Index t = 0; t < cell_count(); ++t) {
    for (int i = 0; i <= m_; ++i) {
      HalfFacet half{{-1, -1, -1}, t, i};
      for (int k = 0; k < m_; ++k) half.key[k] = facet_vertex(half, k);
      std::sort(half.key.begin(), half.key.begin() + m_);
      halves.push_back(half);
    }
  }
  std::vector<Index> order(halves.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](Index a, Index b) { return halves[a].key != halves[b].key ? halves[a].key < halves[b].key : a < b; });
  std::vector<Index> left;
  std::vector<Index> right;
  std::vector<Index> boundary;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i + 1 < order.size() && halves[order[i]].key == halves[order[i + 1]].key) {
      left.push_back(order[i]);
      right.push_back(order[i + 1]);
      ++i;
    } else {
      boundary.push_back(order[i]);
    }
  }
  // Facets in the order of their left cells: neighbours in memory are neighbours in space.
  std::vector<Index> by_left(left.size());
  std::iota(by_left.begin(), by_left.end(), 0);
  std::sort(by_left.begin(), by_left.end(), [&](Index a, Index b) { return left[a] < left[b]; });
  facet_cells_.resize(static_cast<Index>(left.size()), 2);
  facet_vertices_.resize(facet_cells_.rows(), m_);
  for (Index f = 0; f < facet_cells_.rows(); ++f) {
    const HalfFacet& half = halves[left[by_left[f]]];
    facet_cells_(f, 0) = half.cell;
    facet_cells_(f, 1) = halves[right[by_left[f]]].cell;
    for (int k = 0; k < m_; ++k) facet_vertices_(f, k) = facet_vertex(half, k);
  }
  std::sort(boundary.begin(), boundary.end());
  boundary_facets_.resize(static_cast<Index>(boundary.size()), m_);
  boundary_cells_.resize(boundary_facets_.rows());
  boundary_vertices_.assign(vertex_count(), false);
  for (Index f = 0; f < boundary_facets_.rows(); ++f) {
    boundary_cells_[f] = halves[boundary[f]].cell;
    for (int k = 0; k < m_; ++k) {
      boundary_facets_(f, k) = facet_vertex(halves[boundary[f]], k);
      boundary_vertices_[boundary_facets_(f, k)] = true;
    }
  }
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
