// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/base/types.h"
#include "framework/domain/domain.h"

namespace variform {

/// How a map given by vertex values U (|V| x d) distorts each cell (Martinez Esturo 2013, appendix B). Maps of
///
///   planar domains to the plane (d = 2) and tetrahedral ones to space (d = 3),
///   surfaces to the plane (d = 2): a parametrization, mirrored triangles have a negative determinant,
///   surfaces to space (d = 3): a deformation; no side of the image is the right one, so determinants are not negative.
///
/// Singular values sigma_1 >= ... >= sigma_m of the deformation gradient on the cell (its tangent plane on surfaces),
/// the last one with the sign of the determinant. One entry per cell.
struct CellDistortion {
  Matrix singular_values;      ///< cells x m
  Vector determinant;          ///< prod sigma_i: signed ratio of measures
  Vector isometric;            ///< sum (sigma_i - 1)^2
  Vector conformal;            ///< (1/m) sum_{i<j} (sigma_i - sigma_j)^2
  Vector authalic;             ///< (prod sigma_i - 1)^2
  Vector metric;               ///< m times the mean over unit vectors r of (r'(Sigma - I) r)^2, Sigma = diag(sigma)
  Vector symmetric_dirichlet;  ///< sum sigma_i^2 + 1/sigma_i^2, at least 2m; infinite where flipped
  Vector conformal_ratio;      ///< sigma_1 / sigma_m, at least 1; infinite where flipped
  std::vector<Index> flipped;  ///< cells with determinant <= 0; of maps of surfaces to space those whose image is
                               ///< degenerate, determinant <= kDegenerateImage sigma_1^2
};

/// Image triangles in space whose two singular values have at most this ratio count as degenerate.
inline constexpr double kDegenerateImage = 1e-12;

/// Throws UsageError for U of another size.
CellDistortion cell_distortion(const Domain& domain, const Matrix& U);

/// Means over all cells, weighted by rest measure, and extremes of the fields of CellDistortion.
struct Distortion {
  double isometric = 0.0;
  double conformal = 0.0;
  double authalic = 0.0;
  double metric = 0.0;
  double symmetric_dirichlet = 0.0;  ///< infinite when a cell is flipped
  double max_conformal_ratio = 0.0;  ///< largest sigma_1 / sigma_m; infinite when a cell is flipped
  double min_determinant = 0.0;
  double area_ratio = 0.0;     ///< total signed measure of the image over that of the rest shape
  std::vector<Index> flipped;  ///< as in CellDistortion
};

/// Throws UsageError for U of another size.
Distortion distortion(const Domain& domain, const Matrix& U);
Distortion distortion(const Domain& domain, const CellDistortion& cells);

/// Pairs of boundary edges of a planar or surface mesh that properly cross in the plane image U (|V| x 2): 0 for an
/// embedded boundary.
Index boundary_crossings(const Domain& domain, const Matrix& U);

}  // namespace variform
