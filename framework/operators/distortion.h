// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/base/types.h"
#include "framework/domain/domain.h"

namespace variform {

/// How a map of a planar or tetrahedral domain, given by vertex values U (|V| x p), distorts it. Singular values of the
/// deformation gradient, the smallest with the sign of its determinant; means are weighted by rest measure
/// (Martinez Esturo 2013, appendix B).
struct Distortion {
  double isometric = 0.0;  ///< mean of sum (sigma_i - 1)^2
  double conformal = 0.0;  ///< mean of (1/d) sum_{i<j} (sigma_i - sigma_j)^2
  double authalic = 0.0;   ///< mean of (prod sigma_i - 1)^2
  double metric = 0.0;     ///< mean of the directional mean of squared stretch, times d
  double min_determinant = 0.0;
  double area_ratio = 0.0;     ///< total signed measure of the image over that of the rest shape
  std::vector<Index> flipped;  ///< cells with determinant <= 0
};

/// Throws UsageError for surfaces and for U of another size.
Distortion distortion(const Domain& domain, const Matrix& U);

/// Pairs of boundary edges of a planar mesh that properly cross in the image U: 0 for an embedded boundary.
Index boundary_crossings(const Domain& domain, const Matrix& U);

}  // namespace variform
