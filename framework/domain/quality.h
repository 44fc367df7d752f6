// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/domain/domain.h"

namespace variform {

/// Shape of the cells of a mesh; angles in degrees, lengths in units of the mesh.
struct MeshQuality {
  double min_angle = 0.0;  ///< smallest inner angle (triangles) or dihedral angle (tetrahedra)
  double max_angle = 0.0;
  double min_measure = 0.0;
  double max_measure = 0.0;
  double measure_ratio = 1.0;     ///< largest over smallest cell measure (Martinez Esturo 2013, Figure 55)
  double max_radius_ratio = 0.0;  ///< largest circumradius / inradius; 2 for an equilateral triangle, 3 for a regular
                                  ///< tetrahedron
  double min_mean_ratio = 0.0;    ///< smallest mean ratio: 1 for a regular simplex, towards 0 when flat
  double min_edge = 0.0;
  double max_edge = 0.0;
  double mean_edge = 0.0;  ///< over the edges of all cells: an edge counts once for every cell it belongs to
};

/// Computes all measures in one pass over the cells.
MeshQuality mesh_quality(const Domain& domain);

/// circumradius / inradius of each cell.
Vector radius_ratios(const Domain& domain);

}  // namespace variform
