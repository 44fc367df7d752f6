// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/domain/check.h"
#include "framework/domain/generators.h"
#include "framework/domain/generators/support.h"

namespace variform {
namespace {

using namespace generators;
using Eigen::RowVector3d;
using Eigen::Vector3d;
using std::numbers::pi;
using GridPoint = std::array<Index, 3>;

// ---- wing ----

/// Grid lines through the given places, with steps of about h between them.
std::vector<double> lines_through(const std::vector<double>& places, double h) {
  std::vector<double> lines = {places.front()};
  for (std::size_t k = 1; k < places.size(); ++k) {
    const double count = steps(places[k] - places[k - 1], h);
    for (double i = 1.0; i < count; i += 1.0) lines.push_back(places[k - 1] + (places[k] - places[k - 1]) * i / count);
    lines.push_back(places[k]);
  }
  return lines;
}

/// The tetrahedra of one box of a grid, as walks along its edges from the lowest to the highest corner.
constexpr std::array<std::array<int, 3>, 6> kWalks = {
    {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}}};

// ---- convex hull of points on a sphere ----

using Triangle = std::array<Index, 3>;

/// Convex hull of points in general position of which every one is a corner: one point after the other, with a look at
/// all triangles. Outward.
std::vector<Triangle> convex_hull(const Matrix& points) {
  const auto at = [&](Index v) { return Vector3d(points.row(v)); };
  const auto sees = [&](Index p, const Triangle& t) {
    return (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).dot(at(p) - at(t[0])) > 0.0;
  };
  std::vector<Triangle> hull = {{0, 1, 2}, {0, 2, 1}};
  if (sees(3, hull[0])) std::swap(hull[0], hull[1]);
  std::vector<Triangle> kept;
  std::set<std::pair<Index, Index>> seen_edges;
  for (Index p = 3; p < points.rows(); ++p) {
    kept.clear();
    seen_edges.clear();
    for (const Triangle& t : hull) {
      // The first two triangles lie in one plane: the fourth point sees one of them.
      const bool seen = p == 3 ? t == hull[1] : sees(p, t);
      if (!seen) {
        kept.push_back(t);
        continue;
      }
      for (int i = 0; i < 3; ++i) seen_edges.insert({t[i], t[(i + 1) % 3]});
    }
    for (const auto& [a, b] : seen_edges) {
      if (seen_edges.count({b, a}) == 0) kept.push_back({a, b, p});
    }
    std::swap(hull, kept);
  }
  return hull;
}

// ---- cactus ----

struct Capsules {
  std::vector<Vector3d> joints;
  double radius;

  double distance(const Vector3d& p) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k < joints.size(); ++k) {
      const Vector3d axis = joints[k] - joints[k - 1];
      const double share = std::clamp((p - joints[k - 1]).dot(axis) / axis.squaredNorm(), 0.0, 1.0);
      least = std::min(least, (p - joints[k - 1] - share * axis).norm());
    }
    return least - radius;
  }
};

/// Leaves the trunk at `height` sideways (side = 1 or -1 along x), bends upwards and ends in a round tip.
Capsules cactus_arm(double side, double height, double reach, double rise, double radius) {
  constexpr int kPieces = 16;
  constexpr double kBend = 0.12;
  Capsules arm{{{0.0, 0.0, height}}, radius};
  for (int k = 0; k <= kPieces; ++k) {
    const double angle = 0.5 * pi * k / kPieces;
    arm.joints.push_back(
        {side * (reach - kBend + kBend * std::sin(angle)), 0.0, height + kBend * (1.0 - std::cos(angle))});
  }
  arm.joints.push_back(arm.joints.back() + Vector3d(0.0, 0.0, rise));
  return arm;
}

const std::array<Capsules, 3>& cactus_parts() {
  static const std::array<Capsules, 3> parts = {Capsules{{{0.0, 0.0, 0.12}, {0.0, 0.0, 1.0}}, 0.12},
                                                cactus_arm(1.0, 0.42, 0.36, 0.24, 0.07),
                                                cactus_arm(-1.0, 0.58, 0.34, 0.16, 0.06)};
  return parts;
}

