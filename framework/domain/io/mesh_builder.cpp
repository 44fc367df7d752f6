// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/io/mesh_builder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include "framework/base/error.h"

namespace variform::io {
namespace {

constexpr int kTriangleSize = 3;
constexpr int kTetrahedronSize = 4;
constexpr std::string_view kVertex = "vertex";

}  // namespace

void MeshBuilder::add_vertex(double x, double y, double z) {
  if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(z)) {
    reader_.fail(fmt::format("coordinates ({}, {}, {})", x, y, z), "finite numbers");
  }
  coordinates_.push_back(x);
  coordinates_.push_back(y);
  if (dimension_ == 3) coordinates_.push_back(z);
}

void MeshBuilder::add_uv(double u, double v) {
  if (!std::isfinite(u) || !std::isfinite(v)) {
    reader_.fail(fmt::format("texture coordinates ({}, {})", u, v), "finite numbers");
  }
  uv_.insert(uv_.end(), {u, v});
}

void MeshBuilder::add_polygon(std::span<const std::int64_t> corners, std::span<const std::int64_t> uv_corners) {
  const std::size_t offset = reader_.offset();
  if (corners.size() < 3) {
    reader_.fail(fmt::format("a face with {} corners", corners.size()), "at least 3");
  }
  if (corners.size() > 3 && !options_.triangulate_polygons) {
    if (!refused_offset_) {
      refused_offset_ = offset;
      refused_size_ = corners.size();
    }
    return;
  }
  const auto add_fan = [offset](Cells& cells, std::span<const std::int64_t> fan) {
    for (std::size_t i = 1; i + 1 < fan.size(); ++i) {
      cells.corners.insert(cells.corners.end(), {fan[0], fan[i], fan[i + 1]});
      cells.offsets.push_back(offset);
    }
  };
  add_fan(triangles_, corners);
  add_fan(uv_triangles_, uv_corners);
  if (corners.size() > 3) ++split_polygons_;
}

void MeshBuilder::add_tetrahedron(std::span<const std::int64_t> corners) {
  tetrahedra_.corners.insert(tetrahedra_.corners.end(), corners.begin(), corners.end());
  tetrahedra_.offsets.push_back(reader_.offset());
}

IndexMatrix MeshBuilder::checked(const Cells& cells, int size, std::string_view thing, std::int64_t count) const {
  constexpr std::size_t kMaxCount = std::numeric_limits<Index>::max();
  const std::string things = thing == kVertex ? "vertices" : fmt::format("{}s", thing);
  if (cells.offsets.size() > kMaxCount || static_cast<std::size_t>(count) > kMaxCount) {
    throw DataError(fmt::format("{}: found {} {} and {} cells, expected at most {} of each", reader_.name(), count,
                                things, cells.offsets.size(), kMaxCount));
  }
  IndexMatrix table(static_cast<Index>(cells.offsets.size()), size);
  for (std::size_t i = 0; i < cells.corners.size(); ++i) {
    const std::int64_t corner = cells.corners[i];
    if (corner < index_base_ || corner >= index_base_ + count) {
      reader_.fail_at(cells.offsets[i / size], fmt::format("{} index {}", thing, corner),
                      count == 0 ? things : fmt::format("{} to {}", index_base_, index_base_ + count - 1));
    }
    table.data()[i] = static_cast<Index>(corner - index_base_);
  }
  return table;
}

MeshFile MeshBuilder::finish() const {
  MeshFile file;
  const bool tetrahedral = !tetrahedra_.offsets.empty();
  if (refused_offset_ && !tetrahedral) {
    reader_.fail_at(*refused_offset_, fmt::format("a face with {} corners", refused_size_),
                    "triangles (the option triangulate_polygons splits polygons)");
  }

  std::vector<std::string> ignored;
  for (const auto& [things, count] : ignored_) ignored.push_back(fmt::format("{} {}", count, things));

  file.mesh.cells = checked(triangles_, kTriangleSize, kVertex, vertex_count());
  if (tetrahedral) {
    if (file.mesh.cell_count() > 0) ignored.push_back(fmt::format("{} triangles", file.mesh.cell_count()));
    file.mesh.cells = checked(tetrahedra_, kTetrahedronSize, kVertex, vertex_count());
  }
  if (file.mesh.cell_count() == 0) {
    throw DataError(fmt::format("{}: found {} vertices{}, expected triangles or tetrahedra", reader_.name(),
                                vertex_count(), ignored.empty() ? "" : fmt::format(", {}", fmt::join(ignored, ", "))));
  }
  file.mesh.positions = Eigen::Map<const Matrix>(coordinates_.data(), static_cast<Index>(vertex_count()), dimension_);

  IndexMatrix uv_cells = checked(uv_triangles_, kTriangleSize, "texture coordinate", uv_count());
  if (uv_cells.rows() == file.mesh.cell_count() && !tetrahedral) {
    file.uv_cells = std::move(uv_cells);
    file.uv = Eigen::Map<const Matrix>(uv_.data(), static_cast<Index>(uv_count()), 2);
  }

  if (!ignored.empty()) file.warnings.push_back(fmt::format("ignored {}", fmt::join(ignored, ", ")));
  if (split_polygons_ > 0 && !tetrahedral) {
    file.warnings.push_back(fmt::format("split {} polygons into triangles", split_polygons_));
  }
  return file;
}

}  // namespace variform::io
