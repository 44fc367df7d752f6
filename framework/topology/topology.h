// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <vector>

#include "framework/domain/domain.h"

namespace variform {

// Topology of triangle meshes: planar or surface domains, which are manifold and oriented. Tetrahedral domains are
// refused with a UsageError by everything here.

/// The two vertices of an edge.
using Edge = std::array<Index, 2>;

/// Counts of a mesh or of one of its components. Components are connected across edges. A fan is a set of cells around
/// a vertex that are connected across edges at it; a singular vertex has several fans, so that the mesh touches itself
/// there.
struct Topology {
  Index vertices = 0;
  Index edges = 0;
  Index cells = 0;
  Index components = 0;
  Index boundary_loops = 0;
  Index singular_vertices = 0;
  Index euler_characteristic = 0;  ///< vertices - edges + cells
  Index genus = 0;  ///< number of handles, summed over the components; singular vertices count once per fan

  bool is_disk() const { return components == 1 && boundary_loops == 1 && genus == 0 && singular_vertices == 0; }
};

/// Of the whole mesh.
Topology topology(const Domain& domain);

/// Of each component, numbered as Domain::cell_components; vertices at which components touch belong to each of them.
std::vector<Topology> component_topologies(const Domain& domain);

/// The boundary as closed sequences of vertices, each starting with its lowest vertex (not repeated at the end) and in
/// the direction that keeps the cells on the left; ordered by their first vertices. A loop does not cross itself or
/// others where boundaries touch: it stays with its fan of cells.
std::vector<std::vector<Index>> boundary_loops(const Domain& domain);

/// The vertices of a shortest path along edges, both ends included; one vertex when from == to.
/// Throws DataError when there is no such vertex or no path.
std::vector<Index> shortest_edge_path(const Domain& domain, Index from, Index to);

/// Interior edges (lower vertex first, in ascending order) that cut every component open to a disk when they become
/// boundary. None for a component that is a disk. For a closed component of genus 0: a shortest path of at least two
/// edges between two vertices far apart. Otherwise the edges that a spanning tree of the cells does not cross, without
/// dangling branches. The tree prefers to cross edges that close long loops with the tree of shortest paths from one
/// vertex or boundary loop, so that what is left is short (the greedy system of loops of Erickson and Whittlesey 2005).
/// The cut of an annulus is a shortest one.
/// Throws DataError naming the vertex for meshes with singular vertices.
std::vector<Edge> cut_graph(const Domain& domain);

/// A mesh cut open and where its vertices come from.
struct CutMesh {
  Mesh mesh;                         ///< cells in the order of the input; copies of vertices have equal positions
  std::vector<Index> vertex_origin;  ///< the input vertex of each vertex; the first ones are those of the input
};

/// Cuts a manifold triangle mesh along interior edges, which become boundary: every vertex of these edges gets one copy
/// for each further fan of cells that the cuts (and the boundary) leave around it. Copies are appended, in the order of
/// their origin; an edge may be given more than once, in any direction. The cells may be cut apart into components.
/// Throws DataError naming the edge when it is not in the mesh, is boundary already or has more than two cells, or
/// cannot be opened because neither end is on the boundary or on another cut; UsageError for tetrahedra.
CutMesh cut_along_edges(const Mesh& mesh, const std::vector<Edge>& edges);

}  // namespace variform
