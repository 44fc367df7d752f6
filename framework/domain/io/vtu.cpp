// SPDX-License-Identifier: BSD-3-Clause
// VTK XML unstructured grids. Read: ASCII, base64 inline or appended, packed by zlib or not. Written: base64 inline,
// and collections of them in time.
#include <fmt/format.h>
#include <pugixml.hpp>

#include <sstream>
#include <type_traits>

#include "framework/base/error.h"
#include "framework/domain/io/base64.h"
#include "framework/domain/io/compression.h"
#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

enum CellType : std::int64_t { kTriangle = 5, kPolygon = 7, kPixel = 8, kQuad = 9, kTetrahedron = 10 };

/// True when <AppendedData> has encoding="raw": bytes that are not XML.
bool has_raw_data(std::string_view content) {
  const std::size_t begin = content.find("<AppendedData");
  if (begin == std::string_view::npos) return false;
  const std::string_view tag = content.substr(begin, content.find('>', begin) - begin);
  return tag.find("raw") != std::string_view::npos;
}

class VtuReader {
 public:
  VtuReader(Reader& reader, MeshBuilder& builder) : reader_(reader), builder_(builder) {}

  void read() {
    const pugi::xml_node grid = parse();
    int pieces = 0;
    for (const pugi::xml_node piece : grid.children("Piece")) {
      read_piece(piece);
      ++pieces;
    }
    if (pieces == 0) fail(grid, "no <Piece>", "at least one");
  }

 private:
  /// Reads the file down to the grid.
  pugi::xml_node parse() {
    const std::string_view content = reader_.content();
    if (has_raw_data(content)) {
      reader_.fail_at(content.find("<AppendedData"), "raw appended data", "ASCII or base64 data");
    }
    // No conversions: offsets are those in the file.
    const pugi::xml_parse_result result =
        document_.load_buffer(content.data(), content.size(), pugi::parse_minimal, pugi::encoding_utf8);
    if (!result) {
      reader_.fail_at(static_cast<std::size_t>(result.offset), fmt::format("broken XML ({})", result.description()),
                      "a VTK XML file");
    }
    const pugi::xml_node root = child(document_, "VTKFile");
    const std::string_view type = root.attribute("type").value();
    if (type != "UnstructuredGrid") fail(root, fmt::format("a file of type '{}'", type), "'UnstructuredGrid'");

    const std::string_view order = root.attribute("byte_order").as_string("LittleEndian");
    if (order != "LittleEndian" && order != "BigEndian") {
      fail(root, fmt::format("byte_order '{}'", order), "LittleEndian or BigEndian");
    }
    order_ = order == "LittleEndian" ? std::endian::little : std::endian::big;

    const std::string_view header = root.attribute("header_type").as_string("UInt32");
    if (header != "UInt32" && header != "UInt64") {
      fail(root, fmt::format("header_type '{}'", header), "UInt32 or UInt64");
    }
    has_long_header_ = header == "UInt64";

    const std::string_view compressor = root.attribute("compressor").value();
    if (!compressor.empty() && compressor != "vtkZLibDataCompressor") {
      fail(root, fmt::format("compressor '{}'", compressor), "vtkZLibDataCompressor or none");
    }
    is_compressed_ = !compressor.empty();
    appended_ = root.child("AppendedData");
    return child(root, "UnstructuredGrid");
  }

  void read_piece(const pugi::xml_node& piece) {
    const std::int64_t first = builder_.vertex_count();
    const std::int64_t point_count = integer_attribute(piece, "NumberOfPoints");
    const std::int64_t cell_count = integer_attribute(piece, "NumberOfCells");
    if (point_count == 0 && cell_count == 0) return;

    const pugi::xml_node points = child(child(piece, "Points"), "DataArray");
    const auto coordinates = values<double>(points);
    if (coordinates.size() % 3 != 0 || static_cast<std::int64_t>(coordinates.size() / 3) != point_count) {
      fail(points, fmt::format("{} coordinates", coordinates.size()),
           fmt::format("3 for each of {} points", point_count));
    }
    at(points);
    for (std::size_t i = 0; i < coordinates.size(); i += 3) {
      builder_.add_vertex(coordinates[i], coordinates[i + 1], coordinates[i + 2]);
    }

    const pugi::xml_node cells = child(piece, "Cells");
    const pugi::xml_node connectivity_node = array(cells, "connectivity");
    const auto connectivity = values<std::int64_t>(connectivity_node);
    const auto offsets = integers(cells, "offsets", cell_count);
    const auto types = integers(cells, "types", cell_count);
    at(connectivity_node);
    std::vector<std::int64_t> corners;
    std::int64_t begin = 0;
    for (std::size_t i = 0; i < offsets.size(); ++i) {
      const std::int64_t end = offsets[i];
      if (end < begin || end > static_cast<std::int64_t>(connectivity.size())) {
        fail(array(cells, "offsets"), fmt::format("offset {} of cell {}", end, i),
             fmt::format("{} to {}", begin, connectivity.size()));
      }
      corners.assign(connectivity.begin() + begin, connectivity.begin() + end);
      for (std::int64_t& corner : corners) {
        if (corner < 0 || corner >= point_count) {
          fail(connectivity_node, fmt::format("vertex index {} in cell {}", corner, i),
               fmt::format("0 to {}", point_count - 1));
        }
        corner += first;
      }
      add_cell(cells, types[i], i, corners);
      begin = end;
    }
  }

