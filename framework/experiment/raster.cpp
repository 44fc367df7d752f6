// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/raster.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "framework/base/error.h"

namespace variform {

const std::array<Rgb, 2> kCheckColours = {Rgb(0.96f, 0.96f, 0.94f), Rgb(0.27f, 0.42f, 0.60f)};

namespace {

constexpr float kNothing = -std::numeric_limits<float>::infinity();

constexpr double kAmbient = 0.42;
constexpr double kDiffuse = 0.58;
constexpr double kHighlight = 0.10;
constexpr double kShininess = 24.0;
constexpr double kCreaseCosine = 0.766;  // of 40 degrees

/// Cells keep this much of their height free of edges, so that small ones do not turn black.
constexpr double kLargestEdgeShare = 0.12;

const Eigen::Vector3d& lamp() {
  static const Eigen::Vector3d direction = Eigen::Vector3d(-0.35, 0.45, 1.0).normalized();
  return direction;
}

struct Light {
  double factor = 1.0;
  double highlight = 0.0;
};

/// normal: of any length and side.
Light light_on(Eigen::Vector3d normal) {
  const double length = normal.norm();
  if (!(length > 0.0)) return {};
  normal /= normal.z() < 0.0 ? -length : length;
  static const Eigen::Vector3d half = (lamp() + Eigen::Vector3d::UnitZ()).normalized();
  return {kAmbient + kDiffuse * std::max(0.0, normal.dot(lamp())),
          kHighlight * std::pow(std::max(0.0, normal.dot(half)), kShininess)};
}

std::uint32_t packed(const Rgb& colour) {
  const auto byte = [](float channel) {
    return static_cast<std::uint32_t>(std::lround(255.0f * std::clamp(channel, 0.0f, 1.0f)));
  };
  return 0xff000000u | byte(colour[0]) << 16 | byte(colour[1]) << 8 | byte(colour[2]);
}

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

View::View(const Camera& camera, const Eigen::Vector3d& centre, double eye_distance) : centre_(centre) {
  const Eigen::Vector3d towards = camera.direction.normalized();
  const Eigen::Vector3d right = camera.up.cross(towards);
  if (!(right.norm() > 1e-9 * camera.up.norm()) || !towards.allFinite() || !camera.up.allFinite()) {
    throw UsageError("camera: direction and up must be two different directions");
  }
  if (!(camera.zoom > 0.0 && std::isfinite(camera.zoom))) throw UsageError("camera: expected zoom > 0");
  axes_.row(0) = right.normalized();
  axes_.row(2) = towards;
  axes_.row(1) = axes_.row(2).cross(axes_.row(0));
  if (camera.perspective) inverse_distance_ = 1.0 / eye_distance;
}

Eigen::Vector3d View::operator()(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d seen = axes_ * (point - centre_);
  const double nearness = 1.0 - seen.z() * inverse_distance_;
  if (!(nearness > 0.0)) return Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  return seen / nearness;
}

Surface surface_of(const Mesh& mesh) {
  const auto corners = static_cast<Index>(mesh.cells.cols());
  const auto is_finite = [&mesh, corners](Index cell) {
    for (Index k = 0; k < corners; ++k) {
      if (!mesh.positions.row(mesh.cells(cell, k)).allFinite()) return false;
    }
    return true;
  };
  struct Face {
    std::array<Index, 3> sorted;
    std::array<Index, 3> vertices;
    Index cell;
  };
  std::vector<Face> faces;
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    if (!is_finite(c)) continue;
    const auto add = [&](int i, int j, int k) {
      const std::array<Index, 3> vertices = {mesh.cells(c, i), mesh.cells(c, j), mesh.cells(c, k)};
      faces.push_back({vertices, vertices, c});
      std::sort(faces.back().sorted.begin(), faces.back().sorted.end());
    };
    if (corners == 3) {
      add(0, 1, 2);
    } else {
      add(1, 2, 3);
      add(0, 3, 2);
      add(0, 1, 3);
      add(0, 2, 1);
    }
  }
  if (corners == 4) {
    std::vector<std::size_t> order(faces.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::sort(order.begin(), order.end(), [&faces](std::size_t a, std::size_t b) {
      return faces[a].sorted != faces[b].sorted ? faces[a].sorted < faces[b].sorted : a < b;
    });
    std::vector<std::size_t> single;
    for (std::size_t i = 0; i < order.size();) {
      std::size_t end = i + 1;
      while (end < order.size() && faces[order[end]].sorted == faces[order[i]].sorted) ++end;
      if (end == i + 1) single.push_back(order[i]);
      i = end;
    }
    std::sort(single.begin(), single.end());
    std::vector<Face> boundary;
    for (const std::size_t i : single) boundary.push_back(faces[i]);
    faces = std::move(boundary);
  }
  Surface surface;
  surface.triangles.resize(static_cast<Eigen::Index>(faces.size()), 3);
  for (std::size_t i = 0; i < faces.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      surface.triangles(static_cast<Eigen::Index>(i), k) = faces[i].vertices[static_cast<std::size_t>(k)];
    }
    surface.cells.push_back(faces[i].cell);
  }
  return surface;
}

Matrix corner_normals(const Matrix& positions, const IndexMatrix& triangles) {
  const Eigen::Index count = triangles.rows();
  Matrix areas(count, 3);  // normals with the length of twice the area
  std::vector<std::vector<Eigen::Index>> around(static_cast<std::size_t>(positions.rows()));
  for (Eigen::Index t = 0; t < count; ++t) {
    const Eigen::Vector3d a = positions.row(triangles(t, 0));
    const Eigen::Vector3d b = positions.row(triangles(t, 1));
    const Eigen::Vector3d c = positions.row(triangles(t, 2));
    areas.row(t) = (b - a).cross(c - a);
    for (int k = 0; k < 3; ++k) around[static_cast<std::size_t>(triangles(t, k))].push_back(t);
  }
  Matrix normals = Matrix::Zero(3 * count, 3);
  for (Eigen::Index t = 0; t < count; ++t) {
    const Eigen::RowVector3d own = areas.row(t);
    const double length = own.norm();
    if (!(length > 0.0)) continue;
    for (int k = 0; k < 3; ++k) {
      Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
      for (const Eigen::Index other : around[static_cast<std::size_t>(triangles(t, k))]) {
        const double agreement = areas.row(other).dot(own);
        if (std::abs(agreement) < kCreaseCosine * length * areas.row(other).norm()) continue;
        sum += std::copysign(1.0, agreement) * areas.row(other);
      }
      normals.row(3 * t + k) = sum.normalized();
    }
  }
  return normals;
}

Raster::Raster(int width, int height, int samples) : width_(width), height_(height), samples_(samples) {
  if (width < 1 || height < 1 || samples < 1) {
    throw UsageError(fmt::format("picture of {} x {} pixels with {} samples", width, height, samples));
  }
  const std::size_t count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                            static_cast<std::size_t>(samples) * static_cast<std::size_t>(samples);
  depths_.assign(count, kNothing);
  shades_.assign(count, 0);
}

void Raster::draw(const RasterTriangle& triangle) {
  std::array<Eigen::Vector2d, 3> p;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!triangle.corners[k].allFinite()) return;
    p[k] = triangle.corners[k].head<2>() * samples_;
  }
  const double area = cross(p[1] - p[0], p[2] - p[0]);
  if (area == 0.0) return;
  const int columns = width_ * samples_;
  const int rows = height_ * samples_;
  // Samples are at the middles of their squares.
  const auto range = [](double low, double high, int count) {
    return std::pair(static_cast<int>(std::clamp(std::ceil(low - 0.5), 0.0, static_cast<double>(count))),
                     static_cast<int>(std::clamp(std::floor(high - 0.5), -1.0, count - 1.0)));
  };
  const auto [x0, x1] =
      range(std::min({p[0].x(), p[1].x(), p[2].x()}), std::max({p[0].x(), p[1].x(), p[2].x()}), columns);
  const auto [y0, y1] = range(std::min({p[0].y(), p[1].y(), p[2].y()}), std::max({p[0].y(), p[1].y(), p[2].y()}), rows);

  std::array<double, 3> lengths;  // of the side that faces the corner
  double longest = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    lengths[k] = (p[(k + 2) % 3] - p[(k + 1) % 3]).norm();
    longest = std::max(longest, lengths[k]);
  }
  const double edge_width =
      std::min(triangle.edge_width * samples_,
               triangle.edge_opacity < 1.0f ? kLargestEdgeShare * std::abs(area) / longest : 1e300);

  std::array<Eigen::Vector3d, 3> normals = triangle.normals;
  const Eigen::Vector3d flat =
      (triangle.corners[1] - triangle.corners[0])
          .cwiseProduct(Eigen::Vector3d(1, -1, 1))
          .cross((triangle.corners[2] - triangle.corners[0]).cwiseProduct(Eigen::Vector3d(1, -1, 1)));
  for (Eigen::Vector3d& normal : normals) {
    if (normal.squaredNorm() == 0.0) normal = flat;
  }
  const bool is_uniform = normals[0] == normals[1] && normals[0] == normals[2];
  const Light uniform = triangle.is_lit ? light_on(normals[0]) : Light{};

  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const Eigen::Vector2d point(x + 0.5, y + 0.5);
      std::array<double, 3> b;  // barycentric
      for (std::size_t k = 0; k < 3; ++k) b[k] = cross(p[(k + 1) % 3] - point, p[(k + 2) % 3] - point) / area;
      if (b[0] < 0.0 || b[1] < 0.0 || b[2] < 0.0) continue;
      const auto depth = static_cast<float>(b[0] * triangle.corners[0].z() + b[1] * triangle.corners[1].z() +
                                            b[2] * triangle.corners[2].z());
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(x);
      if (depth <= depths_[at]) continue;
      depths_[at] = depth;

      // Perspective: attributes are linear on the triangle, not in the picture.
      std::array<double, 3> w = {b[0] * triangle.weights[0], b[1] * triangle.weights[1], b[2] * triangle.weights[2]};
      const double sum = w[0] + w[1] + w[2];
      for (double& weight : w) weight /= sum;
      Rgb colour = triangle.colour;
      if (triangle.is_textured) {
        const Eigen::Vector2d uv = w[0] * triangle.uv[0] + w[1] * triangle.uv[1] + w[2] * triangle.uv[2];
        if (uv.allFinite()) {
          const double parity = std::floor(uv.x()) + std::floor(uv.y());
          colour = kCheckColours[std::fmod(std::abs(parity), 2.0) == 1.0 ? 1 : 0];
        }
      }
      if (triangle.is_lit) {
        const Light light = is_uniform ? uniform : light_on(w[0] * normals[0] + w[1] * normals[1] + w[2] * normals[2]);
        colour = colour * static_cast<float>(light.factor) + Rgb::Constant(static_cast<float>(light.highlight));
      }
      if (edge_width > 0.0) {
        double distance = 1e300;
        for (std::size_t k = 0; k < 3; ++k) distance = std::min(distance, b[k] * std::abs(area) / lengths[k]);
        if (distance < edge_width) {
          colour = (1.0f - triangle.edge_opacity) * colour + triangle.edge_opacity * triangle.edge_colour;
        }
      }
      shades_[at] = packed(colour);
    }
  }
}

