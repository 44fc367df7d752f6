// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/quality.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace variform {
namespace {

using Eigen::Vector3d;

constexpr double kDegrees = 180.0 / std::numbers::pi;

/// Measures of one cell; the arrays have 3 entries for a triangle and 6 for a tetrahedron.
struct CellQuality {
  int size;
  std::array<double, 6> angles;  // in radians
  std::array<double, 6> edges;
  double radius_ratio;
  double mean_ratio;
};

/// Angle from u to v, well defined also where it is close to 0 or pi.
double angle_between(const Vector3d& u, const Vector3d& v) { return std::atan2(u.cross(v).norm(), u.dot(v)); }

CellQuality triangle_quality(const std::array<Vector3d, 4>& x, double area) {
  CellQuality quality{.size = 3, .angles = {}, .edges = {}, .radius_ratio = 0.0, .mean_ratio = 0.0};
  double perimeter = 0.0;
  double product = 1.0;
  double squares = 0.0;
  for (int i = 0; i < 3; ++i) {
    const Vector3d u = x[(i + 1) % 3] - x[i];
    const Vector3d v = x[(i + 2) % 3] - x[i];
    quality.angles[i] = angle_between(u, v);
    quality.edges[i] = u.norm();
    perimeter += u.norm();
    product *= u.norm();
    squares += u.squaredNorm();
  }
  const double circumradius = product / (4.0 * area);
  const double inradius = 2.0 * area / perimeter;
  quality.radius_ratio = circumradius / inradius;
  quality.mean_ratio = 4.0 * std::numbers::sqrt3 * area / squares;
  return quality;
}

CellQuality tetrahedron_quality(const std::array<Vector3d, 4>& x, double volume) {
  // Each edge, followed by the other two corners.
  static constexpr int kEdges[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2},
                                       {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};
  CellQuality quality{.size = 6, .angles = {}, .edges = {}, .radius_ratio = 0.0, .mean_ratio = 0.0};
  double squares = 0.0;
  for (int i = 0; i < 6; ++i) {
    const auto& [a, b, c, d] = kEdges[i];
    const Vector3d edge = x[b] - x[a];
    quality.angles[i] = angle_between(edge.cross(x[c] - x[a]), edge.cross(x[d] - x[a]));
    quality.edges[i] = edge.norm();
    squares += edge.squaredNorm();
  }
  const Vector3d u = x[1] - x[0];
  const Vector3d v = x[2] - x[0];
  const Vector3d w = x[3] - x[0];
  const double surface =
      0.5 * (u.cross(v).norm() + v.cross(w).norm() + w.cross(u).norm() + (v - u).cross(w - u).norm());
  const Vector3d to_center = u.squaredNorm() * v.cross(w) + v.squaredNorm() * w.cross(u) + w.squaredNorm() * u.cross(v);
  const double circumradius = to_center.norm() / (12.0 * volume);
  const double inradius = 3.0 * volume / surface;
  quality.radius_ratio = circumradius / inradius;
  quality.mean_ratio = 12.0 * std::cbrt(9.0 * volume * volume) / squares;
  return quality;
}

CellQuality cell_quality(const Domain& domain, Index t) {
  std::array<Vector3d, 4> corners;
  for (int i = 0; i < domain.cell_size(); ++i) {
    corners[i].setZero();
    corners[i].head(domain.ambient_dimension()) = domain.positions().row(domain.cells()(t, i)).transpose();
  }
  const double measure = domain.cell_measures()(t);
  return domain.intrinsic_dimension() == 2 ? triangle_quality(corners, measure) : tetrahedron_quality(corners, measure);
}

}  // namespace

MeshQuality mesh_quality(const Domain& domain) {
  MeshQuality result;
  if (domain.cell_count() == 0) return result;
  result.min_measure = domain.cell_measures().minCoeff();
  result.max_measure = domain.cell_measures().maxCoeff();
  result.measure_ratio = result.max_measure / result.min_measure;
  result.min_angle = result.min_edge = result.min_mean_ratio = std::numeric_limits<double>::infinity();
  double edge_sum = 0.0;
  double edge_count = 0.0;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const CellQuality cell = cell_quality(domain, t);
    for (int i = 0; i < cell.size; ++i) {
      result.min_angle = std::min(result.min_angle, kDegrees * cell.angles[i]);
      result.max_angle = std::max(result.max_angle, kDegrees * cell.angles[i]);
      result.min_edge = std::min(result.min_edge, cell.edges[i]);
      result.max_edge = std::max(result.max_edge, cell.edges[i]);
      edge_sum += cell.edges[i];
    }
    edge_count += cell.size;
    result.max_radius_ratio = std::max(result.max_radius_ratio, cell.radius_ratio);
    result.min_mean_ratio = std::min(result.min_mean_ratio, cell.mean_ratio);
  }
  result.mean_edge = edge_sum / edge_count;
  return result;
}

Vector radius_ratios(const Domain& domain) {
  Vector ratios(domain.cell_count());
  for (Index t = 0; t < domain.cell_count(); ++t) ratios(t) = cell_quality(domain, t).radius_ratio;
  return ratios;
}

}  // namespace variform