/// Negative inside; the corners between trunk and arms are rounded off.
double cactus_distance(const Vector3d& p) {
  constexpr double kBlend = 0.06;
  double distance = std::numeric_limits<double>::infinity();
  for (const Capsules& part : cactus_parts()) {
    const double other = part.distance(p);
    const double overlap = std::max(kBlend - std::abs(distance - other), 0.0);
    distance = std::min(distance, other) - overlap * overlap / (4.0 * kBlend);
  }
  return distance;
}

/// Moves a point near the zero set of a function onto it, along its gradient.
template <class Function>
Vector3d projected(const Function& f, Vector3d p, double h) {
  for (int round = 0; round < 4; ++round) {
    const double step = 1e-5 * h;
    Vector3d slope;
    for (int d = 0; d < 3; ++d) {
      const Vector3d e = step * Vector3d::Unit(d);
      slope[d] = (f(p + e) - f(p - e)) / (2.0 * step);
    }
    p -= f(p) * slope / std::max(slope.squaredNorm(), 0.25);
  }
  return p;
}

/// The zero set of a function that is negative inside and positive on the border of a box, by surface nets (Gibson
/// 1998): one vertex in each box of a grid that the set goes through, one quad across each edge of the grid with a
/// change of sign; then rounds in which every vertex goes to the mean of its neighbours and back onto the set.
template <class Function>
Mesh surface_net(const Function& f, const Vector3d& low, const Vector3d& high, double h, int rounds) {
  GridPoint n{};
  for (int d = 0; d < 3; ++d) n[d] = static_cast<Index>(std::ceil((high[d] - low[d]) / h)) + 1;
  const auto node = [&](const GridPoint& p) { return (p[0] * n[1] + p[1]) * n[2] + p[2]; };
  const auto place = [&](const GridPoint& p) { return Vector3d(low + h * Vector3d(p[0], p[1], p[2])); };
  std::vector<double> values(static_cast<std::size_t>(n[0]) * n[1] * n[2]);
  parallel_for(n[0], [&](Index i) {
    for (Index j = 0; j < n[1]; ++j) {
      for (Index k = 0; k < n[2]; ++k) values[node({i, j, k})] = f(place({i, j, k}));
    }
  });

  std::vector<Index> vertex_of(values.size(), -1);  // of the box above a node
  std::vector<Vector3d> points;
  for (Index i = 0; i + 1 < n[0]; ++i) {
    for (Index j = 0; j + 1 < n[1]; ++j) {
      for (Index k = 0; k + 1 < n[2]; ++k) {
        Vector3d sum = Vector3d::Zero();
        int crossings = 0;
        for (int axis = 0; axis < 3; ++axis) {
          for (int corner = 0; corner < 4; ++corner) {
            GridPoint a{i, j, k};
            a[(axis + 1) % 3] += corner & 1;
            a[(axis + 2) % 3] += corner >> 1;
            GridPoint b = a;
            ++b[axis];
            const double fa = values[node(a)];
            const double fb = values[node(b)];
            if ((fa < 0.0) == (fb < 0.0)) continue;
            sum += place(a) + fa / (fa - fb) * (place(b) - place(a));
            ++crossings;
          }
        }
        if (crossings == 0) continue;
        vertex_of[node({i, j, k})] = static_cast<Index>(points.size());
        points.emplace_back(sum / crossings);
      }
    }
  }

  std::vector<std::array<Index, 4>> quads;
  for (Index i = 1; i + 1 < n[0]; ++i) {
    for (Index j = 1; j + 1 < n[1]; ++j) {
      for (Index k = 1; k + 1 < n[2]; ++k) {
        for (int axis = 0; axis < 3; ++axis) {
          const GridPoint a{i, j, k};
          GridPoint b = a;
          ++b[axis];
          const bool inside = values[node(a)] < 0.0;
          if (inside == (values[node(b)] < 0.0)) continue;
          const auto box = [&](Index du, Index dv) {
            GridPoint p = a;
            p[(axis + 1) % 3] -= du;
            p[(axis + 2) % 3] -= dv;
            return vertex_of[node(p)];
          };
          std::array<Index, 4> quad = {box(1, 1), box(0, 1), box(0, 0), box(1, 0)};
          if (!inside) std::swap(quad[1], quad[3]);
          quads.push_back(quad);
        }
      }
    }
  }

  // Neighbours along the sides of the quads.
  std::vector<std::set<Index>> neighbours(points.size());
  for (const auto& q : quads) {
    for (int i = 0; i < 4; ++i) {
      neighbours[q[i]].insert(q[(i + 1) % 4]);
      neighbours[q[(i + 1) % 4]].insert(q[i]);
    }
  }
  std::vector<Vector3d> next(points.size());
  for (int round = 0; round < rounds; ++round) {
    parallel_for(static_cast<Index>(points.size()), [&](Index v) {
      Vector3d mean = Vector3d::Zero();
      for (const Index w : neighbours[v]) mean += points[w];
      next[v] = projected(f, mean / static_cast<double>(neighbours[v].size()), h);
    });
    std::swap(points, next);
  }

  Mesh mesh{Matrix(static_cast<Index>(points.size()), 3), IndexMatrix(2 * static_cast<Index>(quads.size()), 3)};
  for (std::size_t v = 0; v < points.size(); ++v) mesh.positions.row(static_cast<Index>(v)) = points[v];
  Index t = 0;
  for (const auto& [a, b, c, d] : quads) {
    const bool first = (points[a] - points[c]).squaredNorm() <= (points[b] - points[d]).squaredNorm();
    if (first) {
      mesh.cells.row(t++) << a, b, c;
      mesh.cells.row(t++) << a, c, d;
    } else {
      mesh.cells.row(t++) << a, b, d;
      mesh.cells.row(t++) << b, c, d;
    }
  }
  return mesh;
}

}  // namespace

