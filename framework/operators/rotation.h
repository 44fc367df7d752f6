// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace variform {

using Matrix23 = Eigen::Matrix<double, 2, 3>;
using Matrix32 = Eigen::Matrix<double, 3, 2>;
using Matrix66 = Eigen::Matrix<double, 6, 6>;
using Matrix99 = Eigen::Matrix<double, 9, 9>;

// Closest rotations in the Frobenius norm, and how they move with the matrix. Each function returns false, leaving R as
// it is and the derivative zero, where the closest one is not unique. `derivative`, unless null, becomes
// d vec R / d vec F (columns one after the other); where it is nearly singular its growth is clamped: sums of singular
// values below 1e-6 of the largest one count as that.

/// Planar: R = [p q; -q p] / hypot(p, q) with p = f11 + f22, q = f12 - f21, always det +1 (methods: errata C4). Not
/// unique for reflected similarities.
bool closest_rotation(const Eigen::Matrix2d& F, Eigen::Matrix2d& R, Eigen::Matrix4d* derivative = nullptr);

/// In a plane of space with unit normal n: for F whose columns lie in that plane, B' R with the closest rotation R of
/// B F, the same for all frames B (2 x 3) of the plane that n orients.
bool closest_rotation(const Eigen::Vector3d& normal, const Matrix32& F, Matrix32& R);

/// In space, through the singular value decomposition with det R = +1: the sign goes to the smallest singular value.
/// Not unique when the two smallest signed singular values sum to zero.
bool closest_rotation(const Eigen::Matrix3d& F, Eigen::Matrix3d& R, Matrix99* derivative = nullptr);

/// Closest matrix with orthonormal rows, the polar factor (F F')^(-1/2) F: the deformation of a triangle in space
/// towards an isometry, in tangent coordinates of the rest triangle. For a frame B (2 x 3) of the rest triangle with
/// normal n and F = B G U, B' R equals (I - n n') R* of the normal-completed rotation R* in Martinez Esturo 2013,
/// sec. 7.4.3 (methods: errata C6). Not unique when F has rank below 2.
bool closest_orthonormal_rows(const Matrix23& F, Matrix23& R, Matrix66* derivative = nullptr);

}  // namespace variform
