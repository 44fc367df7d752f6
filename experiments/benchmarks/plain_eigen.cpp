// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/benchmarks/plain_eigen.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>

namespace variform::benchmarks::plain {
namespace {

using Triplet = Eigen::Triplet<double, Index>;

SparseMatrix from_triplets(Eigen::Index rows, Eigen::Index columns, const std::vector<Triplet>& triplets) {
  SparseMatrix result(rows, columns);
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

// Calls visit(cell, local vertex, gradient of its hat function, normal) for all corners; returns the areas.
template <class Visit>
Vector for_each_corner(const Mesh& mesh, const Visit& visit) {
  Vector areas(mesh.cell_count());
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    const auto x = [&](int i) -> Eigen::Vector3d { return mesh.positions.row(mesh.cells(t, i % 3)).transpose(); };
    const Eigen::Vector3d cross = (x(1) - x(0)).cross(x(2) - x(0));
    const double doubled = cross.norm();
    const Eigen::Vector3d n = cross / doubled;
    areas[t] = 0.5 * doubled;
    for (int i = 0; i < 3; ++i) visit(t, i, Eigen::Vector3d(n.cross(x(i + 2) - x(i + 1)) / doubled), n);
  }
  return areas;
}

}  // namespace

Gradients gradients(const Mesh& mesh) {
  std::vector<Triplet> triplets;
  triplets.reserve(static_cast<std::size_t>(9 * mesh.cell_count()));
  Vector areas = for_each_corner(mesh, [&](Index t, int i, const Eigen::Vector3d& g, const Eigen::Vector3d&) {
    for (int r = 0; r < 3; ++r) triplets.emplace_back(3 * t + r, mesh.cells(t, i), g[r]);
  });
  return {from_triplets(3 * mesh.cell_count(), mesh.vertex_count(), triplets), std::move(areas)};
}

Gradients conformal_defect(const Mesh& mesh) {
  std::vector<Triplet> triplets;
  triplets.reserve(static_cast<std::size_t>(18 * mesh.cell_count()));
  Vector areas = for_each_corner(mesh, [&](Index t, int i, const Eigen::Vector3d& g, const Eigen::Vector3d& n) {
    const Eigen::Vector3d turned = n.cross(g);
    for (int r = 0; r < 3; ++r) {
      triplets.emplace_back(3 * t + r, 2 * mesh.cells(t, i), g[r]);
      triplets.emplace_back(3 * t + r, 2 * mesh.cells(t, i) + 1, turned[r]);
    }
  });
  return {from_triplets(3 * mesh.cell_count(), 2 * mesh.vertex_count(), triplets), std::move(areas)};
}

SparseMatrix norm(const Mesh& mesh, const Vector& areas, double beta, int n) {
  std::vector<Triplet> triplets;
  const auto add = [&](Index s, Index t, double weight) {
    for (int i = 0; i < n; ++i) triplets.emplace_back(s * n + i, t * n + i, weight);
  };
  for (Index t = 0; t < mesh.cell_count(); ++t) add(t, t, (1.0 - beta) * areas[t]);
  if (beta > 0.0) {
    std::vector<std::array<Index, 3>> halves;  // smaller vertex, larger vertex, cell
    for (Index t = 0; t < mesh.cell_count(); ++t) {
      for (int i = 0; i < 3; ++i) {
        const Index a = mesh.cells(t, i);
        const Index b = mesh.cells(t, (i + 1) % 3);
        halves.push_back({std::min(a, b), std::max(a, b), t});
      }
    }
    std::sort(halves.begin(), halves.end());
    for (std::size_t k = 0; k + 1 < halves.size(); ++k) {
      const auto& [a, b, left] = halves[k];
      if (halves[k + 1][0] != a || halves[k + 1][1] != b) continue;
      const Index right = halves[k + 1][2];
      const double weight = beta * (mesh.positions.row(a) - mesh.positions.row(b)).norm();
      add(left, left, weight);
      add(right, right, weight);
      add(left, right, -weight);
      add(right, left, -weight);
    }
  }
  return from_triplets(areas.size() * n, areas.size() * n, triplets);
}

Elimination elimination(const Constraints& constraints, int unknowns) {
  const Index vertices = constraints.vertex_count();
  const int columns = constraints.dimension() / unknowns;
  std::vector<bool> is_fixed(static_cast<std::size_t>(vertices), false);
  Elimination result;
  result.fixed = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(vertices) * unknowns, columns);
  for (const auto& fixed : constraints.fixed()) {
    is_fixed[fixed.vertex] = true;
    for (int i = 0; i < constraints.dimension(); ++i) {
      result.fixed(fixed.vertex * unknowns + i % unknowns, i / unknowns) = fixed.value[i];
    }
  }
  std::vector<Triplet> triplets;
  for (Index v = 0; v < vertices; ++v) {
    for (int i = 0; i < unknowns && !is_fixed[v]; ++i) {
      triplets.emplace_back(v * unknowns + i, static_cast<Index>(triplets.size()), 1.0);
    }
  }
  result.Z = from_triplets(vertices * unknowns, static_cast<Eigen::Index>(triplets.size()), triplets);
  return result;
}

}  // namespace variform::benchmarks::plain