Mesh tube_mesh(const TubeOptions& options) {
  require_positive("radius", options.radius);
  require_positive("length", options.length);
  require_range("around", options.around, 3.0, 1e6);
  require_range("along", options.along, 1.0, 1e6);
  require_cell_count("along", options.along, 2.0 * options.around * options.along);
  const Index n = options.around;
  const Index m = options.along;
  const auto vertex = [n](Index i, Index k) { return k * n + i % n; };
  Mesh mesh{Matrix(n * (m + 1), 3), IndexMatrix(2 * n * m, 3)};
  for (Index k = 0; k <= m; ++k) {
    for (Index i = 0; i < n; ++i) {
      const double angle = 2.0 * pi * i / n;
      mesh.positions.row(vertex(i, k)) << options.radius * std::cos(angle), options.radius * std::sin(angle),
          options.length * k / m;
    }
  }
  Index t = 0;
  for (Index k = 0; k < m; ++k) {
    for (Index i = 0; i < n; ++i) {
      const Index a = vertex(i, k);
      const Index b = vertex(i + 1, k);
      const Index c = vertex(i + 1, k + 1);
      const Index d = vertex(i, k + 1);
      if (options.alternating && (i + k) % 2 == 1) {
        mesh.cells.row(t++) << a, b, d;
        mesh.cells.row(t++) << b, c, d;
      } else {
        mesh.cells.row(t++) << a, b, c;
        mesh.cells.row(t++) << a, c, d;
      }
    }
  }
  return mesh;
}

Mesh bump_array_mesh(const BumpArrayOptions& options) {
  require_range("bumps", options.bumps, 1.0, 1000.0);
  require_positive("radius", options.radius);
  const double gap = std::min(options.base.width, options.base.height) / options.bumps;
  if (options.radius > 0.5 * gap) {
    throw UsageError(
        fmt::format("'radius' = {}: expected at most {}, half the distance of the bumps", options.radius, 0.5 * gap));
  }
  if (!std::isfinite(options.height)) {
    throw UsageError(fmt::format("'height' = {}: expected a finite number", options.height));
  }
  const Mesh sheet = rectangle_mesh(options.base);
  Mesh mesh{Matrix::Zero(sheet.vertex_count(), 3), sheet.cells};
  mesh.positions.leftCols(2) = sheet.positions;
  const auto offset = [&](double x, double size) {  // from the centre of the nearest bump
    const double cell = size / options.bumps;
    return x - cell * (std::clamp(std::floor(x / cell), 0.0, options.bumps - 1.0) + 0.5);
  };
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const double dx = offset(mesh.positions(v, 0), options.base.width);
    const double dy = offset(mesh.positions(v, 1), options.base.height);
    const double inside = 1.0 - (dx * dx + dy * dy) / (options.radius * options.radius);
    if (inside > 0.0) mesh.positions(v, 2) = options.height * std::sqrt(inside);
  }
  return mesh;
}

