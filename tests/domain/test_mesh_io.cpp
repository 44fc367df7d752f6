// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "framework/base/error.h"
#include "framework/domain/io/base64.h"
#include "framework/domain/io/formats.h"
#include "framework/domain/mesh_io.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

/// Coordinates that only a correctly rounded round trip keeps.
Matrix hard_positions() {
  Matrix positions(5, 3);
  positions << 0.1, 1.0 / 3.0, -0.0,                                                           //
      std::numeric_limits<double>::max(), std::numeric_limits<double>::denorm_min(), -1e-300,  //
      2.0 / 3.0, std::nextafter(1.0, 2.0), 1e22,                                               //
      -123456789.123456789, 6.02214076e23, 5e-5,                                               //
      4.35, 9007199254740993.0, 3.141592653589793;
  return positions;
}

Mesh triangles() {
  Mesh mesh{hard_positions(), IndexMatrix(3, 3)};
  mesh.cells << 0, 1, 2, 2, 1, 3, 4, 0, 2;
  return mesh;
}

Mesh tetrahedra() {
  Mesh mesh{hard_positions(), IndexMatrix(2, 4)};
  mesh.cells << 0, 1, 2, 3, 1, 2, 3, 4;
  return mesh;
}

Mesh float_triangles() {
  Mesh mesh = triangles();
  mesh.positions = Matrix::Random(5, 3).cast<float>().cast<double>();
  return mesh;
}

std::vector<std::uint64_t> bits(const Matrix& matrix) {
  std::vector<std::uint64_t> result;
  for (const double x : matrix.reshaped<Eigen::RowMajor>()) result.push_back(std::bit_cast<std::uint64_t>(x));
  return result;
}

void expect_same(const Mesh& actual, const Mesh& expected) {
  EXPECT_EQ(actual.positions.cols(), expected.positions.cols());
  EXPECT_EQ(bits(actual.positions), bits(expected.positions));
  EXPECT_EQ(actual.cells, expected.cells);
}

/// A unit square of two triangles.
Mesh square() {
  Mesh mesh{Matrix(4, 3), IndexMatrix(2, 3)};
  mesh.positions << 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0;
  mesh.cells << 0, 1, 2, 0, 2, 3;
  return mesh;
}

Mesh unit_tetrahedron() {
  Mesh mesh{Matrix(4, 3), IndexMatrix(1, 4)};
  mesh.positions << 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1;
  mesh.cells << 0, 1, 2, 3;
  return mesh;
}

/// The bytes of numbers in some byte order.
class Bytes {
 public:
  explicit Bytes(std::endian order) : order_(order) {}

  template <class T>
  Bytes& put(T value) {
    auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
    if (order_ != std::endian::native) std::reverse(raw.begin(), raw.end());
    bytes_.append(raw.data(), raw.size());
    return *this;
  }
  template <class T>
  Bytes& put_all(std::initializer_list<T> values) {
    for (const T value : values) put(value);
    return *this;
  }
  Bytes& text(std::string_view text) {
    bytes_ += text;
    return *this;
  }
  const std::string& str() const { return bytes_; }

 private:
  std::endian order_;
  std::string bytes_;
};

/// The unit square in the formats and variants that write_mesh does not write, and some that it does.
struct Sample {
  std::string name;
  std::string content;
  Mesh mesh;
};

std::string ply_header(const std::string& encoding, const std::string& coordinate, const std::string& list) {
  return fmt::format(
      "ply\nformat {} 1.0\ncomment made by hand\nobj_info none\nelement vertex 4\nproperty uchar flag\n"
      "property {} x\nproperty {} y\nproperty {} z\nelement face 2\nproperty list {} vertex_index\n"
      "property short tag\nend_header\n",
      encoding, coordinate, coordinate, coordinate, list);
}

template <class Coordinate, class Count, class Corner>
std::string binary_ply(std::endian order, const std::string& coordinate, const std::string& list) {
  Bytes bytes(order);
  bytes.text(ply_header(order == std::endian::little ? "binary_little_endian" : "binary_big_endian", coordinate, list));
  const Mesh mesh = square();
  for (const auto point : mesh.positions.rowwise()) {
    bytes.put(std::uint8_t{7});
    for (const double x : point) bytes.put(static_cast<Coordinate>(x));
  }
  for (const auto cell : mesh.cells.rowwise()) {
    bytes.put(Count{3});
    for (const Index v : cell) bytes.put(static_cast<Corner>(v));
    bytes.put(std::int16_t{-5});
  }
  return bytes.str();
}

std::string binary_msh_2(std::endian order) {
  Bytes bytes(order);
  bytes.text("$MeshFormat\n2.2 1 8\n").put(std::int32_t{1}).text("\n$EndMeshFormat\n$Nodes\n4\n");
  const Mesh mesh = square();
  for (Index v = 0; v < 4; ++v) {
    bytes.put(std::int32_t{10 * (v + 1)});
    for (const double x : mesh.positions.row(v)) bytes.put(x);
  }
  bytes.text("\n$EndNodes\n$Elements\n3\n");
  bytes.put_all<std::int32_t>({1, 1, 2, /*element*/ 1, 1, 1, 10, 20});  // a line
  bytes.put_all<std::int32_t>({2, 2, 2, /*element*/ 2, 1, 1, 10, 20, 30, /*element*/ 3, 1, 1, 10, 30, 40});
  return bytes.text("\n$EndElements\n").str();
}

std::string binary_msh_4(std::endian order) {
  Bytes bytes(order);
  bytes.text("$MeshFormat\n4.1 1 8\n")
      .put(std::int32_t{1})
      .text("\n$EndMeshFormat\n$Entities\nskipped\n$EndEntities\n");
  bytes.text("$Nodes\n").put_all<std::uint64_t>({2, 4, 1, 4});
  bytes.put_all<std::int32_t>({0, 1, 0}).put_all<std::uint64_t>({1, 1}).put_all<double>({0, 0, 0});
  bytes.put_all<std::int32_t>({2, 1, 1}).put_all<std::uint64_t>({3, 2, 3, 4});
  bytes.put_all<double>({1, 0, 0, /*parameters*/ 1, 0, 1, 1, 0, 1, 1, 0, 1, 0, 0, 1});
  bytes.text("\n$EndNodes\n$Elements\n").put_all<std::uint64_t>({1, 2, 1, 2});
  bytes.put_all<std::int32_t>({2, 1, 2}).put_all<std::uint64_t>({2, /*element*/ 1, 1, 2, 3, /*element*/ 2, 1, 3, 4});
  return bytes.text("\n$EndElements\n").str();
}

