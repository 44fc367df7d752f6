// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/domain/generators/support.h"

namespace variform {
namespace {

using namespace generators;
using Eigen::RowVector2d;
using Eigen::RowVector3d;
using std::numbers::pi;

/// A planar mesh with every vertex where the map puts it in space.
template <class Map>
Mesh lifted(const Mesh& sheet, const Map& map) {
  Mesh mesh{Matrix(sheet.vertex_count(), 3), sheet.cells};
  for (Index v = 0; v < sheet.vertex_count(); ++v) {
    mesh.positions.row(v) = map(RowVector2d(sheet.positions.row(v)));
  }
  return mesh;
}

Mesh sheet_of(double width, double height, RectangleOptions options) {
  options.width = width;
  options.height = height;
  return rectangle_mesh(options);
}

/// The profile of a swelling, by arc length from its top: a circle, a fillet that turns back to the plane, the plane.
class Swelling {
 public:
  static constexpr double kReach = 0.22;  // radius of the disk of the sheet that swells

  /// Radius and height at a distance from the centre of that disk, at most kReach.
  std::pair<double, double> at(double distance) const {
    const double length = distance / kReach * (ball_ + fillet_ + foot_);
    if (length <= ball_) {
      const double angle = length / kBall;
      return {kBall * std::sin(angle), kHeight - kBall * (1.0 - std::cos(angle))};
    }
    if (length <= ball_ + fillet_) {
      const double angle = turn_ - (length - ball_) / kFillet;  // what is left to turn
      return {foot_radius_ - kFillet * std::sin(angle), kFillet * (1.0 - std::cos(angle))};
    }
    return {foot_radius_ + (length - ball_ - fillet_), 0.0};
  }

 private:
  static constexpr double kBall = 0.14;
  static constexpr double kHeight = 0.35;
  static constexpr double kFillet = 0.07;

  // The circles of ball and fillet touch: their centres are kBall + kFillet apart.
  double turn_ = std::acos((kFillet - (kHeight - kBall)) / (kBall + kFillet));
  double foot_radius_ = (kBall + kFillet) * std::sin(turn_);
  double ball_ = kBall * turn_;
  double fillet_ = kFillet * turn_;
  double foot_ = kReach - foot_radius_;
};

}  // namespace

Mesh bump_mesh(const BumpOptions& options) {
  require_positive("sharpness", options.sharpness);
  if (!std::isfinite(options.height)) {
    throw UsageError(fmt::format("'height' = {}: expected a finite number", options.height));
  }
  if (!options.centre.allFinite()) {
    throw UsageError(
        fmt::format("'centre' = [{}, {}]: expected finite numbers", options.centre.x(), options.centre.y()));
  }
  return lifted(rectangle_mesh(options.base), [&](const RowVector2d& p) {
    const double distance = (p - options.centre.transpose()).squaredNorm();
    return RowVector3d(p.x(), p.y(), options.height * std::exp(-options.sharpness * distance));
  });
}

Mesh half_cylinder_mesh(double radius, double length, const RectangleOptions& sheet) {
  require_positive("radius", radius);
  require_positive("length", length);
  return lifted(sheet_of(pi * radius, length, sheet), [&](const RowVector2d& p) {
    const double angle = p.x() / radius;
    return RowVector3d(-radius * std::cos(angle), p.y(), radius * std::sin(angle));
  });
}

Mesh sphere_mesh(double radius, double h) {
  require_positive("radius", radius);
  const double arc = radius * std::atan(2.0);  // of an edge of the icosahedron
  require_h(h, arc);
  const double parts = steps(arc, h);
  require_cell_count("h", h, 20.0 * parts * parts);
  const auto n = static_cast<Index>(parts);

  Mesh mesh{Matrix(10 * n * n + 2, 3), IndexMatrix(20 * n * n, 3)};
  // Two poles and two rings of five vertices, the lower ring turned by half a step.
  mesh.positions.row(0) << 0.0, 0.0, 1.0;
  mesh.positions.row(11) << 0.0, 0.0, -1.0;
  const double z = 1.0 / std::sqrt(5.0);
  std::array<std::array<Index, 3>, 20> faces{};
  for (Index k = 0; k < 5; ++k) {
    for (const Index half : {0, 1}) {
      const double angle = pi * (2 * k + half) / 5.0;
      mesh.positions.row(1 + 5 * half + k) << 2.0 * z * std::cos(angle), 2.0 * z * std::sin(angle), half == 0 ? z : -z;
    }
    const Index next = (k + 1) % 5;
    faces[4 * k] = {0, 1 + k, 1 + next};
    faces[4 * k + 1] = {1 + k, 6 + k, 1 + next};
    faces[4 * k + 2] = {6 + k, 6 + next, 1 + next};
    faces[4 * k + 3] = {11, 6 + next, 6 + k};
  }

  Index vertex_count = 12;
  const auto place = [&](const RowVector3d& point) {
    mesh.positions.row(vertex_count) = point.normalized();
    return vertex_count++;
  };
  // The first of the n - 1 vertices inside each edge of the icosahedron, in the direction of its higher end.
  std::map<std::pair<Index, Index>, Index> first_on_edge;
  const auto on_edge = [&](Index from, Index to, Index step) {
    const auto [low, high] = std::minmax(from, to);
    const auto [edge, is_new] = first_on_edge.try_emplace({low, high}, vertex_count);
    for (Index k = 1; is_new && k < n; ++k) {
      place((n - k) * mesh.positions.row(low) + k * mesh.positions.row(high));
    }
    return edge->second + (from < to ? step : n - step) - 1;
  };

  Index t = 0;
  for (const auto& [a, b, c] : faces) {
    // The vertex i steps from a to b and j steps from a to c.
    IndexMatrix grid(n + 1, n + 1);
    grid(0, 0) = a;
    grid(n, 0) = b;
    grid(0, n) = c;
    for (Index k = 1; k < n; ++k) {
      grid(k, 0) = on_edge(a, b, k);
      grid(0, k) = on_edge(a, c, k);
      grid(n - k, k) = on_edge(b, c, k);
    }
    for (Index i = 1; i < n; ++i) {
      for (Index j = 1; i + j < n; ++j) {
        grid(i, j) = place((n - i - j) * mesh.positions.row(a) + i * mesh.positions.row(b) + j * mesh.positions.row(c));
      }
    }
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; i + j < n; ++j) {
        mesh.cells.row(t++) << grid(i, j), grid(i + 1, j), grid(i, j + 1);
        if (i + j + 1 < n) mesh.cells.row(t++) << grid(i + 1, j), grid(i + 1, j + 1), grid(i, j + 1);
      }
    }
  }
  mesh.positions *= radius;
  return mesh;
}

