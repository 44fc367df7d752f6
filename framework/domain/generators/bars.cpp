// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cmath>

#include "framework/domain/generators.h"
#include "framework/domain/generators/support.h"

namespace variform {
namespace {

using namespace generators;
using Counts = std::array<Index, 3>;
using GridPoint = std::array<Index, 3>;

/// Cells of a grid over a box, per direction.
struct Grid {
  std::array<double, 3> size;
  std::array<double, 3> counts;

  Grid(double length, double width, double height, double h) : size{length, width, height}, counts{} {
    require_positive("length", length);
    require_positive("width", width);
    require_positive("height", height);
    require_h(h, std::max({length, width, height}));
    for (int d = 0; d < 3; ++d) counts[d] = steps(size[d], h);
  }

  /// With given counts.
  Grid(const std::array<double, 3>& sizes, const std::array<double, 3>& parts) : size(sizes), counts(parts) {}

  /// Once the number of cells is known to be small.
  Counts indices() const {
    return {static_cast<Index>(counts[0]), static_cast<Index>(counts[1]), static_cast<Index>(counts[2])};
  }

  Eigen::RowVector3d point(const GridPoint& p) const {
    return {size[0] * (p[0] / counts[0]), size[1] * (p[1] / counts[1]), size[2] * (p[2] / counts[2])};
  }
};

/// Numbers the grid points on the surface of the box in lexicographic order, without a table of all grid points.
class SurfaceNumbering {
 public:
  explicit SurfaceNumbering(const Counts& n) : n_(n) {}

  Index count() const { return 2 * layer() + (n_[0] - 1) * perimeter(); }
  Index operator()(const GridPoint& p) const {
    if (p[0] == 0) return p[1] * (n_[2] + 1) + p[2];
    if (p[0] == n_[0]) return layer() + (n_[0] - 1) * perimeter() + p[1] * (n_[2] + 1) + p[2];
    const Index start = layer() + (p[0] - 1) * perimeter();
    if (p[1] == 0) return start + p[2];
    const Index middle = start + n_[2] + 1;
    if (p[1] < n_[1]) return middle + 2 * (p[1] - 1) + (p[2] == 0 ? 0 : 1);
    return middle + 2 * (n_[1] - 1) + p[2];
  }

 private:
  Index layer() const { return (n_[1] + 1) * (n_[2] + 1); }
  Index perimeter() const { return 2 * (n_[1] + n_[2]); }

  Counts n_;
};

double surface_cells(const Grid& grid) {
  const auto& [cx, cy, cz] = grid.counts;
  return 4.0 * (cx * cy + cy * cz + cz * cx);
}

/// The surface of a box, closed, outward. Diagonals all the same way on each side, or in turns.
Mesh box_surface(const Grid& grid, bool alternating) {
  const Counts n = grid.indices();
  const SurfaceNumbering vertex(n);

  Mesh mesh{Matrix(vertex.count(), 3), IndexMatrix(static_cast<Index>(surface_cells(grid)), 3)};
  for (Index i = 0; i <= n[0]; ++i) {
    for (Index j = 0; j <= n[1]; ++j) {
      // Inside the box only the two ends of a line of points are on the surface.
      const Index stride = (i == 0 || i == n[0] || j == 0 || j == n[1]) ? 1 : n[2];
      for (Index k = 0; k <= n[2]; k += stride) mesh.positions.row(vertex({i, j, k})) = grid.point({i, j, k});
    }
  }

  Index t = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3;
    const int v = (axis + 2) % 3;
    for (const Index side : {Index{0}, n[axis]}) {
      for (Index i = 0; i < n[u]; ++i) {
        for (Index j = 0; j < n[v]; ++j, t += 2) {
          const auto corner = [&](Index di, Index dj) {
            GridPoint p{};
            p[axis] = side;
            p[u] = i + di;
            p[v] = j + dj;
            return vertex(p);
          };
          // Along the positive axis (u, v) turns counter-clockwise; the opposite side is seen from behind.
          const Index flip = side == 0 ? 1 : 0;
          const std::array<Index, 4> quad = {corner(0, 0), corner(1 - flip, flip), corner(1, 1),
                                             corner(flip, 1 - flip)};
          const int first = alternating && (i + j) % 2 == 1 ? 1 : 0;  // where the diagonal starts
          mesh.cells.row(t) << quad[first], quad[first + 1], quad[(first + 2) % 4];
          mesh.cells.row(t + 1) << quad[first], quad[first + 2], quad[(first + 3) % 4];
        }
      }
    }
  }
  return mesh;
}

}  // namespace

