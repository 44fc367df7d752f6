// SPDX-License-Identifier: BSD-3-Clause
// Stanford PLY, ASCII and binary. Written as little endian doubles, fields as further properties.
#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <optional>

#include "framework/base/error.h"
#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

enum class Type { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

struct TypeName {
  std::string_view name;
  Type type;
  std::size_t size;
};

constexpr TypeName kTypes[] = {
    {"char", Type::int8, 1},       {"int8", Type::int8, 1},       {"uchar", Type::uint8, 1},
    {"uint8", Type::uint8, 1},     {"short", Type::int16, 2},     {"int16", Type::int16, 2},
    {"ushort", Type::uint16, 2},   {"uint16", Type::uint16, 2},   {"int", Type::int32, 4},
    {"int32", Type::int32, 4},     {"uint", Type::uint32, 4},     {"uint32", Type::uint32, 4},
    {"float", Type::float32, 4},   {"float32", Type::float32, 4}, {"double", Type::float64, 8},
    {"float64", Type::float64, 8},
};

struct Property {
  std::string name;
  TypeName type;
  std::optional<TypeName> count_type;  ///< lists only
};

struct Element {
  std::string name;
  std::size_t header_offset = 0;
  std::int64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  std::optional<std::endian> binary;  ///< byte order; none in ASCII files
  std::vector<Element> elements;
};

TypeName read_type(Reader& reader) {
  const std::string_view token = reader.token();
  for (const TypeName& type : kTypes) {
    if (type.name == token) return type;
  }
  reader.fail_token(token, "a type such as float or uchar");
}

std::string read_name(Reader& reader, std::string_view what) {
  const std::string_view token = reader.token();
  if (token.empty()) reader.fail_token(token, what);
  return std::string(token);
}

Property read_property(Reader& reader) {
  Property property;
  if (reader.peek() == "list") {
    reader.token();
    property.count_type = read_type(reader);
  }
  property.type = read_type(reader);
  property.name = read_name(reader, "the name of a property");
  return property;
}

std::optional<std::endian> read_encoding(Reader& reader) {
  const std::string_view token = reader.token();
  if (token == "ascii") return std::nullopt;
  if (token == "binary_little_endian") return std::endian::little;
  if (token == "binary_big_endian") return std::endian::big;
  reader.fail_token(token, "ascii, binary_little_endian or binary_big_endian");
}

Header read_header(Reader& reader) {
  Header header;
  reader.expect("ply");
  reader.end_line();
  bool has_format = false;
  while (true) {
    reader.require_line("'end_header'");
    const std::string_view keyword = reader.token();
    if (keyword == "comment" || keyword == "obj_info") {
      reader.skip_line();
      continue;
    }
    if (keyword == "end_header") {
      if (!has_format) reader.fail_token(keyword, "'format' before it");
      reader.skip_line();
      if (header.binary) reader.start_binary();
      return header;
    }
    if (keyword == "format") {
      header.binary = read_encoding(reader);
      reader.expect("1.0");
      has_format = true;
    } else if (keyword == "element") {
      Element element;
      element.name = read_name(reader, "the name of an element");
      element.count = reader.number<std::int64_t>("the number of elements");
      element.header_offset = reader.offset();
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      if (header.elements.empty()) reader.fail_token(keyword, "'element' before the first property");
      header.elements.back().properties.push_back(read_property(reader));
    } else {
      reader.fail_token(keyword, "'element', 'property', 'comment' or 'end_header'");
    }
    reader.end_line();
  }
}

class PlyReader {
 public:
  PlyReader(Reader& reader, MeshBuilder& builder) : reader_(reader), builder_(builder), header_(read_header(reader)) {}

  void read() {
    for (const Element& element : header_.elements) {
      if (element.properties.empty()) continue;
      check_count(element);
      if (element.name == "vertex") {
        read_vertices(element);
      } else if (element.name == "face") {
        read_faces(element);
      } else {
        for (std::int64_t i = 0; i < element.count; ++i) read_row(element, i, nullptr, {});
        builder_.ignore(fmt::format("elements '{}'", element.name), element.count);
      }
    }
  }

 private:
  void check_count(const Element& element) const {
    std::size_t bytes = 0;
    for (const Property& property : element.properties) {
      bytes += header_.binary ? property.count_type.value_or(property.type).size : std::size_t{2};
    }
    if (element.count < 0 || static_cast<std::uint64_t>(element.count) > (reader_.remaining() + 1) / bytes) {
      reader_.fail_at(element.header_offset, fmt::format("{} elements '{}'", element.count, element.name),
                      fmt::format("0 to {}, which the rest of the file can hold", (reader_.remaining() + 1) / bytes));
    }
  }

  [[noreturn]] void fail_missing(const Element& element, std::string_view property) const {
    reader_.fail_at(element.header_offset, fmt::format("no {} in element '{}'", property, element.name), "one");
  }

  void read_vertices(const Element& element) {
    std::vector<double> row(element.properties.size());
    std::array<std::size_t, 3> columns{};
    for (std::size_t k = 0; k < columns.size(); ++k) {
      columns[k] = scalar_column(element, std::string_view("xyz").substr(k, 1));
    }
    for (std::int64_t i = 0; i < element.count; ++i) {
      read_row(element, i, nullptr, row);
      builder_.add_vertex(row[columns[0]], row[columns[1]], row[columns[2]]);
    }
  }

