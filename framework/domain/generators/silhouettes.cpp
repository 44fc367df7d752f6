// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Core>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <numeric>
#include <unordered_map>
#include <utility>
#include <vector>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/base/registry.h"
#include "framework/domain/generators.h"
#include "framework/domain/generators/silhouette_shapes.h"
#include "framework/domain/generators/support.h"

namespace variform {
namespace {

using namespace generators;
using Eigen::Vector2d;
using Triangle = std::array<Index, 3>;

const Registry<Silhouette>& registry() {
  static const Registry<Silhouette> kRegistry("silhouette", silhouettes());
  return kRegistry;
}

/// Lattice vertices this much of h or less from the outline are moved onto it. Larger values flatten the triangles
/// whose vertices move, smaller ones leave thinner pieces where the outline cuts; this is about the optimum.
constexpr double kSnap = 0.3;

/// Cuts a lattice of equilateral triangles along the outline of a silhouette ("isosurface stuffing"). With `half` only
/// the part x >= 0, with a row of the lattice on the y axis.
class LatticeCutter {
 public:
  LatticeCutter(const Silhouette& shape, double h, bool half) : shape_(shape), h_(h), half_(half) {
    lay_lattice();
    snap();
  }

  Mesh cut() {
    for (Index row = 0; row + 1 < rows_; ++row) {
      for (Index i = 0; i + 1 < columns_; ++i) {
        // Odd rows are shifted to the right by h / 2.
        const Index a = row * columns_ + i;
        const Index c = a + columns_;
        if (row % 2 == 0) {
          cut_triangle({a, a + 1, c});
          cut_triangle({a + 1, c + 1, c});
        } else {
          cut_triangle({a, a + 1, c + 1});
          cut_triangle({a, c + 1, c});
        }
      }
    }
    return largest_component();
  }

 private:
  void lay_lattice() {
    Vector2d low = Vector2d::Constant(std::numeric_limits<double>::infinity());
    Vector2d high = -low;
    for (const Stroke& stroke : shape_.strokes) {
      for (const Joint& joint : stroke) {
        low = low.cwiseMin(joint.place - Vector2d::Constant(joint.radius));
        high = high.cwiseMax(joint.place + Vector2d::Constant(joint.radius));
      }
    }
    // Blending adds a little to the strokes, the shift of odd rows takes away a little.
    low.array() -= shape_.blend + 2.0 * h_;
    high.array() += shape_.blend + 2.0 * h_;
    const double rise = 0.5 * std::numbers::sqrt3 * h_;
    if (half_) {  // rows go along y
      low = {low.y(), 0.0};
      high = {high.y(), high.x()};
    }
    const double columns = std::ceil((high.x() - low.x()) / h_) + 1.0;
    const double rows = std::ceil((high.y() - low.y()) / rise) + 1.0;
    require_cell_count("h", h_, 2.0 * columns * rows);
    columns_ = static_cast<Index>(columns);
    rows_ = static_cast<Index>(rows);

    places_.resize(static_cast<std::size_t>(columns_) * rows_);
    distances_.resize(places_.size());
    parallel_for(rows_ * columns_, [&](Index v) {
      const Index row = v / columns_;
      places_[v] = low + Vector2d((v % columns_ + 0.5 * (row % 2)) * h_, row * rise);
      if (half_) std::swap(places_[v].x(), places_[v].y());
      distances_[v] = outline_distance(places_[v]);
    });
  }

  /// Symmetric to the last digit where only one half is meshed: places on the axis then stay there.
  double outline_distance(const Vector2d& p) const {
    return half_ ? shape_.distance({std::abs(p.x()), p.y()}) : shape_.distance(p);
  }

  Vector2d slope(const Vector2d& p) const {
    const double step = 1e-6 * h_;
    const Vector2d dx(step, 0.0);
    const Vector2d dy(0.0, step);
    return Vector2d(outline_distance(p + dx) - outline_distance(p - dx),
                    outline_distance(p + dy) - outline_distance(p - dy)) /
           (2.0 * step);
  }

  /// Moves the place to about the nearest point on the outline. False when it does not get there, or only far away:
  /// some ridge of the distance led it astray.
  bool project(Vector2d& place) const {
    constexpr int kSteps = 50;
    constexpr double kReach = 1.5 * kSnap;
    const Vector2d start = place;
    for (int step = 0; step < kSteps; ++step) {
      const double distance = outline_distance(place);
      if (std::abs(distance) <= kOnOutline * h_) return (place - start).norm() <= kReach * h_;
      const Vector2d g = slope(place);
      place -= distance * g / std::max(g.squaredNorm(), 0.25);
    }
    return false;
  }

