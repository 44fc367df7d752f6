// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "framework/domain/io/reader.h"
#include "framework/domain/mesh_io.h"

namespace variform::io {

/// Collects what a reader finds and checks what all formats have in common: finite coordinates, indices in range,
/// polygons, at least one cell.
class MeshBuilder {
 public:
  /// Errors point at the token that the reader read last when a thing was added.
  MeshBuilder(const Reader& reader, const ReadOptions& options) : reader_(reader), options_(options) {}

  /// The number of the first vertex in cells: 0 (the default) or 1.
  void set_index_base(std::int64_t base) { index_base_ = base; }
  /// Coordinates per vertex, 3 (the default) or 2.
  void set_dimension(int dimension) { dimension_ = dimension; }

  void add_vertex(double x, double y, double z = 0.0);
  void add_uv(double u, double v);
  /// A triangle, or a polygon that is split or refused as the options say; with the number of a uv, from the same base,
  /// at each corner, or none.
  void add_polygon(std::span<const std::int64_t> corners, std::span<const std::int64_t> uv_corners = {});
  void add_tetrahedron(std::span<const std::int64_t> corners);
  /// Counts things that are not read, for example "hexahedra".
  void ignore(const std::string& things, std::int64_t count = 1) {
    if (count > 0) ignored_[things] += count;
  }

  std::int64_t vertex_count() const { return static_cast<std::int64_t>(coordinates_.size()) / dimension_; }
  std::int64_t uv_count() const { return static_cast<std::int64_t>(uv_.size()) / 2; }

  /// The tetrahedra where there are any, else the triangles.
  MeshFile finish() const;

 private:
  struct Cells {
    std::vector<std::int64_t> corners;
    std::vector<std::size_t> offsets;  ///< where in the file each cell was, for errors
  };

  /// The cells as a table of indices in [0, count) of a thing: "vertex" or "texture coordinate".
  IndexMatrix checked(const Cells& cells, int size, std::string_view thing, std::int64_t count) const;

  const Reader& reader_;
  ReadOptions options_;
  std::int64_t index_base_ = 0;
  int dimension_ = 3;
  std::vector<double> coordinates_;
  std::vector<double> uv_;
  Cells triangles_;
  Cells uv_triangles_;
  Cells tetrahedra_;
  std::map<std::string, std::int64_t> ignored_;
  std::int64_t split_polygons_ = 0;
  /// The first polygon that was refused: an error unless there are tetrahedra.
  std::optional<std::size_t> refused_offset_;
  std::size_t refused_size_ = 0;
};

}  // namespace variform::io