  void add_cell(const pugi::xml_node& cells, std::int64_t type, std::size_t i, std::vector<std::int64_t>& corners) {
    const auto require_corners = [&](std::size_t n) {
      if (corners.size() != n) {
        fail(array(cells, "offsets"), fmt::format("{} corners of cell {} of type {}", corners.size(), i, type),
             fmt::format("{}", n));
      }
    };
    switch (type) {
      case kTriangle: require_corners(3); return builder_.add_polygon(corners);
      case kPixel:
        require_corners(4);
        std::swap(corners[2], corners[3]);
        return builder_.add_polygon(corners);
      case kQuad: require_corners(4); return builder_.add_polygon(corners);
      case kPolygon: return builder_.add_polygon(corners);
      case kTetrahedron: require_corners(4); return builder_.add_tetrahedron(corners);
      default: return builder_.ignore(fmt::format("cells of VTK type {}", type));
    }
  }

  pugi::xml_node child(const pugi::xml_node& parent, const char* name) const {
    const pugi::xml_node node = parent.child(name);
    if (!node) fail(parent, fmt::format("no <{}>", name), "one");
    return node;
  }

  pugi::xml_node array(const pugi::xml_node& parent, const char* name) const {
    const pugi::xml_node node = parent.find_child_by_attribute("DataArray", "Name", name);
    if (!node) fail(parent, fmt::format("no <DataArray Name=\"{}\">", name), "one");
    return node;
  }

  std::int64_t integer_attribute(const pugi::xml_node& node, const char* name) const {
    const std::string_view text = node.attribute(name).value();
    std::int64_t value = 0;
    if (!parse_number(text, value) || value < 0) fail(node, fmt::format("{}=\"{}\"", name, text), "a count");
    return value;
  }

  std::vector<std::int64_t> integers(const pugi::xml_node& cells, const char* name, std::int64_t count) const {
    auto result = values<std::int64_t>(array(cells, name));
    if (static_cast<std::int64_t>(result.size()) != count) {
      fail(array(cells, name), fmt::format("{} {}", result.size(), name), fmt::format("{}", count));
    }
    return result;
  }

  /// The values of a <DataArray>. T is double or std::int64_t.
  template <class T>
  std::vector<T> values(const pugi::xml_node& node) const {
    const std::string_view format = node.attribute("format").as_string("ascii");
    if (format == "ascii") return ascii_values<T>(node);
    if (format == "binary") return binary_values<T>(node, Base64Decoder(text_of(node)), true);
    if (format == "appended") {
      const std::string_view text = text_of(appended_);
      const std::size_t begin = text.find('_') + 1;
      const auto offset = static_cast<std::uint64_t>(integer_attribute(node, "offset"));
      if (begin == 0 || offset > text.size() - begin) {
        fail(node, fmt::format("offset {}", offset), "an offset in <AppendedData>, which starts with '_'");
      }
      return binary_values<T>(node, Base64Decoder(text.substr(begin + offset)), false);
    }
    fail(node, fmt::format("format '{}'", format), "ascii, binary or appended");
  }

  template <class T>
  std::vector<T> ascii_values(const pugi::xml_node& node) const {
    std::vector<T> result;
    const pugi::xml_node text = text_node(node);
    if (!text) return result;
    Reader part = reader_.part(static_cast<std::size_t>(text.offset_debug()), std::string_view(text.value()).size(),
                               {.free_form = true});
    while (!part.peek().empty()) result.push_back(part.number<T>(std::is_integral_v<T> ? "an integer" : "a number"));
    return result;
  }

