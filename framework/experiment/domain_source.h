// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "framework/base/registry.h"
#include "framework/domain/domain.h"
#include "framework/experiment/config.h"

namespace variform {

/// How a mesh generator is known to configs ([domain] generator = "...") and to `variform list`.
struct GeneratorEntry {
  std::string name = {};
  std::string doc = {};
  std::vector<Parameter> parameters = {};
  std::function<Mesh(const Parameters&)> make = {};
};

/// All generators.
const Registry<GeneratorEntry>& generators();

/// Tables of [domain] that change its mesh, with what they accept, for `variform list`.
struct DomainModifier {
  std::string name = {};  ///< "degrade": [domain.degrade]
  std::string doc = {};
  std::vector<Parameter> parameters = {};
};
const std::vector<DomainModifier>& domain_modifiers();

/// A domain as [domain] describes it:
///
///   [domain]
///   generator = "strip"          # with its parameters beside it
///   # or
///   mesh = "file.obj"            # looked up as find_input does
///   triangulate = false          # split polygons
///   repair = ["orientation", "unreferenced_vertices", "degenerate_cells", "duplicate_cells"]  # default: the first two
///   kind = "surface"             # flat triangle meshes as surfaces in space, z = 0; without it they are planar
///   centred = false              # true: the centre of the bounding box goes to the origin, before the scale
///   scale = 1.0                  # multiplies all coordinates
///   [domain.degrade]             # a badly tessellated variant (planar): jitter, flip_fraction, refinements, seed
///   [domain.cut]                 # triangle meshes, one of:
///   path = [v0, v1, ...]         # along shortest edge paths from each vertex to the next (boundary edges left out)
///   edges = [[a, b], ...]        # along these edges
///   to_disk = true               # open to a disk, each component: cut_graph of framework/topology/topology.h
///
/// Vertex numbers in configs and results are those of the input, whatever repairs dropped. A degraded mesh is an input
/// of its own. A cut comes last and keeps these numbers; the copies of vertices that it makes follow behind.
struct LoadedDomain {
  Domain domain;
  std::vector<std::string> warnings;  ///< what reading and repairing changed
  Mesh input;                         ///< the mesh before repairs, scaled; positions as in the file (x 2 or 3); after a
                                      ///< cut, its cells are those of the domain and copies of vertices are appended
  std::vector<Index> vertex_origin;   ///< input vertex of each vertex of the domain, ascending
  std::vector<Index> uncut_vertex;    ///< the vertex of the uncut mesh that each vertex of the domain comes from; as
                                      ///< vertex_origin where nothing is cut
  Index uncut_vertex_count;           ///< of the uncut mesh, whose vertices are the first ones of the input

  /// Vertex of the domain for a vertex of the input; -1 when a repair dropped it. Throws DataError when the input has
  /// no such vertex.
  Index domain_vertex(std::int64_t input_vertex) const;

  /// A state U of the domain (|V| x p) as a mesh with the vertices of the input in their order, dropped ones at rest,
  /// and the coordinate that flattening dropped. Cells are those of the domain.
  Mesh as_input(const Matrix& U) const;
  /// The mesh before the cut: positions of the input, cells of the domain. With a map U of the domain to the plane,
  /// write_obj_uv(path, uncut(), U, domain.cells()) puts the cut into its seams.
  Mesh uncut() const;
  /// Values per vertex of the domain as values per vertex of the input, 0 at dropped ones.
  Matrix values_as_input(const Matrix& values) const;
};

/// Throws UsageError for a [domain] that makes no sense whatever is in its mesh file.
void check_domain(const ConfigNode& node);

/// Throws UsageError for configs that make no sense and DataError, with the file's name, for broken meshes.
LoadedDomain load_domain(const ConfigNode& node, const std::filesystem::path& config_folder);

}  // namespace variform