std::string ascii_stl() {
  const Mesh mesh = square();
  std::string text = "solid two words\n";
  for (const auto cell : mesh.cells.rowwise()) {
    text += " facet normal 0 0 1\n  outer loop\n";
    for (const Index v : cell) {
      text += fmt::format("   vertex {:e} {:e} {:e}\n", mesh.positions(v, 0), mesh.positions(v, 1), -0.0);
    }
    text += "  endloop\n endfacet\n";
  }
  return text + "endsolid two words\n";
}

std::string zlib_block(const std::string& data) {
  uLongf size = compressBound(data.size());
  std::string packed(size, '\0');
  compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(data.data()), data.size());
  packed.resize(size);
  return packed;
}

enum class VtuEncoding { inline_plain, inline_zlib, appended_plain, appended_zlib };

/// Arrays of the unit square in Float32, Int64 and UInt8, each packed in two blocks when compressed.
std::string binary_vtu(VtuEncoding encoding, std::endian order) {
  const bool is_packed = encoding == VtuEncoding::inline_zlib || encoding == VtuEncoding::appended_zlib;
  const bool is_appended = encoding == VtuEncoding::appended_plain || encoding == VtuEncoding::appended_zlib;
  std::string appended;

  const auto array = [&](const std::string& type, const std::string& name, const std::string& data) {
    std::string text;
    if (is_packed) {
      const std::size_t block = data.size() / 3 * 2;
      const std::string first = zlib_block(data.substr(0, block));
      const std::string second = zlib_block(data.substr(block));
      Bytes header(order);
      header.put_all<std::uint32_t>(
          {2, static_cast<std::uint32_t>(block), static_cast<std::uint32_t>(data.size() - block),
           static_cast<std::uint32_t>(first.size()), static_cast<std::uint32_t>(second.size())});
      text = io::base64_encode(header.str()) + io::base64_encode(first + second);
    } else {
      text = io::base64_encode(Bytes(order).put(static_cast<std::uint32_t>(data.size())).str() + data);
    }
    if (!is_appended) {
      return fmt::format(
          "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"binary\">\n {}\n"
          "</DataArray>\n",
          type, name, name == "Points" ? 3 : 1, text);
    }
    const std::size_t offset = appended.size();
    appended += text;
    return fmt::format("<DataArray type=\"{}\" Name=\"{}\" format=\"appended\" offset=\"{}\"/>\n", type, name, offset);
  };

  Bytes points(order);
  const Mesh mesh = square();
  for (const double x : mesh.positions.reshaped<Eigen::RowMajor>()) points.put(static_cast<float>(x));
  Bytes corners(order);
  for (const Index v : mesh.cells.reshaped<Eigen::RowMajor>()) corners.put(static_cast<std::int64_t>(v));
  std::string text = fmt::format(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"{}\"{}>\n"
      "<UnstructuredGrid>\n<Piece NumberOfPoints=\"4\" NumberOfCells=\"2\">\n",
      order == std::endian::little ? "LittleEndian" : "BigEndian",
      is_packed ? " compressor=\"vtkZLibDataCompressor\"" : "");
  text += "<Points>" + array("Float32", "Points", points.str()) + "</Points>\n<Cells>";
  text += array("Int64", "connectivity", corners.str());
  text += array("Int32", "offsets", Bytes(order).put_all<std::int32_t>({3, 6}).str());
  text += array("UInt8", "types", Bytes(order).put_all<std::uint8_t>({5, 5}).str());
  text += "</Cells>\n</Piece>\n</UnstructuredGrid>\n";
  if (is_appended) text += "<AppendedData encoding=\"base64\">\n _" + appended + "\n</AppendedData>\n";
  return text + "</VTKFile>\n";
}

constexpr const char* kAsciiVtu = R"(<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">
  <!-- a comment -->
  <UnstructuredGrid>
    <Piece NumberOfPoints="3" NumberOfCells="1">
      <Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">0 0 0
        1 0 0
        1 1 0</DataArray></Points>
      <Cells>
        <DataArray type="Int32" Name="connectivity" format="ascii">0 1 2</DataArray>
        <DataArray type="Int32" Name="offsets" format="ascii">3</DataArray>
        <DataArray type="UInt8" Name="types" format="ascii">5</DataArray>
      </Cells>
    </Piece>
    <Piece NumberOfPoints="4" NumberOfCells="2">
      <Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">
        0 0 0 1 1 0 0 1 0 5 5 5</DataArray></Points>
      <Cells>
        <DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 3</DataArray>
        <DataArray type="Int32" Name="offsets" format="ascii">3 4</DataArray>
        <DataArray type="UInt8" Name="types" format="ascii">5 1</DataArray>
      </Cells>
    </Piece>
  </UnstructuredGrid>
</VTKFile>
)";

Mesh two_pieces() {
  Mesh mesh{Matrix(7, 3), IndexMatrix(2, 3)};
  mesh.positions << 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0, 5, 5, 5;
  mesh.cells << 0, 1, 2, 3, 4, 5;
  return mesh;
}

