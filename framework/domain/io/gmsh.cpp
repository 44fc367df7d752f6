// SPDX-License-Identifier: BSD-3-Clause
// Gmsh .msh, versions 2.x and 4.1, ASCII and binary. Written as 4.1 ASCII.
#include <fmt/format.h>

#include <iterator>
#include <optional>
#include <unordered_map>

#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

struct ElementType {
  std::int64_t number;
  std::string_view things;
  int nodes;
};

constexpr std::int64_t kTriangle = 2;
constexpr std::int64_t kQuadrilateral = 3;
constexpr std::int64_t kTetrahedron = 4;

constexpr ElementType kElementTypes[] = {
    {1, "lines", 2},
    {kTriangle, "triangles", 3},
    {kQuadrilateral, "quadrilaterals", 4},
    {kTetrahedron, "tetrahedra", 4},
    {5, "hexahedra", 8},
    {6, "prisms", 6},
    {7, "pyramids", 5},
    {8, "second order lines", 3},
    {9, "second order triangles", 6},
    {10, "second order quadrilaterals", 9},
    {11, "second order tetrahedra", 10},
    {12, "second order hexahedra", 27},
    {13, "second order prisms", 18},
    {14, "second order pyramids", 14},
    {15, "points", 1},
    {16, "second order quadrilaterals", 8},
    {17, "second order hexahedra", 20},
    {18, "second order prisms", 15},
    {19, "second order pyramids", 13},
    {20, "third order triangles", 9},
    {21, "third order triangles", 10},
    {22, "fourth order triangles", 12},
    {23, "fourth order triangles", 15},
    {24, "fifth order triangles", 15},
    {25, "fifth order triangles", 21},
    {26, "third order lines", 4},
    {27, "fourth order lines", 5},
    {28, "fifth order lines", 6},
    {29, "third order tetrahedra", 20},
    {30, "fourth order tetrahedra", 35},
    {31, "fifth order tetrahedra", 56},
    {92, "third order hexahedra", 64},
    {93, "fourth order hexahedra", 125},
};

/// The values of sections, which are the same in ASCII and binary files.
class Values {
 public:
  Values(Reader& reader, std::optional<std::endian> binary) : reader_(reader), binary_(binary) {}

  bool is_binary() const { return binary_.has_value(); }

  std::int64_t integer(std::string_view what) {
    return binary_ ? reader_.binary<std::int32_t>(*binary_, what) : reader_.number<std::int64_t>(what);
  }
  /// Takes 8 bytes in binary files.
  std::int64_t long_integer(std::string_view what) {
    return binary_ ? reader_.binary<std::int64_t>(*binary_, what) : reader_.number<std::int64_t>(what);
  }
  double real(std::string_view what) {
    return binary_ ? reader_.binary<double>(*binary_, what) : reader_.number<double>(what);
  }

  /// Lines matter in ASCII files only.
  void begin_row(std::string_view expected) {
    if (!binary_) reader_.require_line(expected);
  }
  void end_row() {
    if (!binary_) reader_.end_line();
  }

 private:
  Reader& reader_;
  std::optional<std::endian> binary_;
};

class GmshReader {
 public:
  GmshReader(Reader& reader, MeshBuilder& builder) : reader_(reader), builder_(builder), values_(read_format()) {}

  void read() {
    while (reader_.next_line()) {
      const std::string_view section = reader_.token();
      if (!section.starts_with('$')) reader_.fail_token(section, "a section such as '$Nodes'");
      if (section == "$Nodes") {
        reader_.end_line();
        is_version_4_ ? read_nodes_4() : read_nodes_2();
      } else if (section == "$Elements") {
        reader_.end_line();
        is_version_4_ ? read_elements_4() : read_elements_2();
      } else {
        skip_section(section);
        continue;
      }
      reader_.require_line(end_of(section));
      reader_.expect(end_of(section));
    }
  }

 private:
  static std::string end_of(std::string_view section) { return fmt::format("$End{}", section.substr(1)); }

  void skip_section(std::string_view section) {
    if (!reader_.skip_past(end_of(section))) {
      reader_.fail(fmt::format("'{}' without its end", section), fmt::format("'{}'", end_of(section)));
    }
    reader_.skip_line();
  }