Mesh torus_mesh(double major_radius, double minor_radius, double h) {
  require_positive("major_radius", major_radius);
  require_positive("minor_radius", minor_radius);
  if (!(minor_radius < major_radius)) {
    throw UsageError(
        fmt::format("'minor_radius' = {}: expected less than the major radius {}", minor_radius, major_radius));
  }
  require_h(h, 2.0 * (major_radius + minor_radius));
  const double sectors = std::max(3.0, steps(2.0 * pi * (major_radius + minor_radius), h));
  const double parts = std::max(3.0, steps(2.0 * pi * minor_radius, h));
  require_cell_count("h", h, 2.0 * sectors * parts);
  const auto n = static_cast<Index>(sectors);
  const auto m = static_cast<Index>(parts);

  const auto vertex = [n, m](Index i, Index j) { return i % n * m + j % m; };
  Mesh mesh{Matrix(n * m, 3), IndexMatrix(2 * n * m, 3)};
  for (Index i = 0, t = 0; i < n; ++i) {
    const double around = 2.0 * pi * i / sectors;
    for (Index j = 0; j < m; ++j, t += 2) {
      const double across = 2.0 * pi * j / parts;
      const double r = major_radius + minor_radius * std::cos(across);
      mesh.positions.row(vertex(i, j)) << r * std::cos(around), r * std::sin(around), minor_radius * std::sin(across);
      mesh.cells.row(t) << vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1);
      mesh.cells.row(t + 1) << vertex(i, j), vertex(i + 1, j + 1), vertex(i, j + 1);
    }
  }
  return mesh;
}

Mesh three_balls_mesh(const RectangleOptions& sheet) {
  require_positive("h", sheet.h);
  require_range("h", sheet.h, 0.0, 0.1);
  const std::array<RowVector2d, 3> centres = {RowVector2d(0.27, 0.27), RowVector2d(0.73, 0.27), RowVector2d(0.5, 0.73)};
  const Swelling swelling;
  return lifted(sheet_of(1.0, 1.0, sheet), [&](const RowVector2d& p) {
    for (const RowVector2d& centre : centres) {
      const RowVector2d arm = p - centre;
      const double distance = arm.norm();
      if (distance >= Swelling::kReach) continue;
      const auto [radius, height] = swelling.at(distance);
      const RowVector2d moved = centre + radius * arm.stableNormalized();  // zero at the centre itself
      return RowVector3d(moved.x(), moved.y(), height);
    }
    return RowVector3d(p.x(), p.y(), 0.0);
  });
}

Mesh hood_mesh(const RectangleOptions& sheet) {
  constexpr double kHalfWidth = 0.6;
  return lifted(sheet_of(2.0 * kHalfWidth, 1.0, sheet), [](const RowVector2d& p) {
    const double u = p.x() / kHalfWidth - 1.0;
    const double v = p.y();
    const auto profile = [](double s, double bend) { return bend * s * s + 0.12 * std::pow(s, 8); };
    return RowVector3d(kHalfWidth * u * (1.0 - 0.3 * v * v), v, 0.3 - profile(u, 0.06) - profile(v, 0.08));
  });
}

}  // namespace variform
