// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "framework/operators/rotation.h"

namespace variform {

// Isotropic energies |F - c(F)|^2 of a deformation gradient F are sums of a function g of its signed singular values.
// With F = U S V' the eigenvectors of the Hessian by vec F (columns one after the other) are the stretches u_i v_i'
// with eigenvalue g''(s_i), the twists (u_i v_j' - u_j v_i') / sqrt 2 with (g'(s_i) + g'(s_j)) / (s_i + s_j), and the
// flips (u_i v_j' + u_j v_i') / sqrt 2 with (g'(s_i) - g'(s_j)) / (s_i - s_j) (Smith, de Goes, Kim 2019, Analytic
// Eigensystems for Isotropic Distortion Energies, sec. 4 and 5; the 3 x 3 block of the stretches is diagonal for such
// sums). The roots below are R with R'R = H+ / 2, the Hessian with its negative eigenvalues set to zero, halved.

/// Symmetric Dirichlet energy |F|^2 + |F^-1|^2 - 2d = |F - F^-T|^2, g(s) = (s - 1/s)^2, for det F > 0; only twists can
/// have a negative eigenvalue. Rows are scaled eigenvectors.
Eigen::Matrix4d symmetric_dirichlet_root(const Eigen::Matrix2d& F);
Matrix99 symmetric_dirichlet_root(const Eigen::Matrix3d& F);

/// Distance from the closest rotation |F - R|^2, g(s) = (s - 1)^2, with R of closest_rotation: H = 2 (I - dR/dF), whose
/// eigenvalues are 2 but for the twists. Symmetric. The identity where R is not unique.
Eigen::Matrix4d closest_rotation_root(const Eigen::Matrix2d& F);
Matrix99 closest_rotation_root(const Eigen::Matrix3d& F);
/// The same for closest_orthonormal_rows; with n normal to the rows of F, u_i n' has eigenvalue 2 (1 - 1 / s_i).
Matrix66 closest_orthonormal_rows_root(const Matrix23& F);

/// F^-T, and its derivative d vec F^-T / d vec F unless null. False, leaving C as it is and the derivative zero, where
/// not det F > 0.
bool inverse_transposed(const Eigen::Matrix2d& F, Eigen::Matrix2d& C, Eigen::Matrix4d* derivative = nullptr);
bool inverse_transposed(const Eigen::Matrix3d& F, Eigen::Matrix3d& C, Matrix99* derivative = nullptr);

/// Smallest s > 0 with det(F + s dF) = 0, for det F > 0: a root of a quadratic or cubic polynomial, to rounding.
/// Infinite when there is none.
double longest_unflipped_step(const Eigen::Matrix2d& F, const Eigen::Matrix2d& dF);
double longest_unflipped_step(const Eigen::Matrix3d& F, const Eigen::Matrix3d& dF);

}  // namespace variform