  /// Moves the vertices near the outline onto it. One that cannot be moved stays: the cut is then less shapely there.
  void snap() {
    parallel_for(rows_ * columns_, [&](Index v) {
      if (std::abs(distances_[v]) > kSnap * h_) return;
      Vector2d place = places_[v];
      if (!project(place)) return;
      places_[v] = place;
      distances_[v] = 0.0;
    });
  }

  /// The vertex where the outline crosses the edge between an inner and an outer vertex, by bisection.
  Index crossing(Index inner, Index outer) {
    const auto key = static_cast<std::uint64_t>(inner) << 32U | static_cast<std::uint64_t>(outer);
    const auto [entry, is_new] = crossings_.try_emplace(key, static_cast<Index>(places_.size()));
    if (is_new) {
      Vector2d in = places_[inner];
      Vector2d out = places_[outer];
      while ((out - in).norm() > kOnOutline * h_) {
        const Vector2d middle = 0.5 * (in + out);
        (outline_distance(middle) < 0.0 ? in : out) = middle;
      }
      places_.emplace_back(0.5 * (in + out));
      distances_.push_back(0.0);
    }
    return entry->second;
  }

  /// Adds the part of a lattice triangle that is inside.
  void cut_triangle(Triangle t) {
    if (half_) std::swap(t[1], t[2]);  // rows and columns have changed places
    const auto inside = [&](Index v) { return distances_[v] < 0.0; };
    const auto outside = [&](Index v) { return distances_[v] > 0.0; };
    const auto inner_count = std::count_if(t.begin(), t.end(), inside);
    const auto outer_count = std::count_if(t.begin(), t.end(), outside);
    if (inner_count == 0) return;
    if (outer_count == 0) {
      triangles_.push_back(t);
    } else if (inner_count == 1 && outer_count == 2) {
      while (!inside(t[0])) std::rotate(t.begin(), t.begin() + 1, t.end());
      triangles_.push_back({t[0], crossing(t[0], t[1]), crossing(t[0], t[2])});
    } else if (inner_count == 2) {
      while (!outside(t[2])) std::rotate(t.begin(), t.begin() + 1, t.end());
      const Index p = crossing(t[1], t[2]);
      const Index q = crossing(t[0], t[2]);
      // The shorter diagonal of the quad (0, 1, p, q).
      if ((places_[t[0]] - places_[p]).squaredNorm() < (places_[t[1]] - places_[q]).squaredNorm()) {
        triangles_.push_back({t[0], t[1], p});
        triangles_.push_back({t[0], p, q});
      } else {
        triangles_.push_back({t[0], t[1], q});
        triangles_.push_back({t[1], p, q});
      }
    } else {
      while (!inside(t[0])) std::rotate(t.begin(), t.begin() + 1, t.end());
      if (outside(t[1])) {
        triangles_.push_back({t[0], crossing(t[0], t[1]), t[2]});
      } else {
        triangles_.push_back({t[0], t[1], crossing(t[0], t[2])});
      }
    }
  }

  /// The triangles that hang together by inner lattice vertices, those of the largest such set. It has all the strokes,
  /// since h is at most their smallest radius: the nearer end of a lattice edge that crosses the axis of a stroke is at
  /// most h / 2 from it, thus inside and not snapped, and consecutive such edges belong to one triangle.
  Mesh largest_component() const {
    std::vector<Index> parent(places_.size());
    std::iota(parent.begin(), parent.end(), Index{0});
    const auto root = [&](Index v) {
      while (parent[v] != v) v = parent[v] = parent[parent[v]];
      return v;
    };
    std::vector<Index> root_of_triangle;
    root_of_triangle.reserve(triangles_.size());
    for (const Triangle& t : triangles_) {
      Index first = -1;
      for (const Index v : t) {
        if (distances_[v] >= 0.0) continue;
        if (first < 0) first = v;
        parent[root(v)] = root(first);
      }
      root_of_triangle.push_back(first);
    }
    std::vector<Index> count(places_.size(), 0);
    for (Index& v : root_of_triangle) {
      if (v >= 0) ++count[v = root(v)];
    }
    const auto largest = static_cast<Index>(std::max_element(count.begin(), count.end()) - count.begin());
    std::vector<Triangle> kept;
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      if (root_of_triangle[t] == largest) kept.push_back(triangles_[t]);
    }
    return compact(kept);
  }

  /// Numbers the vertices in use in their order.
  Mesh compact(const std::vector<Triangle>& triangles) const {
    std::vector<Index> number(places_.size(), -1);
    for (const Triangle& t : triangles) {
      for (const Index v : t) number[v] = 0;
    }
    Index vertex_count = 0;
    for (Index& n : number) {
      if (n == 0) n = vertex_count++;
    }
    Mesh mesh{Matrix(vertex_count, 2), IndexMatrix(static_cast<Index>(triangles.size()), 3)};
    std::vector<bool> on_outline(vertex_count);
    for (std::size_t v = 0; v < places_.size(); ++v) {
      if (number[v] < 0) continue;
      mesh.positions.row(number[v]) = places_[v].transpose();
      on_outline[number[v]] = distances_[v] == 0.0;
    }
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const auto& [a, b, c] = triangles[t];
      mesh.cells.row(static_cast<Index>(t)) << number[a], number[b], number[c];
    }
    relax(mesh, on_outline);
    return mesh;
  }

