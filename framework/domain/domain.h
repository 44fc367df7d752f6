// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/mesh.h"

namespace variform {

enum class DomainKind { planar, surface, tetrahedral };

/// "planar", "surface" or "tetrahedral".
std::string to_string(DomainKind kind);

/// Simplicial mesh with positions, on which energies are declared: cells (triangles or tetrahedra), facets (the faces
/// of cells that have one dimension less), measures, normals and gradient operators, all in flat arrays.
///
/// m is the intrinsic dimension of a cell (2 or 3) and p the ambient one: planar m=p=2, surface m=2 p=3, tetrahedral
/// m=p=3. Connectivity is fixed at construction; positions may move (set_positions), which recomputes what depends on
/// them in place, without allocation.
///
/// Source: Martinez Esturo 2013, appendix A; methods there use the transposed deformation gradient F_t = G_t U_t.
class Domain {
 public:
  /// Takes a mesh and derives everything. The kind follows from the mesh: four columns of cells are tetrahedra; two
  /// columns of positions, or three of which one is constant (it is dropped: see flattened), are planar; everything
  /// else is a surface. Throws DataError naming vertex, cell or facet when the mesh is not a manifold with consistently
  /// oriented, non-degenerate, distinct cells and no unreferenced vertices (see check_mesh for the complete list).
  explicit Domain(const Mesh& mesh);
  Domain(const Mesh& mesh, DomainKind kind);

  DomainKind kind() const { return kind_; }
  int intrinsic_dimension() const { return m_; }
  int ambient_dimension() const { return p_; }
  int cell_size() const { return m_ + 1; }

  Index vertex_count() const { return static_cast<Index>(positions_.rows()); }
  Index cell_count() const { return static_cast<Index>(cells_.rows()); }
  /// Interior facets: those with exactly two cells.
  Index facet_count() const { return static_cast<Index>(facet_cells_.rows()); }

  /// vertices x p.
  const Matrix& positions() const { return positions_; }
  /// cells x (m+1).
  const IndexMatrix& cells() const { return cells_; }
  /// facets x 2: the left and right cell of each interior facet.
  const IndexMatrix& facet_cells() const { return facet_cells_; }
  /// facets x m: the vertices of each interior facet, oriented as in the left cell.
  const IndexMatrix& facet_vertices() const { return facet_vertices_; }
  /// boundary facets x m, oriented as in their cell.
  const IndexMatrix& boundary_facets() const { return boundary_facets_; }
  /// The cell of each boundary facet.
  const IndexVector& boundary_cells() const { return boundary_cells_; }
  /// One flag per vertex.
  const std::vector<bool>& boundary_vertices() const { return boundary_vertices_; }

  /// Area or volume A_t of each cell, positive.
  const Vector& cell_measures() const { return cell_measures_; }
  /// Sum of the cell measures.
  double total_measure() const { return total_measure_; }
  /// Length or area |f| of each interior facet.
  const Vector& facet_measures() const { return facet_measures_; }
  /// cells x 3 unit normals of a surface; empty otherwise.
  const Matrix& normals() const { return normals_; }
  /// Length of the diagonal of the bounding box.
  double diameter() const { return diameter_; }

  /// Gradient operator G_t of linear functions on cell t, p x (m+1): column i is the gradient of the hat function of
  /// local vertex i (Martinez Esturo 2013, appendix A.1). On surfaces its columns lie in the tangent plane.
  Eigen::Map<const Eigen::MatrixXd> gradient(Index t) const {
    return {gradients_.data() + static_cast<std::size_t>(t) * p_ * (m_ + 1), p_, m_ + 1};
  }

  /// Moves the vertices (vertices x p), keeping the connectivity.
  /// Throws DataError naming the cell when one degenerates; the domain is then unchanged.
  void set_positions(const Matrix& positions);

  /// Facet-connected component of each cell, numbered from 0, and their count. Cells that meet only in a vertex belong
  /// to different components.
  const IndexVector& cell_components() const { return cell_components_; }
  Index component_count() const { return component_count_; }

 private:
  void build_connectivity();
  void build_components();
  void update_geometry();

  DomainKind kind_;
  int m_ = 0;
  int p_ = 0;
  Matrix positions_;
  Matrix previous_positions_;  // to go back when set_positions fails
  IndexMatrix cells_;
  IndexMatrix facet_cells_;
  IndexMatrix facet_vertices_;
  IndexMatrix boundary_facets_;
  IndexVector boundary_cells_;
  std::vector<bool> boundary_vertices_;
  Vector cell_measures_;
  Vector facet_measures_;
  Matrix normals_;
  std::vector<double> gradients_;
  double total_measure_ = 0.0;
  double diameter_ = 0.0;
  IndexVector cell_components_;
  Index component_count_ = 0;
};

}  // namespace variform