std::vector<std::uint32_t> Raster::pixels() const {
  std::vector<std::uint32_t> pixels;
  pixels.reserve(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
  const std::size_t columns = static_cast<std::size_t>(width_) * static_cast<std::size_t>(samples_);
  const auto count = static_cast<std::uint32_t>(samples_ * samples_);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      std::array<std::uint32_t, 4> sums = {};
      for (int j = 0; j < samples_; ++j) {
        const std::size_t row = static_cast<std::size_t>(y * samples_ + j) * columns;
        for (int i = 0; i < samples_; ++i) {
          const std::uint32_t shade = shades_[row + static_cast<std::size_t>(x * samples_ + i)];
          for (std::size_t k = 0; k < 4; ++k) sums[k] += shade >> (8 * k) & 255u;
        }
      }
      std::uint32_t pixel = 0;
      for (std::size_t k = 0; k < 4; ++k) pixel |= (sums[k] + count / 2) / count << (8 * k);
      pixels.push_back(pixel);
    }
  }
  return pixels;
}

bool Raster::is_visible(const Eigen::Vector3d& point, double slack) const {
  if (!point.allFinite()) return false;
  const double x = std::floor(point.x() * samples_);
  const double y = std::floor(point.y() * samples_);
  const int columns = width_ * samples_;
  const int rows = height_ * samples_;
  if (x < 0 || y < 0 || x >= columns || y >= rows) return true;
  for (int j = std::max(0, static_cast<int>(y) - 1); j <= std::min(rows - 1, static_cast<int>(y) + 1); ++j) {
    for (int i = std::max(0, static_cast<int>(x) - 1); i <= std::min(columns - 1, static_cast<int>(x) + 1); ++i) {
      const std::size_t at =
          static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(i);
      if (point.z() + slack >= static_cast<double>(depths_[at])) return true;
    }
  }
  return false;
}

}  // namespace variform