  Values read_format() {
    reader_.require_line("'$MeshFormat'");
    reader_.expect("$MeshFormat");
    reader_.end_line();
    reader_.require_line("the version of the format");
    const std::string_view version = reader_.token();
    is_version_4_ = version == "4.1";
    if (!is_version_4_ && version != "2" && !version.starts_with("2.")) {
      reader_.fail_token(version, "version 2.2 or 4.1");
    }
    const std::string_view type = reader_.token();
    if (type != "0" && type != "1") reader_.fail_token(type, "0 (ASCII) or 1 (binary)");
    const bool is_binary = type == "1";
    const auto size = reader_.number<std::int64_t>("the size of a number");
    if (is_binary && size != 8) reader_.fail(fmt::format("numbers of {} bytes", size), "8 bytes");
    reader_.end_line();
    reader_.skip_line();

    std::optional<std::endian> order;
    if (is_binary) {
      reader_.start_binary();
      order = std::endian::little;
      const auto one = reader_.binary<std::uint32_t>(*order, "the byte order");
      if (one == 0x01000000u) order = std::endian::big;
      if (one != 1 && one != 0x01000000u) reader_.fail(fmt::format("the number {}", one), "1 in some byte order");
    }
    reader_.require_line("'$EndMeshFormat'");
    reader_.expect("$EndMeshFormat");
    return {reader_, order};
  }

  /// The number of things at the head of a section of version 2, where it is ASCII in binary files, too.
  Index read_count_2(std::string_view things, std::size_t bytes) {
    reader_.require_line(fmt::format("the number of {}", things));
    const Index count = reader_.count(things, bytes);
    reader_.end_line();
    reader_.skip_line();
    return count;
  }

  void read_nodes_2() {
    const Index count = read_count_2("nodes", values_.is_binary() ? kBinaryNodeSize : std::size_t{8});
    vertices_.reserve(count);
    for (Index i = 0; i < count; ++i) {
      values_.begin_row("a node");
      const std::int64_t tag = values_.integer("the tag of a node");
      add_tag(tag);
      read_point();
      values_.end_row();
    }
  }

  void read_elements_2() {
    const Index count = read_count_2("elements", values_.is_binary() ? sizeof(std::int32_t) : std::size_t{6});
    for (std::int64_t done = 0; done < count;) {
      // ASCII files lack the headers of blocks of equal elements: each is a block of its own.
      values_.begin_row("an element");
      std::int64_t size = 1;
      if (!values_.is_binary()) values_.integer("the tag of an element");
      const ElementType& type = read_type();
      if (values_.is_binary()) {
        size = values_.integer("the number of elements of a block");
        if (size < 1 || size > count - done) {
          reader_.fail(fmt::format("a block of {} elements", size), fmt::format("1 to {}", count - done));
        }
      }
      const std::int64_t tags = values_.integer("the number of tags");
      if (tags < 0) reader_.fail(fmt::format("{} tags", tags), "a count");
      for (std::int64_t i = 0; i < size; ++i) {
        if (values_.is_binary()) values_.integer("the tag of an element");
        for (std::int64_t k = 0; k < tags; ++k) values_.integer("a tag of an element");
        read_element(type, [this] { return values_.integer("the tag of a node"); });
      }
      values_.end_row();
      done += size;
    }
  }

  void read_nodes_4() {
    const auto [blocks, total] = read_head_4();
    for (std::int64_t block = 0; block < blocks; ++block) {
      values_.begin_row("a block of nodes");
      const std::int64_t dimension = values_.integer("the dimension of an entity");
      values_.integer("the tag of an entity");
      const bool is_parametric = values_.integer("0 or 1 (parametric)") != 0;
      const Index count = reader_.checked_count(values_.long_integer("the number of nodes of a block"), "nodes",
                                                values_.is_binary() ? std::size_t{32} : std::size_t{8});
      values_.end_row();
      for (Index i = 0; i < count; ++i) {
        values_.begin_row("the tag of a node");
        add_tag(values_.long_integer("the tag of a node"));
        values_.end_row();
      }
      for (Index i = 0; i < count; ++i) {
        values_.begin_row("the coordinates of a node");
        read_point();
        for (std::int64_t k = 0; is_parametric && k < dimension; ++k) values_.real("a parameter of a node");
        values_.end_row();
      }
    }
    check_total("nodes", builder_.vertex_count(), total);
  }

  void read_elements_4() {
    const auto [blocks, total] = read_head_4();
    std::int64_t done = 0;
    for (std::int64_t block = 0; block < blocks; ++block) {
      values_.begin_row("a block of elements");
      values_.integer("the dimension of an entity");
      values_.integer("the tag of an entity");
      const ElementType& type = read_type();
      const std::size_t columns = static_cast<std::size_t>(type.nodes) + 1;
      const Index count = reader_.checked_count(values_.long_integer("the number of elements of a block"), type.things,
                                                columns * (values_.is_binary() ? std::size_t{8} : std::size_t{2}));
      values_.end_row();
      for (Index i = 0; i < count; ++i) {
        values_.begin_row("an element");
        values_.long_integer("the tag of an element");
        read_element(type, [this] { return values_.long_integer("the tag of a node"); });
        values_.end_row();
      }
      done += count;
    }
    check_total("elements", done, total);
  }