const std::vector<Sample>& samples() {
  static const std::vector<Sample> list = {
      {"rich.obj",
       "# comment\r\nmtllib a.mtl\r\no thing\r\nv 0 0 0\r\nv 1 0 0 0.5 0.5 0.5 # colour\r\n\r\nv 1 1 0 1.0\r\n"
       "v +0 \\\r\n 1.0e0 -0\r\nvt 0 0\r\nvn 0 0 1\r\ng a b\r\nusemtl x\r\ns off\r\nf 1/1/1 2//1 3/1\r\nf -4 \\\n -2 "
       "-1",
       square()},
      {"mixed.off",
       "# first\nSTCNOFF 4 2 0 # counts here\n\n0 0 0  0 0 1\n1 0 0 0 0 1\n# between\n1 1 0\n0 1 0\n"
       "3 0 1 2 255 0 0\n3 0 2 3\n",
       square()},
      {"two_lines.off", "\xEF\xBB\xBFOFF\r\n4 2\r\n0 0 0\r\n1 0 0\r\n1 1 0\r\n0 1 0\r\n3 0 1 2\r\n3 0 2 3", square()},
      {"ascii.ply",
       ply_header("ascii", "float", "uchar int") + "1 0 0 0\n1 1 0 0\n1 1 1 0\n1 0 1 0\n3 0 1 2 9\n3 0 2 3 9\n",
       square()},
      {"extra_element.ply",
       "ply\r\nformat ascii 1.0\r\nelement vertex 4\r\nproperty list uchar float junk\r\nproperty double x\r\n"
       "property double y\r\nproperty double z\r\nelement edge 1\r\nproperty int a\r\nproperty list int int b\r\n"
       "element face 2\r\nproperty list uchar uint vertex_indices\r\nend_header\r\n0 0 0 0\r\n1 5 1 0 0\r\n0 1 1 0\r\n"
       "2 nan inf 0 1 0\r\n4 2 7 7\r\n3 0 1 2\r\n3 0 2 3\r\n",
       square()},
      {"little.ply", binary_ply<float, std::uint8_t, std::int32_t>(std::endian::little, "float", "uchar int"),
       square()},
      {"big.ply", binary_ply<double, std::int32_t, std::uint16_t>(std::endian::big, "double", "int ushort"), square()},
      {"float_list.ply", binary_ply<float, std::int8_t, float>(std::endian::big, "float32", "int8 float32"), square()},
      {"ascii.stl", ascii_stl(), square()},
      {"plain.mesh",
       " MeshVersionFormatted 2\n\nDimension\n3\n# comment\nVertices\n4\n0 0 0 1\n1 0 0 1\n1 1 0 2\n0 1 0 3\n"
       "Corners\n2\n1\n2\nEdges 1\n1 2 7\nNormals\n1\n0 0 1\nTriangles\n2\n1 2 3 0\n1 3 4 0\nEnd\n",
       square()},
      {"both.mesh",
       "MeshVersionFormatted 1\r\nDimension 3\r\nVertices 4\r\n0 0 0 0\r\n1 0 0 0\r\n0 1 0 0\r\n0 0 1 0\r\n"
       "Quadrilaterals 1\r\n1 2 3 4 0\r\nTriangles 1\r\n1 2 3 0\r\nTetrahedra\r\n1\r\n1 2 3 4 0",
       unit_tetrahedron()},
      {"v2.msh",
       "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 1 \"a\"\n$EndPhysicalNames\n$Nodes\n4\n7 0 0 0\n"
       "5 1 0 0\n8 1 1 0\n6 0 1 0\n$EndNodes\n$Elements\n3\n1 1 2 0 1 7 5\n2 2 2 0 1 7 5 8\n3 2 0 7 8 6\n"
       "$EndElements\n",
       square()},
      {"v4.msh",
       "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n2 4 1 4\n0 1 0 1\n1\n0 0 0\n2 1 1 3\n2\n3\n4\n1 0 0 0 0\n"
       "1 1 0 0 0\n0 1 0 0 0\n$EndNodes\n$Elements\n2 3 1 3\n0 1 15 1\n1 1\n2 1 2 2\n2 1 2 3\n3 1 3 4\n$EndElements\n",
       square()},
      {"little2.msh", binary_msh_2(std::endian::little), square()},
      {"big2.msh", binary_msh_2(std::endian::big), square()},
      {"little4.msh", binary_msh_4(std::endian::little), square()},
      {"big4.msh", binary_msh_4(std::endian::big), square()},
      {"ascii.vtu", kAsciiVtu, two_pieces()},
      {"inline.vtu", binary_vtu(VtuEncoding::inline_plain, std::endian::little), square()},
      {"zlib.vtu", binary_vtu(VtuEncoding::inline_zlib, std::endian::big), square()},
      {"appended.vtu", binary_vtu(VtuEncoding::appended_plain, std::endian::big), square()},
      {"appended_zlib.vtu", binary_vtu(VtuEncoding::appended_zlib, std::endian::little), square()},
  };
  return list;
}

/// The unit square with a seam along its diagonal: six texture coordinates for four vertices.
struct Seam {
  Matrix uv;
  IndexMatrix cells;
};

Seam seam() {
  Seam result{Matrix(6, 2), IndexMatrix(2, 3)};
  result.uv << 0.1, 1.0 / 3.0, -0.0, std::numeric_limits<double>::denorm_min(), 1e300, -1e-300, 2.0 / 3.0, 1e22,
      std::nextafter(1.0, 2.0), 4.35, 7.0, -7.0;
  result.cells << 5, 0, 1, 3, 4, 2;
  return result;
}

class MeshIo : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string test = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    folder_ = std::filesystem::temp_directory_path() / fmt::format("variform-{}-{}", test, getpid());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path path(const std::string& name) const { return folder_ / name; }

  std::filesystem::path store(const std::string& name, const std::string& content) const {
    std::ofstream(path(name), std::ios::binary) << content;
    return path(name);
  }

  std::string load(const std::string& name) const {
    std::ostringstream content;
    content << std::ifstream(path(name), std::ios::binary).rdbuf();
    return content.str();
  }

  /// The samples and what write_mesh writes, as name and content.
  std::map<std::string, std::string> all_files() const {
    std::map<std::string, std::string> files;
    for (const Sample& sample : samples()) files[sample.name] = sample.content;
    for (const std::string& extension : mesh_extensions()) {
      write_mesh(path("written" + extension), square());
      files["written" + extension] = load("written" + extension);
    }
    write_obj_uv(path("uv.obj"), square(), seam().uv, seam().cells);
    files["uv.obj"] = load("uv.obj");
    for (const std::string extension : {".mesh", ".msh", ".vtu"}) {
      write_mesh(path("tetrahedron" + extension), unit_tetrahedron());
      files["tetrahedron" + extension] = load("tetrahedron" + extension);
    }
    return files;
  }

  std::filesystem::path store_packed(const std::string& name, const std::string& content) const {
    const gzFile file = gzopen(path(name).c_str(), "wb");
    gzwrite(file, content.data(), static_cast<unsigned>(content.size()));
    gzclose(file);
    return path(name);
  }

  std::filesystem::path folder_;
};

/// What reading or writing throws, "no error" if nothing.
template <class Exception>
std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Exception& error) {
    return error.what();
  }
  return "no error";
}

