// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/domain/mesh.h"

namespace variform {

/// A cell whose measure is at most this fraction of the mean measure counts as degenerate.
inline constexpr double kDegenerateMeasure = 1e-12;

/// One thing that is wrong with a mesh.
struct Defect {
  enum class Kind {
    empty,                     ///< no cells
    not_finite,                ///< a coordinate is NaN or infinite
    index_out_of_range,        ///< a cell names a vertex that does not exist
    repeated_vertex,           ///< a cell names a vertex twice
    degenerate_cell,           ///< measure at most kDegenerateMeasure of the mean
    duplicate_cell,            ///< two cells with the same vertices
    non_manifold_facet,        ///< more than two cells at a facet
    inconsistent_orientation,  ///< two cells traverse their common facet in the same direction; negative tetrahedra
    unreferenced_vertex,       ///< a vertex of no cell
  };
  Kind kind;
  Index element;        ///< vertex or cell, by kind; the first of several
  Index count;          ///< how many elements have this defect
  std::string message;  ///< complete sentence naming the elements
};

/// Everything that keeps the mesh from being a Domain, at most one Defect per kind, worst first. Empty: the mesh is
/// good. Stops after the index checks when indices are out of range, since nothing else can be computed then.
std::vector<Defect> check_mesh(const Mesh& mesh);

/// Which defects repair_mesh mends. Non-finite coordinates, bad indices and non-manifold facets are never mended.
struct RepairOptions {
  bool unreferenced_vertices = true;  ///< drop them (vertex numbers change: see MeshRepair::vertex_origin)
  bool degenerate_cells = false;      ///< drop them (and cells with a repeated vertex)
  bool duplicate_cells = false;       ///< keep the first of each
  bool orientation = true;            ///< flip cells so that each component is consistently oriented, positively
                                      ///< (planar, tetrahedral), where the component is orientable
};

/// A mended mesh and what was done to it.
struct MeshRepair {
  Mesh mesh;
  std::vector<Index> vertex_origin;   ///< for each vertex of mesh, its number in the input
  std::vector<Index> cell_origin;     ///< for each cell of mesh, its number in the input
  std::vector<std::string> warnings;  ///< one sentence per kind of repair made, with the count; empty if none
};

/// Mends what the options allow. Never throws for a mesh that passes the index checks; what is left is found by
/// check_mesh. Throws DataError when indices are out of range.
MeshRepair repair_mesh(const Mesh& mesh, const RepairOptions& options = {});

}  // namespace variform