  template <class T>
  std::vector<T> binary_values(const pugi::xml_node& node, Base64Decoder decoder, bool is_whole) const {
    const std::string data = is_compressed_ ? compressed_bytes(node, decoder) : plain_bytes(node, decoder);
    if (is_whole && !decoder.at_end()) fail(node, "more base64 data than its header tells", "its end");
    const std::string_view type = node.attribute("type").value();
    if (type == "Int8") return converted<T, std::int8_t>(node, data);
    if (type == "UInt8") return converted<T, std::uint8_t>(node, data);
    if (type == "Int16") return converted<T, std::int16_t>(node, data);
    if (type == "UInt16") return converted<T, std::uint16_t>(node, data);
    if (type == "Int32") return converted<T, std::int32_t>(node, data);
    if (type == "UInt32") return converted<T, std::uint32_t>(node, data);
    if (type == "Int64") return converted<T, std::int64_t>(node, data);
    if (type == "UInt64") return converted<T, std::uint64_t>(node, data);
    if constexpr (std::is_floating_point_v<T>) {
      if (type == "Float32") return converted<T, float>(node, data);
      if (type == "Float64") return converted<T, double>(node, data);
    }
    fail(node, fmt::format("type '{}'", type), std::is_integral_v<T> ? "an integer type" : "a number type");
  }

  template <class T, class Stored>
  std::vector<T> converted(const pugi::xml_node& node, const std::string& data) const {
    if (data.size() % sizeof(Stored) != 0) {
      fail(node, fmt::format("{} bytes of data", data.size()), fmt::format("a multiple of {}", sizeof(Stored)));
    }
    Reader bytes("", data);
    std::vector<T> result(data.size() / sizeof(Stored));
    for (T& value : result) value = static_cast<T>(bytes.binary<Stored>(order_, ""));
    return result;
  }

  /// Layout: size, data.
  std::string plain_bytes(const pugi::xml_node& node, Base64Decoder& decoder) const {
    return decoded(node, decoder, header_value(node, decoder));
  }

  /// Layout: number of blocks, size of an unpacked block, that of the last one when it is not full, packed sizes;
  /// blocks.
  std::string compressed_bytes(const pugi::xml_node& node, Base64Decoder& decoder) const {
    const std::uint64_t blocks = header_value(node, decoder);
    const std::uint64_t block_size = header_value(node, decoder);
    const std::uint64_t last_size = header_value(node, decoder);
    std::vector<std::uint64_t> packed_sizes;
    for (std::uint64_t i = 0; i < blocks; ++i) packed_sizes.push_back(header_value(node, decoder));

    std::string data;
    for (std::uint64_t i = 0; i < blocks; ++i) {
      const std::uint64_t size = i + 1 == blocks && last_size > 0 ? last_size : block_size;
      const std::string packed = decoded(node, decoder, packed_sizes[i]);
      const std::size_t before = data.size();
      const bool is_good =
          decompress(packed, Compression::zlib, data, before + std::min<std::uint64_t>(size, data.max_size() - before));
      if (!is_good || data.size() - before != size) {
        fail(node, fmt::format("damaged packed data in block {}", i), fmt::format("zlib data of {} bytes", size));
      }
    }
    return data;
  }

  std::uint64_t header_value(const pugi::xml_node& node, Base64Decoder& decoder) const {
    const std::string bytes = decoded(node, decoder, has_long_header_ ? sizeof(std::uint64_t) : sizeof(std::uint32_t));
    Reader reader("", bytes);
    return has_long_header_ ? reader.binary<std::uint64_t>(order_, "") : reader.binary<std::uint32_t>(order_, "");
  }

  std::string decoded(const pugi::xml_node& node, Base64Decoder& decoder, std::uint64_t size) const {
    if (auto bytes = decoder.read(size)) return *std::move(bytes);
    fail(node, "broken or truncated base64 data", fmt::format("{} more bytes", size));
  }

  static pugi::xml_node text_node(const pugi::xml_node& node) {
    return node.find_child([](const pugi::xml_node& text) { return text.type() == pugi::node_pcdata; });
  }
  static std::string_view text_of(const pugi::xml_node& node) { return text_node(node).value(); }

  static std::size_t offset_of(const pugi::xml_node& node) {
    return static_cast<std::size_t>(std::max<std::ptrdiff_t>(node.offset_debug(), 0));
  }
  [[noreturn]] void fail(const pugi::xml_node& node, std::string_view found, std::string_view expected) const {
    const std::string place = node.type() == pugi::node_element ? fmt::format(" in <{}>", node.name()) : "";
    reader_.fail_at(offset_of(node), fmt::format("{}{}", found, place), expected);
  }
  /// Lets errors of the builder point at this node.
  void at(const pugi::xml_node& node) { reader_ = reader_.part(offset_of(node), 0, {}); }