  /// The number of blocks and the number of things in all blocks.
  std::pair<std::int64_t, std::int64_t> read_head_4() {
    if (values_.is_binary()) reader_.skip_line();
    values_.begin_row("the number of blocks");
    const std::int64_t blocks = values_.long_integer("the number of blocks");
    const std::int64_t total = values_.long_integer("the number of entries in all blocks");
    values_.long_integer("the smallest tag");
    values_.long_integer("the largest tag");
    values_.end_row();
    return {blocks, total};
  }

  void check_total(std::string_view things, std::int64_t found, std::int64_t expected) const {
    if (found != expected) {
      reader_.fail(fmt::format("{} {}", found, things), fmt::format("{} as announced", expected));
    }
  }

  const ElementType& read_type() {
    const std::int64_t number = values_.integer("the type of an element");
    for (const ElementType& type : kElementTypes) {
      if (type.number == number) return type;
    }
    reader_.fail(fmt::format("element type {}", number), "one of 1 to 31, 92, 93");
  }

  void add_tag(std::int64_t tag) {
    if (!vertices_.try_emplace(tag, static_cast<std::int64_t>(vertices_.size())).second) {
      reader_.fail(fmt::format("node tag {} again", tag), "distinct tags");
    }
  }

  void read_point() {
    const double x = values_.real("coordinate x of a node");
    const double y = values_.real("coordinate y of a node");
    const double z = values_.real("coordinate z of a node");
    builder_.add_vertex(x, y, z);
  }

  template <class ReadTag>
  void read_element(const ElementType& type, const ReadTag& read_tag) {
    corners_.clear();
    for (int k = 0; k < type.nodes; ++k) {
      const std::int64_t tag = read_tag();
      const auto vertex = vertices_.find(tag);
      if (vertex == vertices_.end()) reader_.fail(fmt::format("node tag {}", tag), "the tag of a node above");
      corners_.push_back(vertex->second);
    }
    if (type.number == kTriangle || type.number == kQuadrilateral) {
      builder_.add_polygon(corners_);
    } else if (type.number == kTetrahedron) {
      builder_.add_tetrahedron(corners_);
    } else {
      builder_.ignore(std::string(type.things));
    }
  }

  static constexpr std::size_t kBinaryNodeSize = sizeof(std::int32_t) + 3 * sizeof(double);

  Reader& reader_;
  MeshBuilder& builder_;
  bool is_version_4_ = false;
  Values values_;
  std::unordered_map<std::int64_t, std::int64_t> vertices_;  ///< of node tags
  std::vector<std::int64_t> corners_;
};

void read(Reader& reader, MeshBuilder& builder) { GmshReader(reader, builder).read(); }

std::string write(const Mesh& mesh, const std::vector<MeshField>& /*fields*/) {
  const bool is_tetrahedral = mesh.cells.cols() == 4;
  const int dimension = is_tetrahedral ? 3 : 2;
  std::string out = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n";
  const auto append_head = [&](std::string_view section, Index count, std::int64_t type) {
    // One block on entity 1, tags 1 to count.
    fmt::format_to(std::back_inserter(out), "${}\n1 {} 1 {}\n{} 1 {} {}\n", section, count, count, dimension, type,
                   count);
  };

  append_head("Nodes", mesh.vertex_count(), 0);
  for (Index v = 0; v < mesh.vertex_count(); ++v) fmt::format_to(std::back_inserter(out), "{}\n", v + 1);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto [x, y, z] = position(mesh, v);
    fmt::format_to(std::back_inserter(out), "{} {} {}\n", x, y, z);
  }
  out += "$EndNodes\n";

  append_head("Elements", mesh.cell_count(), is_tetrahedral ? kTetrahedron : kTriangle);
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    fmt::format_to(std::back_inserter(out), "{}", c + 1);
    for (const Index v : mesh.cells.row(c)) fmt::format_to(std::back_inserter(out), " {}", v + 1);
    out += '\n';
  }
  return out + "$EndElements\n";
}

}  // namespace

Format gmsh_format() { return {.extension = ".msh", .read = &read, .write = &write, .holds_tetrahedra = true}; }

}  // namespace variform::io
