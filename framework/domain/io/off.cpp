// SPDX-License-Identifier: BSD-3-Clause
// Geomview OFF, ASCII, with optional texture coordinates, colours and normals, which are skipped.
#include <fmt/format.h>

#include <iterator>

#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

void read_header(Reader& reader) {
  reader.require_line("'OFF'");
  const std::string_view keyword = reader.token();
  std::string_view rest = keyword;
  for (const std::string_view prefix : {"ST", "C", "N"}) {
    if (rest.starts_with(prefix)) rest.remove_prefix(prefix.size());
  }
  if (rest != "OFF") reader.fail_token(keyword, "'OFF', with ST, C, N before it or not");
  if (reader.peek() == "BINARY") reader.fail_token(reader.token(), "a file in ASCII");
}

void read(Reader& reader, MeshBuilder& builder) {
  reader.set_syntax({.comment = '#'});
  read_header(reader);
  reader.require_line("the number of vertices");
  const Index vertices = reader.count("vertices", std::size_t{6});
  const Index faces = reader.count("faces", std::size_t{4});
  if (!reader.peek().empty()) reader.number<std::int64_t>("the number of edges");
  reader.end_line();

  for (Index i = 0; i < vertices; ++i) {
    reader.require_line(fmt::format("vertex {} of {}", i + 1, vertices));
    const double x = reader.number<double>("coordinate x of a vertex");
    const double y = reader.number<double>("coordinate y of a vertex");
    const double z = reader.number<double>("coordinate z of a vertex");
    builder.add_vertex(x, y, z);
    reader.skip_line();
  }
  std::vector<std::int64_t> corners;
  for (Index i = 0; i < faces; ++i) {
    reader.require_line(fmt::format("face {} of {}", i + 1, faces));
    corners.resize(reader.count("corners", std::size_t{2}));
    for (std::int64_t& corner : corners) corner = reader.number<std::int64_t>("a vertex index");
    builder.add_polygon(corners);
    reader.skip_line();
  }
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& /*fields*/) {
  std::string out = fmt::format("OFF\n{} {} 0\n", mesh.vertex_count(), mesh.cell_count());
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto [x, y, z] = position(mesh, v);
    fmt::format_to(std::back_inserter(out), "{} {} {}\n", x, y, z);
  }
  for (const auto cell : mesh.cells.rowwise()) {
    fmt::format_to(std::back_inserter(out), "3 {} {} {}\n", cell(0), cell(1), cell(2));
  }
  return out;
}

}  // namespace

Format off_format() { return {.extension = ".off", .read = &read, .write = &write}; }

}  // namespace variform::io
