// SPDX-License-Identifier: BSD-3-Clause
#include "framework/operators/rotation.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace variform {
namespace {

constexpr double kNotUnique = 1e-14;
constexpr double kClamp = 1e-6;

// The axial vector of a skew matrix A = [a]x.
Eigen::Vector3d axial(const Eigen::Matrix3d& A) { return {A(2, 1), A(0, 2), A(1, 0)}; }

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& a) {
  Eigen::Matrix3d A;
  A << 0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0;
  return A;
}

// The closest rotation of a matrix well away from singular ones with positive determinant, where it is the orthogonal
// polar factor: Newton's iteration X -> (X + X^-T) / 2, scaled in the first steps (Higham 1986). False for others.
bool polar_rotation(const Eigen::Matrix3d& F, Eigen::Matrix3d& R) {
  constexpr double kWellConditioned = 1e-3;
  const double size = F.norm();
  if (!(size > 1e-100 && size < 1e100)) return false;  // cubes of it stay in range
  Eigen::Matrix3d X = F / size;
  Eigen::Matrix3d cofactors;
  for (int step = 0; step < 20; ++step) {
    cofactors.col(0) = X.col(1).cross(X.col(2));
    cofactors.col(1) = X.col(2).cross(X.col(0));
    cofactors.col(2) = X.col(0).cross(X.col(1));
    const double determinant = X.col(0).dot(cofactors.col(0));
    if (step == 0 && !(determinant > kWellConditioned)) return false;
    const Eigen::Matrix3d inverse = cofactors / determinant;  // transposed
    // The scaling sqrt(|X^-1| / |X|) is 1 at a rotation.
    const double x = X.squaredNorm();
    const double y = inverse.squaredNorm();
    const double scale = std::sqrt(std::sqrt(y / x));
    const Eigen::Matrix3d next = (0.5 * scale) * X + (0.5 / scale) * inverse;
    const double change = (next - X).squaredNorm();
    X = next;
    // The error is squared in each step: this one made it vanish.
    if (change < 1e-17) {
      R = X;
      return true;
    }
  }
  return false;
}

}  // namespace

bool closest_rotation(const Eigen::Matrix2d& F, Eigen::Matrix2d& R, Eigen::Matrix4d* derivative) {
  if (derivative != nullptr) derivative->setZero();
  const double p = F(0, 0) + F(1, 1);
  const double q = F(0, 1) - F(1, 0);
  const double length2 = p * p + q * q;
  const double size2 = F.squaredNorm();
  if (!(length2 > kNotUnique * kNotUnique * size2)) return false;
  const double length = std::sqrt(length2);
  const double scale = 1.0 / length;
  const double c = p * scale;
  const double s = q * scale;
  R << c, s, -s, c;
  if (derivative != nullptr) {
    // R turns by the angle alpha = atan2(q, p); rank one: (dR/dalpha) (dalpha/dF)'.
    const Eigen::Vector4d turn(-s, -c, c, -s);
    const Eigen::Vector4d rate(-s, -c, c, -s);
    *derivative = turn * rate.transpose() / std::max(length, kClamp * std::sqrt(size2));
  }
  return true;
}

bool closest_rotation(const Eigen::Vector3d& normal, const Matrix32& F, Matrix32& R) {
  // The similarity part of F maps the image axes to w and its quarter turn n x w; the rotation is that of length 1.
  const Eigen::Vector3d w = F.col(0) - normal.cross(F.col(1));
  const double length2 = w.squaredNorm();
  if (!(length2 > kNotUnique * kNotUnique * F.squaredNorm())) return false;
  R.col(0) = w / std::sqrt(length2);
  R.col(1) = normal.cross(R.col(0));
  return true;
}

bool closest_rotation(const Eigen::Matrix3d& F, Eigen::Matrix3d& R, Matrix99* derivative) {
  if (derivative == nullptr && polar_rotation(F, R)) return true;
  if (derivative != nullptr) derivative->setZero();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sigma = svd.singularValues();
  Eigen::Matrix3d S = svd.matrixU();
  if ((S * svd.matrixV().transpose()).determinant() < 0.0) {
    S.col(2) = -S.col(2);
    sigma[2] = -sigma[2];
  }
  if (!(sigma[1] + sigma[2] > kNotUnique * sigma[0])) return false;
  const Eigen::Matrix3d& V = svd.matrixV();
  R = S * V.transpose();
  if (derivative != nullptr) {
    // With F = R Y: dR = R [w]x, (tr(Y) I - Y) w = axial(R' dF - dF' R).
    Eigen::Vector3d inverse;
    for (int k = 0; k < 3; ++k) {
      inverse[k] = 1.0 / std::max(sigma[(k + 1) % 3] + sigma[(k + 2) % 3], kClamp * sigma[0]);
    }
    const Eigen::Matrix3d solve = V * inverse.asDiagonal() * V.transpose();
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) {
        Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
        A.col(j) = R.row(i).transpose();  // R' dF for the unit matrix dF = e_i e_j'
        const Eigen::Matrix3d dR = R * cross_matrix(solve * axial(A - A.transpose()));
        derivative->col(3 * j + i) = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(dR.data());
      }
    }
  }
  return true;
}

bool closest_orthonormal_rows(const Matrix23& F, Matrix23& R, Matrix66* derivative) {
  if (derivative != nullptr) derivative->setZero();
  // The root of a symmetric 2 x 2 matrix: sqrt(S) = (S + sqrt(det S) I) / sqrt(tr S + 2 sqrt(det S)). The determinant
  // through the cross product of the rows: no cancellation.
  const Eigen::Matrix2d S = F * F.transpose();
  const Eigen::Vector3d first = F.row(0).transpose();
  const Eigen::Vector3d second = F.row(1).transpose();
  const double delta = first.cross(second).norm();
  const double trace = S.trace();
  const double scale = std::sqrt(trace + 2.0 * delta);
  if (!(delta > kNotUnique * trace && scale * delta > 1e-300)) return false;
  // P = (S + delta I) / scale with det P = delta.
  Eigen::Matrix2d adjugate;  // of scale P
  adjugate << S(1, 1) + delta, -S(0, 1), -S(1, 0), S(0, 0) + delta;
  R.noalias() = (1.0 / (scale * delta)) * adjugate * F;
  if (derivative != nullptr) {
    // With F = P R: dR = w [0 -1; 1 0] R + P^-1 dF (I - R'R), tr(P) w = (dF R')_21 - (dF R')_12.
    const double largest = scale;  // trace of P
    const Eigen::Matrix2d inverse = adjugate / (scale * std::max(delta, kClamp * largest * largest));
    const Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() - R.transpose() * R;
    Matrix23 turned;
    turned.row(0) = -R.row(1);
    turned.row(1) = R.row(0);
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 2; ++i) {
        const double w = (i == 1 ? R(0, j) : -R(1, j)) / largest;
        const Matrix23 dR = w * turned + inverse.col(i) * normal.row(j);
        derivative->col(2 * j + i) = Eigen::Map<const Eigen::Matrix<double, 6, 1>>(dR.data());
      }
    }
  }
  return true;
}

}  // namespace variform