/// Reads a damaged file: either an error of the library or a mesh that is safe to use.
void expect_error_or_mesh(const std::string& name, const std::string& content) {
  try {
    const MeshFile file = io::parse_mesh(name, content, {.triangulate_polygons = true});
    const Mesh& mesh = file.mesh;
    ASSERT_GT(mesh.cell_count(), 0);
    ASSERT_TRUE(file.uv_cells.rows() == 0 || file.uv_cells.rows() == mesh.cell_count());
    ASSERT_EQ(file.uv_cells.rows() == 0, file.uv.rows() == 0);
    if (file.uv.rows() > 0) {
      ASSERT_GE(file.uv_cells.minCoeff(), 0);
      ASSERT_LT(file.uv_cells.maxCoeff(), file.uv.rows());
      ASSERT_TRUE(file.uv.allFinite());
    }
    ASSERT_GE(mesh.cells.minCoeff(), 0);
    ASSERT_LT(mesh.cells.maxCoeff(), mesh.vertex_count());
    ASSERT_TRUE(mesh.positions.allFinite());
  } catch (const DataError& error) {
    ASSERT_THAT(error.what(), StartsWith(name));
  }
}

TEST_F(MeshIo, TrianglesRoundTripBitForBit) {
  for (const std::string extension : {".obj", ".off", ".ply", ".mesh", ".msh", ".vtu"}) {
    SCOPED_TRACE(extension);
    write_mesh(path("m" + extension), triangles());
    const MeshFile file = read_mesh(path("m" + extension));
    expect_same(file.mesh, triangles());
    EXPECT_THAT(file.warnings, IsEmpty());
  }
}

TEST_F(MeshIo, TetrahedraRoundTripBitForBit) {
  for (const std::string extension : {".mesh", ".msh", ".vtu"}) {
    SCOPED_TRACE(extension);
    write_mesh(path("m" + extension), tetrahedra());
    expect_same(read_mesh(path("m" + extension)).mesh, tetrahedra());
  }
}

TEST_F(MeshIo, StlRoundTripsCornersInSinglePrecision) {
  const Mesh mesh = float_triangles();
  write_mesh(path("m.stl"), mesh);
  const Mesh result = read_mesh(path("m.stl")).mesh;
  ASSERT_EQ(result.cell_count(), mesh.cell_count());
  EXPECT_EQ(result.vertex_count(), mesh.vertex_count());
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    for (Index k = 0; k < 3; ++k) {
      EXPECT_EQ(result.positions.row(result.cells(c, k)), mesh.positions.row(mesh.cells(c, k)));
    }
  }
}

TEST_F(MeshIo, PlanarMeshesKeepTwoColumnsOnlyInMedit) {
  Mesh planar = triangles();
  planar.positions = Matrix(planar.positions.leftCols(2));
  write_mesh(path("m.mesh"), planar);
  expect_same(read_mesh(path("m.mesh")).mesh, planar);

  Mesh flat = planar;
  flat.positions.conservativeResize(Eigen::NoChange, 3);
  flat.positions.col(2).setZero();
  for (const std::string extension : {".obj", ".off", ".ply", ".msh", ".vtu"}) {
    SCOPED_TRACE(extension);
    write_mesh(path("m" + extension), planar);
    expect_same(read_mesh(path("m" + extension)).mesh, flat);
  }
}

TEST_F(MeshIo, ReadsVariantsOfFormats) {
  for (const Sample& sample : samples()) {
    SCOPED_TRACE(sample.name);
    const Mesh mesh = read_mesh(store(sample.name, sample.content)).mesh;
    EXPECT_EQ(mesh.positions, sample.mesh.positions);
    EXPECT_EQ(mesh.cells, sample.mesh.cells);
  }
}

TEST_F(MeshIo, ReadsPackedFilesAndUpperCaseExtensions) {
  for (const auto& [name, content] : all_files()) {
    SCOPED_TRACE(name);
    const Mesh plain = read_mesh(store(name, content)).mesh;
    expect_same(read_mesh(store_packed(name + ".gz", content)).mesh, plain);
  }
  write_mesh(path("m.OBJ"), square());
  expect_same(read_mesh(path("m.OBJ")).mesh, square());
}

TEST_F(MeshIo, TellsWhatItIgnored) {
  const auto warnings = [&](const std::string& name) {
    for (const Sample& sample : samples()) {
      if (sample.name == name) return read_mesh(store(name, sample.content)).warnings;
    }
    return std::vector<std::string>{"no such sample"};
  };
  EXPECT_THAT(warnings("v2.msh"), ElementsAre("ignored 1 lines"));
  EXPECT_THAT(warnings("v4.msh"), ElementsAre("ignored 1 points"));
  EXPECT_THAT(warnings("plain.mesh"), ElementsAre("ignored 2 'Corners', 1 'Edges', 1 'Normals'"));
  EXPECT_THAT(warnings("both.mesh"), ElementsAre("ignored 1 triangles"));
  EXPECT_THAT(warnings("ascii.vtu"), ElementsAre("ignored 1 cells of VTK type 1"));
}

TEST_F(MeshIo, SplitsPolygonsOnlyOnRequest) {
  Mesh expected = square();
  const std::map<std::string, std::string> files = {
      {"quad.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"},
      {"quad.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"},
      {"quad.mesh",
       "MeshVersionFormatted 1 Dimension 3 Vertices 4 0 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 Quadrilaterals 1 1 2 3 4 0"},
  };
  for (const auto& [name, content] : files) {
    SCOPED_TRACE(name);
    const auto file = store(name, content);
    EXPECT_THAT(message_of<DataError>([&] { read_mesh(file); }),
                HasSubstr("found a face with 4 corners, expected triangles (the option triangulate_polygons"));
    const MeshFile split = read_mesh(file, {.triangulate_polygons = true});
    expect_same(split.mesh, expected);
    EXPECT_THAT(split.warnings, ElementsAre("split 1 polygons into triangles"));
  }
}

TEST_F(MeshIo, TextureCoordinatesRoundTripBitForBit) {
  write_obj_uv(path("m.obj"), square(), seam().uv, seam().cells);
  const MeshFile file = read_mesh(path("m.obj"));
  expect_same(file.mesh, square());
  EXPECT_EQ(bits(file.uv), bits(seam().uv));
  EXPECT_EQ(file.uv_cells, seam().cells);
  EXPECT_THAT(file.warnings, IsEmpty());
  EXPECT_THAT(load("m.obj"), HasSubstr("f 1/6 2/1 3/2\nf 1/4 3/5 4/3\n"));

  // The writer goes with the extension in upper case, and with planar meshes.
  Mesh planar = square();
  planar.positions = Matrix(planar.positions.leftCols(2));
  write_obj_uv(path("m.OBJ"), planar, seam().uv, seam().cells);
  expect_same(read_mesh(path("m.OBJ")).mesh, square());
}

