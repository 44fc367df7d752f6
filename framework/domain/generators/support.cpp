// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/generators/support.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "framework/base/error.h"

namespace variform::generators {

void require_positive(std::string_view option, double value) {
  if (!(value > 0.0) || !std::isfinite(value)) {
    throw UsageError(fmt::format("'{}' = {}: expected a positive number", option, value));
  }
}

void require_range(std::string_view option, double value, double min, double max) {
  if (!(value >= min && value <= max)) {
    throw UsageError(fmt::format("'{}' = {}: expected a value in [{}, {}]", option, value, min, max));
  }
}

void require_h(double h, double extent) {
  require_positive("h", h);
  if (h > extent) {
    throw UsageError(fmt::format("'h' = {}: expected at most {}, the size of the shape", h, extent));
  }
}

void require_cell_count(std::string_view option, double value, double cells) {
  if (!(cells <= kMaxCells)) {
    throw UsageError(
        fmt::format("'{}' = {}: this makes {:.3g} cells; expected at most {:.0f}", option, value, cells, kMaxCells));
  }
}

double steps(double length, double h) { return std::max(1.0, std::round(length / h)); }

double signed_area(const Matrix& positions, Index a, Index b, Index c) {
  const double ux = positions(b, 0) - positions(a, 0);
  const double uy = positions(b, 1) - positions(a, 1);
  const double vx = positions(c, 0) - positions(a, 0);
  const double vy = positions(c, 1) - positions(a, 1);
  return 0.5 * (ux * vy - uy * vx);
}

Vector signed_areas(const Mesh& mesh) {
  Vector areas(mesh.cell_count());
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    areas(t) = signed_area(mesh.positions, mesh.cells(t, 0), mesh.cells(t, 1), mesh.cells(t, 2));
  }
  return areas;
}

double signed_measure(const Mesh& mesh, Index cell) {
  const auto corners = mesh.cells.row(cell);
  if (corners.size() == 3) return signed_area(mesh.positions, corners(0), corners(1), corners(2));
  const Eigen::RowVector3d a = mesh.positions.row(corners(0));
  const Eigen::RowVector3d b = mesh.positions.row(corners(1)) - a;
  const Eigen::RowVector3d c = mesh.positions.row(corners(2)) - a;
  const Eigen::RowVector3d d = mesh.positions.row(corners(3)) - a;
  return b.cross(c).dot(d) / 6.0;
}

VertexCells::VertexCells(const Mesh& mesh)
    : first_(static_cast<std::size_t>(mesh.vertex_count()) + 2, 0),
      cells_(static_cast<std::size_t>(mesh.cells.size())) {
  for (const Index v : mesh.cells.reshaped()) ++first_[v + 2];
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  // Filling the lists turns the start of list v, kept at v + 1, into its end.
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    for (const Index v : mesh.cells.row(t)) cells_[first_[v + 1]++] = t;
  }
}

void jitter_vertices(Mesh& mesh, const Matrix& reach, Random& random) {
  constexpr double kKeptMeasure = 0.05;  // of each cell, so that jitter never makes slivers
  constexpr int kTries = 6;
  const Eigen::Index dimension = reach.cols();
  const VertexCells around(mesh);
  Vector smallest(mesh.cell_count());
  for (Index t = 0; t < mesh.cell_count(); ++t) smallest(t) = kKeptMeasure * signed_measure(mesh, t);

  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    if ((reach.row(v).array() == 0.0).all()) continue;
    const Eigen::RowVectorXd start = mesh.positions.row(v).head(dimension);
    Eigen::RowVectorXd step(dimension);
    for (Eigen::Index d = 0; d < dimension; ++d) step(d) = random.symmetric() * reach(v, d);
    const auto allowed = [&](Index t) { return signed_measure(mesh, t) >= smallest(t); };
    for (int attempt = 0; attempt <= kTries; ++attempt, step *= 0.5) {
      if (attempt == kTries) step.setZero();
      mesh.positions.row(v).head(dimension) = start + step;
      if (std::ranges::all_of(around[v], allowed)) break;
    }
  }
}

}  // namespace variform::generators
