// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <numbers>

#include "framework/domain/generators.h"
#include "framework/domain/mesh.h"

namespace variform::testing {

/// A planar mesh lifted to space: vertex (x, y) goes to lift(x, y).
template <class Lift>
Mesh lifted(const Mesh& flat, const Lift& lift) {
  Mesh mesh{Matrix(flat.vertex_count(), 3), flat.cells};
  for (Index v = 0; v < flat.vertex_count(); ++v) {
    mesh.positions.row(v) = lift(flat.positions(v, 0), flat.positions(v, 1));
  }
  return mesh;
}

/// The unit square with a Gaussian bump: curved, with boundary.
inline Mesh bump_mesh(double h, double height = 0.4) {
  return lifted(rectangle_mesh({.h = h, .jitter = 0.3}), [&](double x, double y) {
    const double r2 = (x - 0.4) * (x - 0.4) + (y - 0.6) * (y - 0.6);
    return Eigen::RowVector3d(x, y, height * std::exp(-6.0 * r2));
  });
}

/// Half a cylinder of length 1 about the x axis, inscribed: each column of quads along the axis is flat, so the mesh
/// can be unrolled exactly, to [0, 1] x [0, 2 n sin(pi / (2 n)) / pi] for n columns. The image is in `flat`.
inline Mesh half_cylinder_mesh(double h, Matrix* flat = nullptr) {
  const Mesh plane = rectangle_mesh({.h = h});  // a grid of squares, diagonals by coin flip
  const double columns = std::round(1.0 / h);
  const double radius = 1.0 / std::numbers::pi;
  if (flat != nullptr) {
    *flat = plane.positions;
    flat->col(1) *= columns * 2.0 * radius * std::sin(0.5 * std::numbers::pi / columns);
  }
  return lifted(plane, [&](double x, double y) {
    const double angle = std::numbers::pi * (1.0 - y);
    return Eigen::RowVector3d(x, radius * std::cos(angle), radius * std::sin(angle));
  });
}

/// A cap of the unit sphere by inverse stereographic projection of a disk of the given radius: conformal.
inline Mesh stereographic_cap_mesh(double radius, double h) {
  return lifted(disk_mesh(radius, h), [&](double x, double y) {
    const double s = 1.0 + x * x + y * y;
    return Eigen::RowVector3d(2.0 * x / s, 2.0 * y / s, 2.0 / s - 1.0);
  });
}

}  // namespace variform::testing
