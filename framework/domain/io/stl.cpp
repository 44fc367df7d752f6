// SPDX-License-Identifier: BSD-3-Clause
// STL, ASCII and binary: a soup of triangles, welded at equal coordinates. Written as binary.
#include <Eigen/Geometry>
#include <fmt/format.h>

#include <cmath>
#include <unordered_map>

#include "framework/domain/io/formats.h"

namespace variform::io {
namespace {

constexpr std::size_t kHeaderSize = 80;
constexpr std::size_t kTriangleSize = 50;

using Point = std::array<double, 3>;

struct PointHash {
  std::size_t operator()(const Point& point) const {
    std::uint64_t hash = 0;
    for (const double x : point) {
      hash = (hash ^ std::bit_cast<std::uint64_t>(x)) * 0x9E3779B97F4A7C15u;
      hash ^= hash >> 32;
    }
    return hash;
  }
};

/// Numbers equal points alike, in the order of their first appearance.
class Welder {
 public:
  explicit Welder(MeshBuilder& builder) : builder_(builder) {}

  std::int64_t vertex(const Point& point) {
    const Point key{point[0] + 0.0, point[1] + 0.0, point[2] + 0.0};  // -0 becomes 0
    const auto [entry, is_new] = vertices_.try_emplace(key, static_cast<std::int64_t>(vertices_.size()));
    if (is_new) builder_.add_vertex(point[0], point[1], point[2]);
    return entry->second;
  }

 private:
  MeshBuilder& builder_;
  std::unordered_map<Point, std::int64_t, PointHash> vertices_;
};

void read_binary(Reader& reader, MeshBuilder& builder) {
  reader.start_binary();
  reader.bytes(kHeaderSize, "the header of a binary STL file");
  const auto count = reader.binary<std::uint32_t>(std::endian::little, "the number of triangles");
  if (reader.remaining() != count * kTriangleSize) {
    reader.fail(fmt::format("{} triangles and {} bytes after their number", count, reader.remaining()),
                fmt::format("{} bytes", count * kTriangleSize));
  }
  Welder welder(builder);
  for (std::uint32_t i = 0; i < count; ++i) {
    reader.bytes(3 * sizeof(float), "a normal");
    std::array<std::int64_t, 3> corners{};
    for (std::int64_t& corner : corners) {
      Point point{};
      for (double& x : point) x = reader.binary<float>(std::endian::little, "a coordinate");
      corner = welder.vertex(point);
    }
    reader.bytes(sizeof(std::uint16_t), "an attribute");
    builder.add_polygon(corners);
  }
}

void read_ascii(Reader& reader, MeshBuilder& builder) {
  Welder welder(builder);
  std::string_view keyword = reader.token();
  while (keyword == "solid") {
    reader.skip_line();
    for (keyword = reader.token(); keyword == "facet"; keyword = reader.token()) {
      reader.expect("normal");
      for (int k = 0; k < 3; ++k) reader.number<double>("a component of the normal");
      reader.expect("outer");
      reader.expect("loop");
      std::array<std::int64_t, 3> corners{};
      for (std::int64_t& corner : corners) {
        reader.expect("vertex");
        Point point{};
        for (double& x : point) x = reader.number<double>("a coordinate of a vertex");
        corner = welder.vertex(point);
      }
      builder.add_polygon(corners);
      reader.expect("endloop");
      reader.expect("endfacet");
    }
    if (keyword != "endsolid") reader.fail_token(keyword, "'facet' or 'endsolid'");
    reader.skip_line();
    keyword = reader.token();
  }
  if (!keyword.empty()) reader.fail_token(keyword, "'solid' or the end of the file");
}

/// The size decides first, since some binary files start with "solid", too.
bool is_ascii(std::string_view content) {
  if (content.size() >= kHeaderSize + sizeof(std::uint32_t)) {
    Reader reader("", content);
    reader.bytes(kHeaderSize, "");
    const auto count = reader.binary<std::uint32_t>(std::endian::little, "");
    if (reader.remaining() == count * kTriangleSize) return false;
  }
  return Reader("", content).token() == "solid" || Reader("", content, {.free_form = true}).token() == "solid";
}

void read(Reader& reader, MeshBuilder& builder) {
  if (!is_ascii(reader.content())) return read_binary(reader, builder);
  reader.set_syntax({.free_form = true});
  read_ascii(reader, builder);
}

std::string write(const Mesh& mesh, const std::vector<MeshField>& /*fields*/) {
  std::string out = "binary STL";
  out.resize(kHeaderSize, ' ');
  append_little_endian(out, static_cast<std::uint32_t>(mesh.cell_count()));
  const auto append = [&out](const Eigen::Vector3f& point) {
    for (const float x : point) append_little_endian(out, x);
  };
  for (const auto cell : mesh.cells.rowwise()) {
    std::array<Eigen::Vector3d, 3> corners;
    for (int k = 0; k < 3; ++k) corners[k] = Eigen::Vector3d(position(mesh, cell(k)).data());
    const Eigen::Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).stableNormalized();
    append(normal.cast<float>());
    for (const Eigen::Vector3d& corner : corners) append(corner.cast<float>());
    append_little_endian(out, std::uint16_t{0});
  }
  return out;
}

}  // namespace

Format stl_format() { return {.extension = ".stl", .read = &read, .write = &write, .is_single_precision = true}; }

}  // namespace variform::io