Mesh pillow_mesh(const RectangleOptions& sheet) {
  RectangleOptions base = sheet;
  base.width = 2.0;
  base.height = 2.0;
  const Mesh flat = rectangle_mesh(base);
  Mesh mesh{Matrix(flat.vertex_count(), 3), flat.cells};
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const double x = flat.positions(v, 0) - 1.0;
    const double y = flat.positions(v, 1) - 1.0;
    mesh.positions.row(v) << x, y, 0.5 * (1.0 - x * x) * (1.0 - y * y);
  }
  return mesh;
}

Mesh wing_tet_mesh(double h) {
  require_h(h, 0.4);
  require_cell_count("h", h, 6.0 * 1.4 / (h * h * h));
  // The half with x >= 0; the other one is its mirror image.
  const std::vector<double> x = lines_through({0.0, 0.4, 2.0}, h);
  const std::vector<double> y = lines_through({-1.0, -0.3, 0.3, 1.0}, h);
  const std::vector<double> z = lines_through({-0.3, -0.1, 0.1, 0.3}, h);
  const auto filled = [&](const GridPoint& p) {
    const double cx = 0.5 * (x[p[0]] + x[p[0] + 1]);
    const double cy = 0.5 * (y[p[1]] + y[p[1] + 1]);
    const double cz = 0.5 * (z[p[2]] + z[p[2] + 1]);
    return cx < 0.4 || (std::abs(cy) < 0.3 && std::abs(cz) < 0.1);
  };
  std::map<GridPoint, Index> vertices;
  std::vector<RowVector3d> points;
  std::vector<std::array<Index, 4>> cells;
  const auto vertex = [&](const GridPoint& p) {
    const auto [found, is_new] = vertices.try_emplace(p, static_cast<Index>(points.size()));
    if (is_new) points.push_back({(p[0] < 0 ? -1.0 : 1.0) * x[std::abs(p[0])], y[p[1]], z[p[2]]});
    return found->second;
  };
  for (Index i = 0; i + 1 < static_cast<Index>(x.size()); ++i) {
    for (Index j = 0; j + 1 < static_cast<Index>(y.size()); ++j) {
      for (Index k = 0; k + 1 < static_cast<Index>(z.size()); ++k) {
        if (!filled({i, j, k})) continue;
        for (std::size_t w = 0; w < kWalks.size(); ++w) {
          std::array<Index, 4> right{};
          std::array<Index, 4> left{};
          GridPoint p{i, j, k};
          for (int step = 0; step < 4; ++step) {
            right[step] = vertex(p);
            left[step] = vertex({-p[0], p[1], p[2]});
            if (step < 3) ++p[kWalks[w][step]];
          }
          std::swap(w < 3 ? left[1] : right[1], w < 3 ? left[2] : right[2]);  // odd walks, and mirrored even ones
          cells.push_back(right);
          cells.push_back(left);
        }
      }
    }
  }
  Mesh mesh{Matrix(static_cast<Index>(points.size()), 3), IndexMatrix(static_cast<Index>(cells.size()), 4)};
  for (std::size_t v = 0; v < points.size(); ++v) mesh.positions.row(static_cast<Index>(v)) = points[v];
  for (std::size_t t = 0; t < cells.size(); ++t) {
    mesh.cells.row(static_cast<Index>(t)) << cells[t][0], cells[t][1], cells[t][2], cells[t][3];
  }
  return mesh;
}

Mesh box_car_mesh(double h) {
  constexpr double kLength = 2.0;
  constexpr double kWidth = 1.0;
  constexpr double kHeight = 0.5;
  constexpr double kHood = 0.2;
  Mesh mesh = bar_surface_mesh(kLength, kWidth, kHeight, h);
  for (auto p : mesh.positions.rowwise()) {
    const double u = 2.0 * p(0) / kLength - 1.0;  // over the front half
    if (u <= 0.0) continue;
    const auto swell = [](double s) { return std::pow(std::sin(pi * s), 2); };
    p(2) += p(2) / kHeight * kHood * swell(u) * swell(p(1) / kWidth);
  }
  return mesh;
}

