// SPDX-License-Identifier: BSD-3-Clause
// Wavefront OBJ: vertices and faces; all other statements are skipped.
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

/// The vertex, counted from 1, of "v", "v/vt", "v//vn" or "v/vt/vn"; negative v count back from the latest vertex.
std::int64_t read_corner(Reader& reader, const MeshBuilder& builder) {
  const std::string_view token = reader.token();
  const std::size_t slash = std::min(token.find('/'), token.size());
  std::int64_t vertex = 0;
  if (!parse_number(token.substr(0, slash), vertex) ||
      token.find_first_not_of("/-0123456789", slash) != std::string_view::npos) {
    reader.fail_token(token, "a corner of a face such as 1, 1/2, 1//3 or 1/2/3");
  }
  if (vertex >= 0) return vertex;
  if (vertex < -builder.vertex_count()) {
    reader.fail_token(token, fmt::format("a vertex index from {} to -1 or a positive one", -builder.vertex_count()));
  }
  return builder.vertex_count() + 1 + vertex;
}

void read(Reader& reader, MeshBuilder& builder) {
  reader.set_syntax({.comment = '#', .continuation = true});
  builder.set_index_base(1);
  std::vector<std::int64_t> corners;
  while (reader.next_line()) {
    const std::string_view statement = reader.token();
    if (statement == "v") {
      read_vertex(reader, builder);
    } else if (statement == "f") {
      corners.clear();
      while (!reader.peek().empty()) corners.push_back(read_corner(reader, builder));
      builder.add_polygon(corners);
    } else {
      while (!reader.token().empty()) {
      }
    }
  }
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& /*fields*/) {
  std::string out;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto [x, y, z] = position(mesh, v);
    fmt::format_to(std::back_inserter(out), "v {} {} {}\n", x, y, z);
  }
  for (const auto cell : mesh.cells.rowwise()) {
    fmt::format_to(std::back_inserter(out), "f {} {} {}\n", cell(0) + 1, cell(1) + 1, cell(2) + 1);
  }
  return out;
}

}  // namespace

Format obj_format() { return {.extension = ".obj", .read = &read, .write = &write}; }

}  // namespace variform::io
