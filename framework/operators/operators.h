// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/base/types.h"
#include "framework/domain/domain.h"

namespace variform {

/// Global gradient operator, p|T| x |V|, component-major: block r (|T| rows) holds row r of every cell gradient G_t
/// (Martinez Esturo 2013, appendix A.1).
SparseMatrix gradient_matrix(const Domain& domain);

/// Cotangent Laplacian L = sum_t A_t G_t' G_t, |V| x |V|, symmetric positive semi-definite, all entries stored.
/// Off-diagonal entries are -(cot a + cot b)/2 on triangles; the kernel holds the constants of each component.
SparseMatrix cotangent_laplacian(const Domain& domain);

/// Consistent mass matrix: integrals of products of hat functions, |V| x |V|, symmetric positive definite, all entries
/// stored; triangle A/6 and A/12, tetrahedron V/10 and V/20 (Martinez Esturo 2013, appendix A.2).
SparseMatrix mass_matrix(const Domain& domain);

/// Gradient operator of a triangle, p x 3, on the stack.
using TriangleGradient = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::ColMajor, 3, 3>;

/// n_t x G_t: the gradients of cell t of a planar (n = z) or surface domain turned by a right angle, counter-clockwise
/// about the normal; p x 3. Not defined on tetrahedra.
TriangleGradient turned_gradient(const Domain& domain, Index t);

/// A tangent frame: two orthonormal rows, 2 x p.
using TangentFrame = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2, 3>;

/// Frame of triangle t, counter-clockwise: along its first edge, and the normal times that. For what does not depend on
/// the choice of frames.
TangentFrame edge_frame(const Domain& domain, Index t);

/// The same on a surface (m = 2, p = 3), of fixed size.
using SurfaceFrame = Eigen::Matrix<double, 2, 3>;
SurfaceFrame surface_frame(const Domain& domain, Index t);

/// Transposed deformation gradient F_t = G_t U_t of cell t (p x d) for vertex values U (|V| x d): column c is the
/// gradient of coordinate function c. At rest F = I (planar, tetrahedral) or I - n n' (surface).
Eigen::MatrixXd deformation(const Domain& domain, Index t, const Matrix& U);

}  // namespace variform
