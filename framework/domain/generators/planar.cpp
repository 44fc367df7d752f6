// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/domain/generators/support.h"

namespace variform {
namespace {

using namespace generators;

/// Coordinates of count + 1 grid lines over [0, length]; gaps grow by the ratio from one to the next.
Vector grid_lines(double length, Index count, double ratio) {
  Vector lines(count + 1);
  double sum = 0.0;
  double gap = 1.0;
  for (Index i = 0; i <= count; ++i, gap *= ratio) {
    lines(i) = sum;
    sum += gap;
  }
  lines *= length / lines(count);
  lines(count) = length;
  return lines;
}

/// The smaller of the gaps at each interior line, 0 at the two ends.
Vector gaps_at(const Vector& lines) {
  Vector gaps = Vector::Zero(lines.size());
  for (Index i = 1; i + 1 < lines.size(); ++i) {
    gaps(i) = std::min(lines(i) - lines(i - 1), lines(i + 1) - lines(i));
  }
  return gaps;
}

void require_grading(double grading, double count) {
  constexpr double kMaxSpread = 1e5;  // of the sides; keeps areas far above what counts as degenerate
  require_range("grading", grading, 1.0, 10.0);
  if (count > 1.0 && std::pow(grading, count - 1.0) > kMaxSpread) {
    throw UsageError(fmt::format("'grading' = {}: expected at most {:.4g} for {:.0f} cells in a row", grading,
                                 std::pow(kMaxSpread, 1.0 / (count - 1.0)), count));
  }
}

}  // namespace

Mesh rectangle_mesh(const RectangleOptions& options) {
  require_positive("width", options.width);
  require_positive("height", options.height);
  require_h(options.h, std::max(options.width, options.height));
  require_range("jitter", options.jitter, 0.0, 0.45);
  const double columns = steps(options.width, options.h);
  const double rows = steps(options.height, options.h);
  require_cell_count("h", options.h, 2.0 * columns * rows);
  const bool graded = options.tessellation == Tessellation::graded;
  if (graded) require_grading(options.grading, std::max(columns, rows));

  const auto nx = static_cast<Index>(columns);
  const auto ny = static_cast<Index>(rows);
  const Vector x = grid_lines(options.width, nx, graded ? options.grading : 1.0);
  const Vector y = grid_lines(options.height, ny, graded ? options.grading : 1.0);
  const auto vertex = [nx](Index i, Index j) { return j * (nx + 1) + i; };

  Mesh mesh{Matrix((nx + 1) * (ny + 1), 2), IndexMatrix(2 * nx * ny, 3)};
  for (Index j = 0; j <= ny; ++j) {
    for (Index i = 0; i <= nx; ++i) mesh.positions.row(vertex(i, j)) << x(i), y(j);
  }
  Random random(options.seed);
  for (Index j = 0, t = 0; j < ny; ++j) {
    for (Index i = 0; i < nx; ++i, t += 2) {
      const Index a = vertex(i, j);
      const Index b = vertex(i + 1, j);
      const Index c = vertex(i + 1, j + 1);
      const Index d = vertex(i, j + 1);
      const bool falling = (options.tessellation == Tessellation::alternating && (i + j) % 2 == 1) ||
                           (options.tessellation == Tessellation::random && random.coin());
      if (falling) {
        mesh.cells.row(t) << a, b, d;
        mesh.cells.row(t + 1) << b, c, d;
      } else {
        mesh.cells.row(t) << a, b, c;
        mesh.cells.row(t + 1) << a, c, d;
      }
    }
  }

  if (options.jitter > 0.0) {
    const Vector gaps_x = gaps_at(x);
    const Vector gaps_y = gaps_at(y);
    Matrix reach(mesh.vertex_count(), 2);
    for (Index j = 0; j <= ny; ++j) {
      for (Index i = 0; i <= nx; ++i) {
        const bool interior = i > 0 && i < nx && j > 0 && j < ny;
        reach.row(vertex(i, j)) << (interior ? gaps_x(i) : 0.0), (interior ? gaps_y(j) : 0.0);
      }
    }
    jitter_vertices(mesh, options.jitter * reach, random);
  }
  return mesh;
}

Mesh disk_mesh(double radius, double h) {
  require_positive("radius", radius);
  require_h(h, radius);
  const double rings = steps(radius, h);
  require_cell_count("h", h, 6.0 * rings * rings);
  const auto n = static_cast<Index>(rings);

  // Ring k has 6k vertices, the first of them numbered 1 + 3k(k-1); vertex 0 is the centre.
  const auto vertex = [](Index k, Index j) { return k == 0 ? 0 : 1 + 3 * k * (k - 1) + j % (6 * k); };
  Mesh mesh{Matrix(1 + 3 * n * (n + 1), 2), IndexMatrix(6 * n * n, 3)};
  mesh.positions.row(0).setZero();
  Index t = 0;
  for (Index k = 1; k <= n; ++k) {
    const double r = k == n ? radius : radius * k / n;
    for (Index j = 0; j < 6 * k; ++j) {
      const double angle = std::numbers::pi * j / (3.0 * k);
      mesh.positions.row(vertex(k, j)) << r * std::cos(angle), r * std::sin(angle);
    }
    for (Index sextant = 0; sextant < 6; ++sextant) {
      const Index outer = sextant * k;
      const Index inner = sextant * (k - 1);
      for (Index j = 0; j < k; ++j) {
        mesh.cells.row(t++) << vertex(k - 1, inner + j), vertex(k, outer + j), vertex(k, outer + j + 1);
        if (j + 1 < k) {
          mesh.cells.row(t++) << vertex(k - 1, inner + j), vertex(k, outer + j + 1), vertex(k - 1, inner + j + 1);
        }
      }
    }
  }
  return mesh;
}

Mesh annulus_mesh(double inner_radius, double outer_radius, double h) {
  require_positive("inner_radius", inner_radius);
  require_positive("outer_radius", outer_radius);
  if (!(inner_radius < outer_radius)) {
    throw UsageError(
        fmt::format("'inner_radius' = {}: expected less than the outer radius {}", inner_radius, outer_radius));
  }
  require_h(h, outer_radius - inner_radius);
  // Every other ring is turned by half a step and rings are as far apart as rows of equilateral triangles.
  const double layers = steps(outer_radius - inner_radius, 0.5 * std::numbers::sqrt3 * h);
  const double sectors = std::max(3.0, steps(std::numbers::pi * (inner_radius + outer_radius), h));
  require_cell_count("h", h, 2.0 * layers * sectors);
  const auto nr = static_cast<Index>(layers);
  const auto na = static_cast<Index>(sectors);

  const auto vertex = [na](Index k, Index j) { return k * na + j % na; };
  Mesh mesh{Matrix((nr + 1) * na, 2), IndexMatrix(2 * nr * na, 3)};
  for (Index k = 0; k <= nr; ++k) {
    const double r = k == nr ? outer_radius : inner_radius + (outer_radius - inner_radius) * k / nr;
    for (Index j = 0; j < na; ++j) {
      const double angle = 2.0 * std::numbers::pi * (j + 0.5 * (k % 2)) / na;
      mesh.positions.row(vertex(k, j)) << r * std::cos(angle), r * std::sin(angle);
    }
  }
  for (Index k = 0, t = 0; k < nr; ++k) {
    for (Index j = 0; j < na; ++j, t += 2) {
      const Index a = vertex(k, j);
      const Index b = vertex(k, j + 1);
      const Index c = vertex(k + 1, j);
      const Index d = vertex(k + 1, j + 1);
      if (k % 2 == 0) {
        mesh.cells.row(t) << a, c, b;
        mesh.cells.row(t + 1) << b, c, d;
      } else {
        mesh.cells.row(t) << a, c, d;
        mesh.cells.row(t + 1) << a, d, b;
      }
    }
  }
  return mesh;
}

}  // namespace variform
