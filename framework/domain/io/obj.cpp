// SPDX-License-Identifier: BSD-3-Clause
// Wavefront OBJ: vertices, texture coordinates and faces; all other statements are skipped.
#include <fmt/format.h>

#include <iterator>

#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

void read_vertex(Reader& reader, MeshBuilder& builder) {
  const double x = reader.number<double>("coordinate x of a vertex");
  const double y = reader.number<double>("coordinate y of a vertex");
  const double z = reader.number<double>("coordinate z of a vertex");
  builder.add_vertex(x, y, z);

  int extra = 0;
  for (; !reader.peek().empty(); ++extra) reader.number<double>("a weight or colour of a vertex");
  if (extra == 2 || extra > 4) {
    reader.fail(fmt::format("{} numbers for a vertex", 3 + extra),
                "3 coordinates, then a weight or a colour or neither");
  }
}

void read_texture_coordinates(Reader& reader, MeshBuilder& builder) {
  const double u = reader.number<double>("texture coordinate u");
  const double v = reader.peek().empty() ? 0.0 : reader.number<double>("texture coordinate v");
  builder.add_uv(u, v);
  if (!reader.peek().empty()) reader.number<double>("texture coordinate w");
  reader.end_line();
}

constexpr std::int64_t kNone = 0;  // indices count from 1

/// An index counted from 1; negative ones count back from the latest of `count` things.
std::int64_t absolute(const Reader& reader, std::string_view token, std::int64_t index, std::int64_t count,
                      std::string_view thing) {
  if (index >= 0) return index;
  if (index < -count) {
    reader.fail_token(token, count == 0 ? fmt::format("a positive {} index", thing)
                                        : fmt::format("a {} index from {} to -1 or a positive one", thing, -count));
  }
  return count + 1 + index;
}

struct Corner {
  std::int64_t vertex;
  std::int64_t uv;  ///< kNone when there is none
};

/// "v", "v/vt", "v//vn" or "v/vt/vn".
Corner read_corner(Reader& reader, const MeshBuilder& builder) {
  const std::string_view token = reader.token();
  const std::size_t slash = std::min(token.find('/'), token.size());
  const std::string_view rest = token.substr(std::min(slash + 1, token.size()));
  const std::string_view second = rest.substr(0, rest.find('/'));
  std::int64_t vertex = 0;
  std::int64_t uv = 0;
  if (!parse_number(token.substr(0, slash), vertex) || (!second.empty() && !parse_number(second, uv)) ||
      rest.find_first_not_of("/-0123456789") != std::string_view::npos) {
    reader.fail_token(token, "a corner of a face such as 1, 1/2, 1//3 or 1/2/3");
  }
  if (!second.empty() && uv == kNone) reader.fail_token(token, "a texture coordinate index from 1");
  return {absolute(reader, token, vertex, builder.vertex_count(), "vertex"),
          absolute(reader, token, uv, builder.uv_count(), "texture coordinate")};
}

void read(Reader& reader, MeshBuilder& builder) {
  reader.set_syntax({.comment = '#', .continuation = true});
  builder.set_index_base(1);
  std::vector<std::int64_t> corners;
  std::vector<std::int64_t> uv_corners;
  while (reader.next_line()) {
    const std::string_view statement = reader.token();
    if (statement == "v") {
      read_vertex(reader, builder);
    } else if (statement == "vt") {
      read_texture_coordinates(reader, builder);
    } else if (statement == "f") {
      corners.clear();
      uv_corners.clear();
      while (!reader.peek().empty()) {
        const Corner corner = read_corner(reader, builder);
        corners.push_back(corner.vertex);
        if (corner.uv != kNone) uv_corners.push_back(corner.uv);
      }
      if (uv_corners.size() < corners.size()) uv_corners.clear();
      builder.add_polygon(corners, uv_corners);
    } else {
      while (!reader.token().empty()) {
      }
    }
  }
}

void write_positions(std::string& out, const Mesh& mesh) {
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto [x, y, z] = position(mesh, v);
    fmt::format_to(std::back_inserter(out), "v {} {} {}\n", x, y, z);
  }
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& /*fields*/) {
  std::string out;
  write_positions(out, mesh);
  for (const auto cell : mesh.cells.rowwise()) {
    fmt::format_to(std::back_inserter(out), "f {} {} {}\n", cell(0) + 1, cell(1) + 1, cell(2) + 1);
  }
  return out;
}

}  // namespace

Format obj_format() { return {.extension = ".obj", .read = &read, .write = &write}; }

std::string obj_with_uv(const Mesh& mesh, const Matrix& uv, const IndexMatrix& uv_cells) {
  std::string out;
  write_positions(out, mesh);
  for (const auto point : uv.rowwise()) {
    fmt::format_to(std::back_inserter(out), "vt {} {}\n", point(0), point(1));
  }
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    out += 'f';
    for (int i = 0; i < 3; ++i) {
      fmt::format_to(std::back_inserter(out), " {}/{}", mesh.cells(t, i) + 1, uv_cells(t, i) + 1);
    }
    out += '\n';
  }
  return out;
}

}  // namespace variform::io