  std::size_t scalar_column(const Element& element, std::string_view name) const {
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      if (element.properties[k].name == name && !element.properties[k].count_type) return k;
    }
    fail_missing(element, fmt::format("scalar property '{}'", name));
  }

  void read_faces(const Element& element) {
    const Property* corners = nullptr;
    for (const Property& property : element.properties) {
      if ((property.name == "vertex_indices" || property.name == "vertex_index") && property.count_type) {
        corners = &property;
      }
    }
    if (corners == nullptr) fail_missing(element, "list property 'vertex_indices'");
    for (std::int64_t i = 0; i < element.count; ++i) {
      read_row(element, i, corners, {});
      builder_.add_polygon(corners_);
    }
  }

  /// Reads all properties of an element: scalars into row where it is not empty, the list `corners` into corners_.
  void read_row(const Element& element, std::int64_t i, const Property* corners, std::span<double> row) {
    if (!header_.binary) reader_.require_line(fmt::format("{} {} of {}", element.name, i + 1, element.count));
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      const Property& property = element.properties[k];
      if (property.count_type) {
        read_list(property, &property == corners);
      } else {
        const double value = scalar(property.type, property.name);
        if (!row.empty()) row[k] = value;
      }
    }
    if (!header_.binary) reader_.end_line();
  }

  void read_list(const Property& property, bool keep) {
    const std::int64_t size = integer(*property.count_type, "the length of a list");
    reader_.checked_count(size, fmt::format("entries of '{}'", property.name),
                          header_.binary ? property.type.size : std::size_t{2});
    if (keep) corners_.clear();
    for (std::int64_t i = 0; i < size; ++i) {
      if (keep) {
        corners_.push_back(integer(property.type, "a vertex index"));
      } else {
        scalar(property.type, property.name);
      }
    }
  }

  std::int64_t integer(const TypeName& type, std::string_view what) {
    constexpr double kMax = 4294967296.0;
    const double value = scalar(type, what);
    if (!(std::abs(value) <= kMax) || value != std::floor(value)) {
      reader_.fail(fmt::format("the number {}", value), what);
    }
    return static_cast<std::int64_t>(value);
  }

  /// A double holds the values of all types.
  double scalar(const TypeName& type, std::string_view what) {
    if (!header_.binary) return reader_.number<double>(what);
    switch (type.type) {
      case Type::int8: return reader_.binary<std::int8_t>(*header_.binary, what);
      case Type::uint8: return reader_.binary<std::uint8_t>(*header_.binary, what);
      case Type::int16: return reader_.binary<std::int16_t>(*header_.binary, what);
      case Type::uint16: return reader_.binary<std::uint16_t>(*header_.binary, what);
      case Type::int32: return reader_.binary<std::int32_t>(*header_.binary, what);
      case Type::uint32: return reader_.binary<std::uint32_t>(*header_.binary, what);
      case Type::float32: return reader_.binary<float>(*header_.binary, what);
      case Type::float64: break;
    }
    return reader_.binary<double>(*header_.binary, what);
  }

  Reader& reader_;
  MeshBuilder& builder_;
  Header header_;
  std::vector<std::int64_t> corners_;
};

void read(Reader& reader, MeshBuilder& builder) { PlyReader(reader, builder).read(); }

/// One property per column of each field on vertices or cells.
void append_field_header(std::string& out, const std::vector<MeshField>& fields, MeshField::On on) {
  for (const MeshField& field : fields) {
    if (field.on != on) continue;
    for (Index k = 0; k < field.values.cols(); ++k) {
      const std::string name = field.values.cols() == 1 ? field.name : fmt::format("{}_{}", field.name, k);
      const bool printable = std::all_of(name.begin(), name.end(), [](char c) { return c > ' ' && c <= '~'; });
      if (!printable || name == "x" || name == "y" || name == "z" || name.starts_with("vertex_ind")) {
        throw UsageError(
            fmt::format("field '{}' cannot be a property of a .ply file; expected a name without white "
                        "space other than x, y, z, vertex_index, vertex_indices",
                        field.name));
      }
      fmt::format_to(std::back_inserter(out), "property double {}\n", name);
    }
  }
}

void append_field_row(std::string& out, const std::vector<MeshField>& fields, MeshField::On on, Index row) {
  for (const MeshField& field : fields) {
    if (field.on != on) continue;
    for (const double value : field.values.row(row)) append_little_endian(out, value);
  }
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& fields) {
  std::string out = fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\n"
      "property double x\nproperty double y\nproperty double z\n",
      mesh.vertex_count());
  append_field_header(out, fields, MeshField::On::vertices);
  fmt::format_to(std::back_inserter(out), "element face {}\nproperty list uchar int vertex_indices\n",
                 mesh.cell_count());
  append_field_header(out, fields, MeshField::On::cells);
  out += "end_header\n";

  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    for (const double x : position(mesh, v)) append_little_endian(out, x);
    append_field_row(out, fields, MeshField::On::vertices, v);
  }
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    append_little_endian(out, std::uint8_t{3});
    for (const Index v : mesh.cells.row(c)) append_little_endian(out, v);
    append_field_row(out, fields, MeshField::On::cells, c);
  }
  return out;
}

}  // namespace

Format ply_format() { return {.extension = ".ply", .read = &read, .write = &write, .holds_fields = true}; }

}  // namespace variform::io