  /// Moves the vertices of flat triangles to the middle of their neighbours, on the outline along it, where that makes
  /// the smallest angle around larger.
  void relax(Mesh& mesh, const std::vector<bool>& on_outline) const {
    constexpr int kPasses = 5;
    constexpr double kGoodAngle = 40.0 * std::numbers::pi / 180.0;
    const VertexCells around(mesh);
    for (int pass = 0; pass < kPasses; ++pass) {
      for (Index v = 0; v < mesh.vertex_count(); ++v) {
        const auto smallest_angle = [&] {
          double angle = std::numbers::pi;
          for (const Index t : around[v]) angle = std::min(angle, smallest_angle_of(mesh, t));
          return angle;
        };
        const double angle = smallest_angle();
        if (angle >= kGoodAngle) continue;
        const Vector2d old_place = mesh.positions.row(v);
        Vector2d place = Vector2d::Zero();
        for (const Index t : around[v]) {
          for (const Index w : mesh.cells.row(t)) place += mesh.positions.row(w).transpose();
        }
        place = (place / static_cast<double>(around[v].size()) - old_place) / 2.0;
        if (half_ && old_place.x() == 0.0) place.x() = 0.0;
        if (on_outline[v] && !project(place)) continue;
        mesh.positions.row(v) = place.transpose();
        if (smallest_angle() <= angle) mesh.positions.row(v) = old_place.transpose();
      }
    }
  }

  /// In radians; negative for a clockwise triangle.
  static double smallest_angle_of(const Mesh& mesh, Index t) {
    const double doubled_area = 2.0 * signed_area(mesh.positions, mesh.cells(t, 0), mesh.cells(t, 1), mesh.cells(t, 2));
    double angle = std::numbers::pi;
    for (int i = 0; i < 3; ++i) {
      const auto corner = mesh.positions.row(mesh.cells(t, i));
      const auto u = mesh.positions.row(mesh.cells(t, (i + 1) % 3)) - corner;
      const auto v = mesh.positions.row(mesh.cells(t, (i + 2) % 3)) - corner;
      angle = std::min(angle, std::atan2(doubled_area, u.dot(v)));
    }
    return angle;
  }

  static constexpr double kOnOutline = 1e-10;  // of h

  const Silhouette& shape_;
  double h_;
  bool half_;
  Index columns_ = 0;
  Index rows_ = 0;
  std::vector<Vector2d> places_;   // the lattice row by row, then the crossings
  std::vector<double> distances_;  // 0 for what is on the outline
  std::unordered_map<std::uint64_t, Index> crossings_;
  std::vector<Triangle> triangles_;
};

/// A mesh of the half x >= 0 with its mirror image.
Mesh with_mirror_image(const Mesh& half) {
  std::vector<Index> image(half.vertex_count());
  Index count = half.vertex_count();
  for (Index v = 0; v < half.vertex_count(); ++v) image[v] = half.positions(v, 0) == 0.0 ? v : count++;
  Mesh whole{Matrix(count, 2), IndexMatrix(2 * half.cell_count(), 3)};
  for (Index v = 0; v < half.vertex_count(); ++v) {
    whole.positions.row(image[v]) << -half.positions(v, 0), half.positions(v, 1);
    whole.positions.row(v) = half.positions.row(v);
  }
  for (Index t = 0; t < half.cell_count(); ++t) {
    whole.cells.row(2 * t) = half.cells.row(t);
    whole.cells.row(2 * t + 1) << image[half.cells(t, 0)], image[half.cells(t, 2)], image[half.cells(t, 1)];
  }
  return whole;
}

}  // namespace

const std::vector<std::string>& silhouette_names() {
  static const std::vector<std::string> kNames = registry().names();
  return kNames;
}

Mesh silhouette_mesh(const std::string& name, double h, bool symmetric) {
  const Silhouette& shape = registry().find(name);
  require_positive("h", h);
  if (h > shape.smallest_radius()) {
    throw UsageError(fmt::format("'h' = {}: too coarse for the limbs of the silhouette '{}'; expected at most {}", h,
                                 name, shape.smallest_radius()));
  }
  if (!symmetric) return LatticeCutter(shape, h, false).cut();
  if (!shape.symmetric) throw UsageError(fmt::format("the silhouette '{}' is not symmetric", name));
  return with_mirror_image(LatticeCutter(shape, h, true).cut());
}

}  // namespace variform