TEST_F(MeshIo, ReadsVariantsOfTextureCoordinates) {
  const std::string positions = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
  const auto read = [&](const std::string& content) {
    return read_mesh(store("m.obj", content), {.triangulate_polygons = true});
  };
  // One and three coordinates, normals, negative indices, before and after the faces.
  const MeshFile file = read(positions + "vt 0.5\nvt 1 2 3\nf 1/1/9 2/-1 3/3/4\nf 1/4 3/2/ 4/-2\nvt 5 6\nvt 7 8\n");
  EXPECT_EQ(file.uv, (Matrix(4, 2) << 0.5, 0, 1, 2, 5, 6, 7, 8).finished());
  EXPECT_EQ(file.uv_cells, (IndexMatrix(2, 3) << 0, 1, 2, 3, 1, 0).finished());
  // Polygons are split alike.
  const MeshFile quad = read(positions + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/4 2/3 3/2 4/1\n");
  EXPECT_EQ(quad.mesh.cells, (IndexMatrix(2, 3) << 0, 1, 2, 0, 2, 3).finished());
  EXPECT_EQ(quad.uv_cells, (IndexMatrix(2, 3) << 3, 2, 1, 3, 1, 0).finished());
  // Not on every face, not at every corner, not at all.
  for (const std::string faces :
       {"f 1/1 2/1 3/1\nf 1 3 4\n", "f 1/1 2/1 3/1\nf 1/1 3//5 4/1\n", "f 1 2 3\nf 1 3 4\n"}) {
    const MeshFile none = read(positions + "vt 0.25 0.75\n" + faces);
    EXPECT_EQ(none.mesh.cells, square().cells);
    EXPECT_EQ(none.uv.size(), 0);
    EXPECT_EQ(none.uv_cells.size(), 0);
  }
}

TEST_F(MeshIo, RefusesToWriteTextureCoordinatesThatDoNotFit) {
  const auto [uv, cells] = seam();
  EXPECT_THAT(message_of<UsageError>([&] { write_obj_uv(path("m.ply"), square(), uv, cells); }),
              HasSubstr("m.ply: expected an .obj file"));
  EXPECT_THAT(message_of<UsageError>([&] { write_obj_uv(path("m.obj"), square(), uv, cells.topRows(1)); }),
              HasSubstr("texture coordinates of 2 columns with 1 x 3 indices for 2 cells of 3 corners"));
  EXPECT_THAT(message_of<UsageError>([&] { write_obj_uv(path("m.obj"), square(), Matrix::Zero(6, 3), cells); }),
              HasSubstr("texture coordinates of 3 columns"));
  EXPECT_THAT(message_of<UsageError>([&] { write_obj_uv(path("m.obj"), tetrahedra(), uv, cells); }),
              HasSubstr("2 cells of 4 corners"));
  EXPECT_THAT(message_of<DataError>([&] { write_obj_uv(path("m.obj"), square(), uv.topRows(5), cells); }),
              HasSubstr("cell 0 (counted from 0): it names texture coordinates 5 of 5"));
  Matrix broken = uv;
  broken(3, 1) = std::numeric_limits<double>::infinity();
  EXPECT_THAT(message_of<DataError>([&] { write_obj_uv(path("m.obj"), square(), broken, cells); }),
              HasSubstr("texture coordinates 3 (counted from 0): they are not finite"));
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

TEST_F(MeshIo, StlWeldsEqualCoordinatesAcrossSignsOfZero) {
  const Mesh mesh = read_mesh(store("m.stl", ascii_stl())).mesh;
  EXPECT_EQ(mesh.vertex_count(), 4);
  EXPECT_EQ(mesh.cells, square().cells);
}

TEST_F(MeshIo, NumbersOutOfRangeOfDoubles) {
  const Mesh mesh = read_mesh(store("m.obj", "v 1e-400 -1e-5000 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")).mesh;
  EXPECT_EQ(mesh.positions(0, 0), 0.0);
  EXPECT_THAT(message_of<DataError>([&] { read_mesh(store("m.obj", "v 1e400 0 0\n")); }),
              HasSubstr("m.obj:1: found coordinates (inf, 0, 0), expected finite numbers"));
}

TEST_F(MeshIo, WritesFieldsWhereTheFormatHoldsThem) {
  const Mesh mesh = square();
  const std::vector<MeshField> fields = {{"u<v>", MeshField::On::vertices, Matrix::Random(4, 2)},
                                         {"area", MeshField::On::cells, Matrix::Constant(2, 1, 0.5)}};
  write_mesh(path("m.vtu"), mesh, fields);
  expect_same(read_mesh(path("m.vtu")).mesh, mesh);
  EXPECT_THAT(load("m.vtu"), HasSubstr("Name=\"u&lt;v"));
  EXPECT_THAT(load("m.vtu"), HasSubstr("Name=\"area\""));

  write_mesh(path("m.ply"), mesh, fields);
  expect_same(read_mesh(path("m.ply")).mesh, mesh);
  EXPECT_THAT(load("m.ply"), HasSubstr("property double u<v>_0\nproperty double u<v>_1\nelement face 2\n"));

  EXPECT_THAT(message_of<UsageError>([&] { write_mesh(path("m.obj"), mesh, fields); }),
              HasSubstr(".obj files hold no fields; expected one of .ply, .vtu"));
  EXPECT_THAT(message_of<UsageError>([&] {
                write_mesh(path("m.vtu"), mesh, {{"u", MeshField::On::cells, Matrix::Zero(4, 1)}});
              }),
              HasSubstr("field 'u' has 4 rows and 1 columns, expected 2 rows"));
  EXPECT_THAT(message_of<UsageError>([&] {
                write_mesh(path("m.ply"), mesh, {{"two words", MeshField::On::cells, Matrix::Zero(2, 1)}});
              }),
              HasSubstr("'two words' cannot be a property"));
}

TEST_F(MeshIo, RefusesToWriteWhatNoReaderWouldAccept) {
  EXPECT_THAT(message_of<UsageError>([&] { write_mesh(path("m.obj"), tetrahedra()); }),
              HasSubstr(".obj files hold no tetrahedra; expected one of .mesh, .msh, .vtu"));
  EXPECT_THAT(message_of<UsageError>([&] { write_mesh(path("m.xyz"), square()); }),
              HasSubstr("unknown extension '.xyz'; known: .obj, .off, .ply, .stl, .mesh, .msh, .vtu"));
  EXPECT_THAT(message_of<UsageError>([&] { write_mesh(path("m.obj.gz"), square()); }),
              HasSubstr("unknown extension '.gz'"));
  EXPECT_THAT(message_of<UsageError>([&] { read_mesh(path("mesh")); }), HasSubstr("unknown extension ''"));
  Mesh mesh = square();
  mesh.cells(1, 2) = 4;
  EXPECT_THAT(message_of<DataError>([&] { write_mesh(path("m.obj"), mesh); }),
              HasSubstr("cell 1 (counted from 0): it names vertex 4 of 4"));
  mesh = square();
  mesh.positions(2, 1) = 1e300;
  EXPECT_THAT(message_of<DataError>([&] { write_mesh(path("m.stl"), mesh); }),
              HasSubstr("vertex 2 (counted from 0): its coordinates are not finite in single precision"));
  mesh.positions(2, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message_of<DataError>([&] { write_mesh(path("m.obj"), mesh); }), HasSubstr("vertex 2"));
  EXPECT_THAT(message_of<DataError>([&] { write_mesh(path("m.obj"), Mesh()); }), HasSubstr("0 coordinates"));
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

TEST_F(MeshIo, FilesAppearCompleteOrNotAtAll) {
  write_file(path("a.txt"), "first");
  write_file(path("a.txt"), "second");
  EXPECT_EQ(load("a.txt"), "second");
  EXPECT_THAT(message_of<DataError>([&] { write_file(path("missing/a.txt"), ""); }),
              HasSubstr("missing/a.txt: cannot be written: No such file or directory"));
  std::filesystem::create_directories(path("folder.txt") / "inner");
  EXPECT_THAT(message_of<DataError>([&] { write_file(path("folder.txt"), ""); }), HasSubstr("cannot be written"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator()), 2);
}

TEST_F(MeshIo, MissingAndEmptyFiles) {
  EXPECT_THAT(message_of<DataError>([&] { read_mesh(path("missing.obj")); }),
              HasSubstr("missing.obj: cannot be read: No such file or directory"));
  std::filesystem::create_directory(path("folder.obj"));
  EXPECT_THAT(message_of<DataError>([&] { read_mesh(path("folder.obj")); }),
              HasSubstr("folder.obj: found a folder, expected a file"));
  for (const std::string& extension : mesh_extensions()) {
    EXPECT_THAT(message_of<DataError>([&] { read_mesh(store("empty" + extension, "")); }),
                HasSubstr("found an empty file"));
    EXPECT_THAT(message_of<DataError>([&] { read_mesh(store_packed("empty" + extension + ".gz", "")); }),
                HasSubstr("found an empty file"));
    EXPECT_NE(message_of<DataError>([&] { read_mesh(store("blank" + extension, " \n\n")); }), "no error");
  }
}

struct BadFile {
  std::string name;
  std::string content;
  std::string message;
};

std::string with(std::string text, const std::string& old_part, const std::string& new_part) {
  return text.replace(text.find(old_part), old_part.size(), new_part);
}

std::vector<BadFile> bad_files() {
  const std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const std::string off = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  const std::string medit =
      "MeshVersionFormatted 1\nDimension 3\nVertices\n3\n0 0 0 0\n1 0 0 0\n0 1 0 0\nTriangles\n1\n1 2 3 0\nEnd\n";
  const std::string msh2 =
      "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n$Elements\n1\n"
      "1 2 2 0 1 1 2 3\n$EndElements\n";
  const std::string msh4 =
      "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
      "$Elements\n1 1 1 1\n2 1 2 1\n1 1 2 3\n$EndElements\n";
  const std::string stl = ascii_stl();
  const std::string vtu = kAsciiVtu;
  const std::string big_ply =
      "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n";
  const std::string base64_vtu = binary_vtu(VtuEncoding::inline_plain, std::endian::little);
  const std::string zlib_vtu = binary_vtu(VtuEncoding::inline_zlib, std::endian::little);
  const std::string appended_vtu = binary_vtu(VtuEncoding::appended_plain, std::endian::little);

  Bytes long_list(std::endian::little);
  long_list.text(with(big_ply, "2000000000", "1")).put_all<float>({0, 0, 0}).put(std::uint32_t{4000000000u});
  Bytes bad_block(std::endian::little);
  bad_block.text("$MeshFormat\n2.2 1 8\n")
      .put(1)
      .text("\n$EndMeshFormat\n$Nodes\n1\n")
      .put(1)
      .put(0.0)
      .put(0.0)
      .put(0.0);
  bad_block.text("$EndNodes\n$Elements\n1\n").put_all<std::int32_t>({2, -7, 0, 1, 1, 1});
  std::string long_stl = binary_ply<float, std::uint8_t, std::int32_t>(std::endian::little, "float", "uchar int");
  long_stl = std::string(80, ' ') + std::string(4, '\x7f') + long_stl;

  return {
      {"number.obj", with(obj, "1 0 0", "1 0x 0"), "number.obj:2: found '0x', expected coordinate y of a vertex"},
      {"short.obj", with(obj, "1 0 0", "1 0"), "short.obj:2: found the end of the line, expected coordinate z"},
      {"last.obj", "v 1", "last.obj:1: found the end of the file, expected coordinate y"},
      {"five.obj", with(obj, "1 0 0", "1 0 0 1 1"), "five.obj:2: found 5 numbers for a vertex, expected 3 coordinates"},
      {"nan.obj", with(obj, "1 0 0", "1 nan 0"), "nan.obj:2: found coordinates (1, nan, 0), expected finite numbers"},
      {"range.obj", obj + "f 1 2 4\n", "range.obj:4: found vertex index 4, expected 1 to 3"},
      {"zero.obj", obj + "f 0 1 2\n", "zero.obj:4: found vertex index 0, expected 1 to 3"},
      {"negative.obj", obj + "f -1 -2 -4\n", "negative.obj:4: found '-4', expected a vertex index from -3 to -1"},
      {"huge.obj", obj + "f 1 2 99999999999999999999\n", "huge.obj:4: found '99999999999999999999', expected a corner"},
      {"slash.obj", obj + "f 1/x 2 3\n", "slash.obj:4: found '1/x', expected a corner of a face"},
      {"two.obj", obj + "\n\nf 1 2\n", "two.obj:6: found a face with 2 corners, expected at least 3"},
      {"points.obj", obj, "points.obj: found 3 vertices, expected triangles or tetrahedra"},
      {"sign.obj", "v +-1 0 0\n", "sign.obj:1: found '+-1', expected coordinate x"},

      {"uvrange.obj", obj + "vt 0 0\nf 1/1 2/2 3/1\n",
       "uvrange.obj:5: found texture coordinate index 2, expected 1 to 1"},
      {"uvnone.obj", obj + "f 1/1 2/1 3/1\n",
       "uvnone.obj:4: found texture coordinate index 1, expected texture coordinates"},
      {"uvpartly.obj", obj + "vt 0 0\nf 1/9 2/1 3/1\nf 1 2 3\n",
       "uvpartly.obj:5: found texture coordinate index 9, expected 1 to 1"},
      {"uvzero.obj", obj + "vt 0 0\nf 1/0 2/1 3/1\n", "uvzero.obj:5: found '1/0', expected a texture coordinate index"},
      {"uvnegative.obj", obj + "vt 0 0\nf 1/1 2/-2 3/1\n",
       "uvnegative.obj:5: found '2/-2', expected a texture coordinate index from -1 to -1 or a positive one"},
      {"uvsign.obj", obj + "vt 0 0\nf 1/1 2/1-1 3/1\n", "uvsign.obj:5: found '2/1-1', expected a corner of a face"},
      {"uvnan.obj", obj + "vt 0 nan\n", "uvnan.obj:4: found texture coordinates (0, nan), expected finite numbers"},
      {"uvword.obj", obj + "vt 0 x\n", "uvword.obj:4: found 'x', expected texture coordinate v"},
      {"uvempty.obj", obj + "vt\n", "uvempty.obj:4: found the end of the line, expected texture coordinate u"},
      {"uvlong.obj", obj + "vt 0 0 0 0\n", "uvlong.obj:4: found '0', expected the end of the line"},

      {"header.off", with(off, "OFF", "OOF"), "header.off:1: found 'OOF', expected 'OFF'"},
      {"binary.off", with(off, "OFF", "OFF BINARY"), "binary.off:1: found 'BINARY', expected a file in ASCII"},
      {"count.off", with(off, "3 1 0", "3 -1 0"), "count.off:2: found -1 faces, expected 0 to 7"},
      {"many.off", with(off, "3 1 0", "999999999 1 0"), "many.off:2: found 999999999 vertices, expected 0 to 5"},
      {"long.off", with(off, "3 1 0", "9999999999999999999999 1 0"), "long.off:2: found '9999999999999999999999'"},
      {"missing.off", with(off, "3 1 0", "4 1 0"), "missing.off:7: found the end of the file, expected face 1 of 1"},
      {"range.off", with(off, "3 0 1 2", "3 0 1 3"), "range.off:6: found vertex index 3, expected 0 to 2"},
      {"negative.off", with(off, "3 0 1 2", "3 0 1 -1"), "negative.off:6: found vertex index -1, expected 0 to 2"},
      {"corner.off", with(off, "3 0 1 2", "3 0 1 1.5"), "corner.off:6: found '1.5', expected a vertex index"},
      {"inf.off", with(off, "1 0 0", "1 0 -inf"), "inf.off:4: found coordinates (1, 0, -inf), expected finite"},

      {"magic.ply", with(ply, "ply", "plx"), "magic.ply:1: found 'plx', expected 'ply'"},
      {"format.ply", with(ply, "ascii", "text"), "format.ply:2: found 'text', expected ascii, binary_little_endian"},
      {"noformat.ply", with(ply, "format ascii 1.0\n", ""),
       "noformat.ply:8: found 'end_header', expected 'format' before"},
      {"type.ply", with(ply, "float y", "half y"), "type.ply:5: found 'half', expected a type such as float"},
      {"z.ply", with(ply, "float z", "float w"), "z.ply:3: found no scalar property 'z' in element 'vertex'"},
      {"list.ply", with(ply, "_indices", "s"), "list.ply:7: found no list property 'vertex_indices' in element"},
      {"keyword.ply", with(ply, "end_header", "endheader"), "keyword.ply:9: found 'endheader', expected 'element'"},
      {"number.ply", with(ply, "1 0 0", "1 0 0z"), "number.ply:11: found '0z', expected z"},
      {"extra.ply", with(ply, "1 0 0", "1 0 0 0"), "extra.ply:11: found '0', expected the end of the line"},
      {"half.ply", with(ply, "3 0 1 2", "3 0 1 0.5"), "half.ply:13: found the number 0.5, expected a vertex index"},
      {"range.ply", with(ply, "3 0 1 2", "3 0 1 7"), "range.ply:13: found vertex index 7, expected 0 to 2"},
      {"many.ply", with(ply, "vertex 3", "vertex 3000000000"), "many.ply:3: found 3000000000 elements 'vertex'"},
      {"huge.ply", big_ply, "huge.ply:3: found 2000000000 elements 'vertex', expected 0 to 0"},
      {"longlist.ply", long_list.str(), "longlist.ply:byte 180: found 4000000000 entries of 'vertex_indices'"},
      {"cut.ply", samples()[5].content.substr(0, samples()[5].content.size() - 1),
       "found 1 bytes before the end of the file, expected 2 of tag"},

      {"number.stl", with(stl, "vertex 1.0", "vertex 1,0"),
       "number.stl:5: found '1,000000e+00', expected a coordinate"},
      {"loop.stl", with(stl, "endloop", "endlop"), "loop.stl:7: found 'endlop', expected 'endloop'"},
      {"cut.stl", stl.substr(0, stl.find("endsolid")), "expected 'facet' or 'endsolid'"},
      {"after.stl", stl + "rubbish", "after.stl:17: found 'rubbish', expected 'solid' or the end of the file"},
      {"long.stl", long_stl, "long.stl:byte 80: found 2139062143 triangles and"},
      {"short.stl", "not an stl file", "short.stl:byte 0: found 15 bytes before the end of the file, expected 80"},

      {"version.mesh", with(medit, "Formatted", ""),
       "version.mesh:1: found 'MeshVersion', expected 'MeshVersionFormatted'"},
      {"dimension.mesh", with(medit, "Dimension 3", "Dimension 4"), "dimension.mesh:2: found '4', expected 2 or 3"},
      {"number.mesh", with(medit, "1 0 0 0", "1 0 0.0.0 0"), "number.mesh:6: found '0.0.0', expected coordinate z"},
      {"many.mesh", with(medit, "\n3\n", "\n1000000000\n"), "many.mesh:4: found 1000000000 vertices, expected 0 to"},
      {"range.mesh", with(medit, "1 2 3 0", "1 2 4 0"), "range.mesh:10: found vertex index 4, expected 1 to 3"},
      {"cut.mesh", medit.substr(0, medit.find(" 0\nEnd")), "cut.mesh:9: found 1 triangles, expected 0 to 0"},
      {"hex.mesh", with(medit, "Triangles", "Hexahedra"), "found 3 vertices, 1 'Hexahedra', expected triangles"},

      {"version.msh", with(msh2, "2.2", "1.0"), "version.msh:2: found '1.0', expected version 2.2 or 4.1"},
      {"node.msh", with(msh2, "2 1 0 0", "2 1 zero 0"), "node.msh:7: found 'zero', expected coordinate y of a node"},
      {"again.msh", with(msh2, "2 1 0 0", "1 1 0 0"), "found node tag 1 again, expected distinct tags"},
      {"tag.msh", with(msh2, "1 1 2 3", "1 1 2 9"), "tag.msh:12: found node tag 9, expected the tag of a node above"},
      {"type.msh", with(msh2, "1 2 2 0", "1 77 2 0"), "type.msh:12: found element type 77, expected one of"},
      {"rest.msh", with(msh2, "1 1 2 3", "1 1 2 3 4"), "rest.msh:12: found '4', expected the end of the line"},
      {"end.msh", with(msh2, "$EndElements\n", ""), "end.msh:13: found the end of the file, expected $EndElements"},
      {"section.msh", with(msh2, "$Elements", "$Elementz"), "found '$Elementz' without its end"},
      {"many.msh", with(msh4, "2 1 0 3", "2 1 0 300000000"), "many.msh:6: found 300000000 nodes, expected 0 to"},
      {"total.msh", with(msh4, "1 3 1 3", "1 4 1 3"), "found 3 nodes, expected 4 as announced"},
      {"block.msh", bad_block.str(), "found a block of -7 elements, expected 1 to 1"},

      {"xml.vtu", with(vtu, "</Cells>", "</Cell>"), "xml.vtu:12: found broken XML"},
      {"kind.vtu", with(vtu, "\"UnstructuredGrid\"", "\"PolyData\""), "kind.vtu:1: found a file of type 'PolyData'"},
      {"number.vtu", with(vtu, "1 1 0", "1 l 0"), "number.vtu:7: found 'l', expected a number"},
      {"points.vtu", with(vtu, "Points=\"3\"", "Points=\"4\""), "points.vtu:5: found 9 coordinates in <DataArray>"},
      {"range.vtu", with(vtu, "0 1 2<", "0 1 3<"), "range.vtu:9: found vertex index 3 in cell 0 in <DataArray>"},
      {"offsets.vtu", with(vtu, ">3<", ">4<"),
       "offsets.vtu:10: found offset 4 of cell 0 in <DataArray>, expected 0 to 3"},
      {"types.vtu", with(vtu, ">5<", ">10<"), "types.vtu:10: found 3 corners of cell 0 of type 10 in <DataArray>"},
      {"nan.vtu", with(vtu, "1 1 0", "1 nan 0"), "nan.vtu:5: found coordinates (1, nan, 0)"},
      {"packer.vtu", with(zlib_vtu, "ZLib", "LZ4"), "packer.vtu:2: found compressor 'vtkLZ4DataCompressor'"},
      {"base64.vtu",
       with(base64_vtu, "<DataArray type=\"Float32\" Name=\"Points\" NumberOfComponents=\"3\" format=\"binary\">\n ",
            "<DataArray type=\"Float32\" format=\"binary\">*"),
       "base64.vtu:5: found broken or truncated base64 data in <DataArray>"},
      {"raw.vtu", with(appended_vtu, "\"base64\"", "\"raw\""),
       "raw.vtu:13: found raw appended data, expected ASCII or base64"},
      {"offset.vtu", with(appended_vtu, "offset=\"0\"", "offset=\"99999\""), "offset.vtu:5: found offset 99999"},

      {"packed.obj.gz", "not packed", "packed.obj.gz: found damaged or truncated data, expected a complete gzip file"},
  };
}

TEST_F(MeshIo, BadFilesAreReportedWithTheirPlace) {
  for (const BadFile& bad : bad_files()) {
    SCOPED_TRACE(bad.name);
    EXPECT_THAT(message_of<DataError>([&] { read_mesh(store(bad.name, bad.content)); }), HasSubstr(bad.message));
  }
}

TEST_F(MeshIo, TruncatedFilesNeverCrash) {
  for (const auto& [name, content] : all_files()) {
    SCOPED_TRACE(name);
    for (std::size_t size = 0; size < content.size(); ++size) {
      SCOPED_TRACE(size);
      ASSERT_NO_FATAL_FAILURE(expect_error_or_mesh(name, content.substr(0, size)));
    }
  }
}

TEST_F(MeshIo, TruncatedPackedFilesAreErrors) {
  for (const std::string& extension : mesh_extensions()) {
    write_mesh(path("m" + extension), square());
    const std::string name = "m" + extension + ".gz";
    store_packed(name, load("m" + extension));
    const std::string content = load(name);
    for (std::size_t size = 1; size < content.size(); ++size) {
      EXPECT_THAT(message_of<DataError>([&] { read_mesh(store(name, content.substr(0, size))); }),
                  HasSubstr("expected a complete gzip file"));
    }
  }
}

TEST_F(MeshIo, BinaryFilesCutAnywhereAreErrors) {
  for (const std::string name : {"written.ply", "written.stl", "written.msh", "written.vtu"}) {
    const std::string content = all_files().at(name);
    for (std::size_t size = 0; size + 1 < content.size(); ++size) {
      SCOPED_TRACE(fmt::format("{} cut to {} bytes", name, size));
      EXPECT_NE(message_of<DataError>([&] { io::parse_mesh(name, content.substr(0, size), {}); }), "no error");
    }
  }
}

TEST_F(MeshIo, MutatedFilesNeverCrash) {
  constexpr int kMutations = 3000;
  constexpr std::string_view kNastyBytes("\0\xff-9 \n.e$<\"#\\/=", 15);
  std::mt19937_64 random(20240229);
  const auto below = [&](std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random); };
  for (const auto& [name, content] : all_files()) {
    for (int i = 0; i < kMutations; ++i) {
      std::string mutated = content;
      for (std::size_t flips = 1 + below(3); flips > 0; --flips) {
        char& c = mutated[below(mutated.size())];
        c = below(2) == 0 ? kNastyBytes[below(kNastyBytes.size())] : static_cast<char>(c ^ (1u << below(8)));
      }
      SCOPED_TRACE(fmt::format("{}, mutation {}", name, i));
      ASSERT_NO_FATAL_FAILURE(expect_error_or_mesh(name, mutated));
    }
  }
}

}  // namespace
}  // namespace variform