Mesh cactus_surface_mesh(double h) {
  constexpr int kRounds = 8;
  require_h(h, 0.04);
  require_cell_count("h", h, 3.0 / (h * h * h));  // boxes of the grid
  const Vector3d margin = Vector3d::Constant(0.03 + 2.0 * h);
  const Vector3d low = Vector3d(-0.4, -0.12, 0.0) - margin;
  const Vector3d high = Vector3d(0.43, 0.12, 1.12) + margin;
  // A box of the grid that the surface goes through twice, in the corners between trunk and arms, makes the net no
  // manifold. That is rare: the grid is shifted then.
  constexpr int kTries = 50;
  Random random(1);
  for (int attempt = 0; attempt < kTries; ++attempt) {
    const Vector3d shift(random.uniform(), random.uniform(), random.uniform());
    if (!check_mesh(surface_net(cactus_distance, low - h * shift, high, h, 0)).empty()) continue;
    Mesh mesh = surface_net(cactus_distance, low - h * shift, high, h, kRounds);
    if (check_mesh(mesh).empty()) return mesh;
  }
  throw UsageError(fmt::format("'h' = {}: the cactus is no manifold at this size", h));
}

int cactus_surface_part(const Eigen::Vector3d& point) {
  int nearest = 0;
  for (int part = 1; part < 3; ++part) {
    if (cactus_parts()[part].distance(point) < cactus_parts()[nearest].distance(point)) nearest = part;
  }
  return nearest;
}

Mesh lattice_sphere_mesh(double radius, int meridians, int parallels) {
  require_positive("radius", radius);
  require_range("meridians", meridians, 3.0, 1e6);
  require_range("parallels", parallels, 1.0, 1e6);
  require_cell_count("meridians", meridians, 2.0 * meridians * static_cast<double>(parallels));
  const Index m = meridians;
  const Index n = parallels;
  const auto vertex = [m](Index k, Index i) { return 1 + k * m + i % m; };
  Mesh mesh{Matrix(m * n + 2, 3), IndexMatrix(2 * m * n, 3)};
  const Index south = m * n + 1;
  mesh.positions.row(0) << 0.0, 0.0, radius;
  mesh.positions.row(south) << 0.0, 0.0, -radius;
  Index t = 0;
  for (Index k = 0; k < n; ++k) {
    const double polar = pi * (k + 1) / (n + 1);
    for (Index i = 0; i < m; ++i) {
      const double angle = 2.0 * pi * i / m;
      mesh.positions.row(vertex(k, i)) << radius * std::sin(polar) * std::cos(angle),
          radius * std::sin(polar) * std::sin(angle), radius * std::cos(polar);
      if (k == 0) mesh.cells.row(t++) << 0, vertex(k, i), vertex(k, i + 1);
      if (k + 1 == n) {
        mesh.cells.row(t++) << south, vertex(k, i + 1), vertex(k, i);
      } else {
        mesh.cells.row(t++) << vertex(k, i), vertex(k + 1, i), vertex(k + 1, i + 1);
        mesh.cells.row(t++) << vertex(k, i), vertex(k + 1, i + 1), vertex(k, i + 1);
      }
    }
  }
  return mesh;
}

Mesh random_sphere_mesh(const RandomSphereOptions& options) {
  require_positive("radius", options.radius);
  require_range("points", options.points, 12.0, 20000.0);
  require_range("rounds", options.rounds, 0.0, 1000.0);
  Random random(options.seed);
  Mesh mesh{Matrix(options.points, 3), {}};
  for (auto p : mesh.positions.rowwise()) {
    const double z = random.symmetric();
    const double angle = pi * random.symmetric();
    const double r = std::sqrt(1.0 - z * z);
    p << r * std::cos(angle), r * std::sin(angle), z;
  }
  std::vector<Triangle> hull = convex_hull(mesh.positions);
  for (int round = 0; round < options.rounds; ++round) {
    Matrix sum = Matrix::Zero(options.points, 3);
    for (const Triangle& t : hull) {
      for (int i = 0; i < 3; ++i) sum.row(t[i]) += mesh.positions.row(t[(i + 1) % 3]);  // each neighbour once
    }
    mesh.positions = sum.rowwise().normalized();
    hull = convex_hull(mesh.positions);
  }
  mesh.cells.resize(static_cast<Index>(hull.size()), 3);
  for (std::size_t t = 0; t < hull.size(); ++t) {
    mesh.cells.row(static_cast<Index>(t)) << hull[t][0], hull[t][1], hull[t][2];
  }
  mesh.positions *= options.radius;
  return mesh;
}

}  // namespace variform
