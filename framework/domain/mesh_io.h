// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "framework/domain/mesh.h"

namespace variform {

/// A named array that travels with a mesh into formats that carry data (VTU, PLY).
struct MeshField {
  enum class On { vertices, cells };
  std::string name;
  On on;
  Matrix values;  ///< one row per vertex or cell, 1 to 9 columns
};

struct ReadOptions {
  /// Split polygons with more than three corners into triangles (a fan from the first corner) instead of refusing them.
  bool triangulate_polygons = false;
};

/// What a mesh file held.
struct MeshFile {
  Mesh mesh;                          ///< positions are vertices x 3; x 2 only where the format is two-dimensional
  std::vector<std::string> warnings;  ///< what was ignored or changed while reading, one sentence each
  Matrix uv;             ///< texture coordinates, n x 2: of OBJ files that give them on all faces, else 0 x 0
  IndexMatrix uv_cells;  ///< cells x 3, the row of uv at each corner; 0 x 0 without uv
};

/// Reads a mesh by its extension: .obj .off .ply .stl .mesh .msh .vtu, each also gzipped (.gz appended).
/// Tetrahedra are taken where the file has any, else triangles. Vertex numbering is kept (STL, which has none, is
/// welded at equal coordinates). Throws DataError "FILE:LINE: what was found, what was expected" (byte offset instead
/// of line in binary files) for missing, truncated, malformed files, indices out of range, NaN, polygons without
/// triangulate_polygons; UsageError for unknown extensions.
MeshFile read_mesh(const std::filesystem::path& path, const ReadOptions& options = {});

/// Writes a mesh by its extension: .obj .off .ply .stl .mesh .msh .vtu. Coordinates carry all digits (a read gives the
/// same doubles; STL is single precision by definition). The file appears complete or not at all (temporary file, then
/// rename). Fields go into .vtu and .ply. Fields and tetrahedra are refused by formats that cannot carry them
/// (UsageError). Throws DataError when the file cannot be written, and for meshes that no reader would accept: indices
/// out of range, coordinates that are not finite.
void write_mesh(const std::filesystem::path& path, const Mesh& mesh, const std::vector<MeshField>& fields = {});

/// Writes a triangle mesh with texture coordinates to an .obj file: uv (n x 2), and for every corner of every cell its
/// row of uv (cells x 3). Where the two cells at an edge have different rows is a seam: a surface that was cut for its
/// parametrization is written uncut, with `cells` of the uncut and `uv_cells` of the cut mesh. What read_mesh gives
/// back is the same to the last bit. Throws as write_mesh does, UsageError for sizes that do not fit, DataError for
/// rows of uv that do not exist and coordinates that are not finite.
void write_obj_uv(const std::filesystem::path& path, const Mesh& mesh, const Matrix& uv, const IndexMatrix& uv_cells);

/// Writes a ParaView collection (.pvd): which file shows the state at which time. Files are named relative to the
/// collection. Throws DataError when it cannot be written.
void write_pvd(const std::filesystem::path& path, const std::vector<std::pair<double, std::string>>& files);

/// Extensions that read_mesh and write_mesh know, with the dot.
const std::vector<std::string>& mesh_extensions();

/// Writes text to path via a temporary file in the same folder and a rename. Throws DataError naming the path.
void write_file(const std::filesystem::path& path, const std::string& content);

}  // namespace variform
