// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "framework/domain/io/mesh_builder.h"
#include "framework/domain/io/reader.h"
#include "framework/domain/mesh_io.h"

namespace variform::io {

/// A mesh format. To add one: a file that defines it, its declaration below and its line in the table of mesh_io.cpp.
struct Format {
  std::string extension;  ///< lower case, with the dot
  void (*read)(Reader& reader, MeshBuilder& builder);
  /// The content of the file. The mesh and the fields are checked, and the format can hold them.
  std::string (*write)(const Mesh& mesh, const std::vector<MeshField>& fields);
  bool holds_tetrahedra = false;
  bool holds_fields = false;
  bool is_single_precision = false;
};

Format obj_format();
Format off_format();
Format ply_format();
Format stl_format();
Format medit_format();
Format gmsh_format();
Format vtu_format();

/// An OBJ file with texture coordinates. The mesh and the coordinates are checked.
std::string obj_with_uv(const Mesh& mesh, const Matrix& uv, const IndexMatrix& uv_cells);

/// read_mesh for the unpacked content of a file of this name.
MeshFile parse_mesh(const std::filesystem::path& path, std::string_view content, const ReadOptions& options);

/// Coordinates of a vertex; planar meshes lie at z = 0.
inline std::array<double, 3> position(const Mesh& mesh, Index vertex) {
  return {mesh.positions(vertex, 0), mesh.positions(vertex, 1),
          mesh.positions.cols() == 3 ? mesh.positions(vertex, 2) : 0.0};
}

/// Appends the bytes of a number, least significant first.
template <class T>
void append_little_endian(std::string& out, T value) {
  auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
  if constexpr (std::endian::native == std::endian::big) std::reverse(raw.begin(), raw.end());
  out.append(raw.data(), raw.size());
}

}  // namespace variform::io