  Reader& reader_;
  MeshBuilder& builder_;
  pugi::xml_document document_;
  pugi::xml_node appended_;
  std::endian order_ = std::endian::little;
  bool has_long_header_ = false;
  bool is_compressed_ = false;
};

void read(Reader& reader, MeshBuilder& builder) { VtuReader(reader, builder).read(); }

template <class T>
constexpr const char* type_name_of() {
  if constexpr (std::is_same_v<T, double>) return "Float64";
  if constexpr (std::is_same_v<T, Index>) return "Int32";
  if constexpr (std::is_same_v<T, std::int64_t>) return "Int64";
  return "UInt8";
}

/// Appends a <DataArray> of the numbers of a range.
template <class T, class Range>
void append_array(pugi::xml_node parent, const std::string& name, Index columns, const Range& numbers) {
  std::string data;
  for (const auto number : numbers) append_little_endian(data, static_cast<T>(number));
  std::string bytes;
  append_little_endian(bytes, static_cast<std::uint64_t>(data.size()));

  pugi::xml_node node = parent.append_child("DataArray");
  node.append_attribute("type") = type_name_of<T>();
  node.append_attribute("Name") = name.c_str();
  node.append_attribute("NumberOfComponents") = columns;
  node.append_attribute("format") = "binary";
  node.text() = base64_encode(bytes + data).c_str();
}

void append_fields(pugi::xml_node parent, const std::vector<MeshField>& fields, MeshField::On on) {
  for (const MeshField& field : fields) {
    if (field.on == on) {
      append_array<double>(parent, field.name, static_cast<Index>(field.values.cols()),
                           field.values.reshaped<Eigen::RowMajor>());
    }
  }
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& fields) {
  pugi::xml_document document;
  pugi::xml_node root = document.append_child("VTKFile");
  root.append_attribute("type") = "UnstructuredGrid";
  root.append_attribute("version") = "1.0";
  root.append_attribute("byte_order") = "LittleEndian";
  root.append_attribute("header_type") = "UInt64";
  pugi::xml_node piece = root.append_child("UnstructuredGrid").append_child("Piece");
  piece.append_attribute("NumberOfPoints") = mesh.vertex_count();
  piece.append_attribute("NumberOfCells") = mesh.cell_count();

  append_fields(piece.append_child("PointData"), fields, MeshField::On::vertices);
  append_fields(piece.append_child("CellData"), fields, MeshField::On::cells);

  std::vector<double> coordinates;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto point = position(mesh, v);
    coordinates.insert(coordinates.end(), point.begin(), point.end());
  }
  append_array<double>(piece.append_child("Points"), "Points", 3, coordinates);

  const auto corners = static_cast<Index>(mesh.cells.cols());
  const std::vector<std::int64_t> types(mesh.cell_count(), corners == 4 ? kTetrahedron : kTriangle);
  std::vector<std::int64_t> offsets(mesh.cell_count());
  for (std::size_t i = 0; i < offsets.size(); ++i) offsets[i] = corners * (static_cast<std::int64_t>(i) + 1);
  pugi::xml_node cells = piece.append_child("Cells");
  append_array<Index>(cells, "connectivity", 1, mesh.cells.reshaped<Eigen::RowMajor>());
  append_array<std::int64_t>(cells, "offsets", 1, offsets);
  append_array<std::uint8_t>(cells, "types", 1, types);

  std::ostringstream out;
  document.save(out, "  ");
  return out.str();
}

}  // namespace

Format vtu_format() {
  return {.extension = ".vtu", .read = &read, .write = &write, .holds_tetrahedra = true, .holds_fields = true};
}

}  // namespace variform::io

namespace variform {

void write_pvd(const std::filesystem::path& path, const std::vector<std::pair<double, std::string>>& files) {
  pugi::xml_document document;
  pugi::xml_node root = document.append_child("VTKFile");
  root.append_attribute("type") = "Collection";
  root.append_attribute("version") = "1.0";
  root.append_attribute("byte_order") = "LittleEndian";
  pugi::xml_node collection = root.append_child("Collection");
  for (const auto& [time, file] : files) {
    pugi::xml_node entry = collection.append_child("DataSet");
    entry.append_attribute("timestep") = fmt::format("{}", time).c_str();
    entry.append_attribute("part") = 0;
    entry.append_attribute("file") = file.c_str();
  }
  std::ostringstream out;
  document.save(out, "  ");
  write_file(path, out.str());
}

}  // namespace variform
