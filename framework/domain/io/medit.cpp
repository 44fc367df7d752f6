// SPDX-License-Identifier: BSD-3-Clause
// Medit .mesh, ASCII, of dimension 2 or 3. Sections other than vertices and cells are skipped.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cctype>
#include <iterator>

#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

bool is_name(std::string_view token) {
  return !token.empty() && std::isalpha(static_cast<unsigned char>(token.front())) != 0;
}

/// Sections of unknown layout end at the next name.
void skip_section(Reader& reader, MeshBuilder& builder, std::string_view section) {
  std::int64_t count = 0;
  const bool is_table = parse_number(reader.peek(), count);
  builder.ignore(fmt::format("'{}'", section), is_table ? count : 1);
  while (!reader.peek().empty() && !is_name(reader.peek())) reader.token();
}

/// Reads rows of indices and a reference.
template <class Add>
void read_cells(Reader& reader, std::string_view name, std::size_t size, const Add& add) {
  std::vector<std::int64_t> corners(size);
  const Index count = reader.count(name, 2 * (size + 1));
  for (Index i = 0; i < count; ++i) {
    for (std::int64_t& corner : corners) corner = reader.number<std::int64_t>("a vertex index");
    add(corners);
    reader.number<std::int64_t>("the reference of a cell");
  }
}

void read_vertices(Reader& reader, MeshBuilder& builder, int dimension) {
  const Index count = reader.count("vertices", 2 * (static_cast<std::size_t>(dimension) + 1));
  for (Index i = 0; i < count; ++i) {
    const double x = reader.number<double>("coordinate x of a vertex");
    const double y = reader.number<double>("coordinate y of a vertex");
    const double z = dimension == 3 ? reader.number<double>("coordinate z of a vertex") : 0.0;
    builder.add_vertex(x, y, z);
    reader.number<std::int64_t>("the reference of a vertex");
  }
}

int read_dimension(Reader& reader) {
  const std::string_view token = reader.token();
  if (token == "2") return 2;
  if (token == "3") return 3;
  reader.fail_token(token, "2 or 3");
}

void read(Reader& reader, MeshBuilder& builder) {
  reader.set_syntax({.comment = '#', .free_form = true});
  builder.set_index_base(1);
  reader.expect("MeshVersionFormatted");
  reader.number<std::int64_t>("the version of the format");
  reader.expect("Dimension");
  const int dimension = read_dimension(reader);
  builder.set_dimension(dimension);

  std::string_view section = reader.token();
  while (section != "End" && !section.empty()) {
    if (!is_name(section)) reader.fail_token(section, "the name of a section such as 'Vertices'");
    if (section == "Vertices") {
      if (builder.vertex_count() > 0) reader.fail_token(section, "vertices only once");
      read_vertices(reader, builder, dimension);
    } else if (section == "Triangles") {
      read_cells(reader, "triangles", 3, [&](const auto& corners) { builder.add_polygon(corners); });
    } else if (section == "Quadrilaterals") {
      read_cells(reader, "quadrilaterals", 4, [&](const auto& corners) { builder.add_polygon(corners); });
    } else if (section == "Tetrahedra" && dimension == 3) {
      read_cells(reader, "tetrahedra", 4, [&](const auto& corners) { builder.add_tetrahedron(corners); });
    } else {
      skip_section(reader, builder, section);
    }
    section = reader.token();
  }
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& /*fields*/) {
  std::string out =
      fmt::format("MeshVersionFormatted 2\nDimension {}\nVertices\n{}\n", mesh.positions.cols(), mesh.vertex_count());
  for (const auto point : mesh.positions.rowwise()) {
    fmt::format_to(std::back_inserter(out), "{} 0\n", fmt::join(point.begin(), point.end(), " "));
  }
  fmt::format_to(std::back_inserter(out), "{}\n{}\n", mesh.cells.cols() == 4 ? "Tetrahedra" : "Triangles",
                 mesh.cell_count());
  for (const auto cell : mesh.cells.rowwise()) {
    for (const Index v : cell) fmt::format_to(std::back_inserter(out), "{} ", v + 1);
    out += "0\n";
  }
  return out + "End\n";
}

}  // namespace

Format medit_format() { return {.extension = ".mesh", .read = &read, .write = &write, .holds_tetrahedra = true}; }

}  // namespace variform::io