Mesh bar_surface_mesh(double length, double width, double height, double h) {
  const Grid grid(length, width, height, h);
  require_cell_count("h", h, surface_cells(grid));
  return box_surface(grid, false);
}

Mesh square_tube_mesh(const SquareTubeOptions& options) {
  require_positive("length", options.length);
  require_positive("width", options.width);
  require_range("along", options.along, 1.0, 1e6);
  require_range("across", options.across, 1.0, 1e6);
  const auto across = static_cast<double>(options.across);
  const Grid grid({options.width, options.width, options.length}, {across, across, static_cast<double>(options.along)});
  require_cell_count("along", options.along, surface_cells(grid));
  Mesh mesh = box_surface(grid, options.alternating);
  mesh.positions.leftCols(2).array() -= 0.5 * options.width;
  return mesh;
}

Mesh bar_tet_mesh(double length, double width, double height, double h, double jitter, std::uint64_t seed) {
  const Grid grid(length, width, height, h);
  require_range("jitter", jitter, 0.0, 0.45);
  const double boxes = grid.counts[0] * grid.counts[1] * grid.counts[2];
  require_cell_count("h", h, 6.0 * boxes);
  const Counts n = grid.indices();
  const auto vertex = [&n](const GridPoint& p) { return (p[0] * (n[1] + 1) + p[1]) * (n[2] + 1) + p[2]; };

  // Each tetrahedron of a box walks from the lowest to the highest corner, one axis after the other. Odd orders of the
  // axes give negative tetrahedra, which swapping the two middle vertices mends.
  struct Walk {
    std::array<int, 3> axes;
    bool odd;
  };
  constexpr std::array<Walk, 6> kWalks = {{{{0, 1, 2}, false},
                                           {{1, 2, 0}, false},
                                           {{2, 0, 1}, false},
                                           {{0, 2, 1}, true},
                                           {{1, 0, 2}, true},
                                           {{2, 1, 0}, true}}};
  Mesh mesh{Matrix((n[0] + 1) * (n[1] + 1) * (n[2] + 1), 3), IndexMatrix(static_cast<Index>(6.0 * boxes), 4)};
  Index t = 0;
  for (Index i = 0; i <= n[0]; ++i) {
    for (Index j = 0; j <= n[1]; ++j) {
      for (Index k = 0; k <= n[2]; ++k) {
        mesh.positions.row(vertex({i, j, k})) = grid.point({i, j, k});
        if (i == n[0] || j == n[1] || k == n[2]) continue;
        for (const Walk& walk : kWalks) {
          GridPoint p{i, j, k};
          std::array<Index, 4> corners{vertex(p)};
          for (int step = 0; step < 3; ++step) {
            ++p[walk.axes[step]];
            corners[step + 1] = vertex(p);
          }
          if (walk.odd) std::swap(corners[1], corners[2]);
          mesh.cells.row(t++) << corners[0], corners[1], corners[2], corners[3];
        }
      }
    }
  }
  if (jitter > 0.0) {
    Matrix reach = Matrix::Zero(mesh.vertex_count(), 3);
    for (Index i = 1; i < n[0]; ++i) {
      for (Index j = 1; j < n[1]; ++j) {
        for (Index k = 1; k < n[2]; ++k) reach.row(vertex({i, j, k})) = jitter * grid.point({1, 1, 1});
      }
    }
    Random random(seed);
    jitter_vertices(mesh, reach, random);
  }
  return mesh;
}

}  // namespace variform
