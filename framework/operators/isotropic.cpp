// SPDX-License-Identifier: BSD-3-Clause
#include "framework/operators/isotropic.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace variform {
namespace {

constexpr double kHalfRoot = 0.5 * std::numbers::sqrt2;

Eigen::Matrix3d cofactors(const Eigen::Matrix3d& F) {
  Eigen::Matrix3d C;
  C.col(0) = F.col(1).cross(F.col(2));
  C.col(1) = F.col(2).cross(F.col(0));
  C.col(2) = F.col(0).cross(F.col(1));
  return C;
}

// vec(a b') for columns one after the other.
template <int M, int N>
Eigen::Matrix<double, M * N, 1> outer(const Eigen::Matrix<double, M, 1>& a, const Eigen::Matrix<double, N, 1>& b) {
  Eigen::Matrix<double, M * N, 1> m;
  for (int j = 0; j < N; ++j) m.template segment<M>(M * j) = b[j] * a;
  return m;
}

// The symmetric root of I - sum of mu m m' with negative eigenvalues set to zero takes away this much of each m m'.
double taken(double mu) { return mu < 1.0 ? 1.0 - std::sqrt(1.0 - mu) : 1.0; }

// d vec(F^-T) / d vec F = -C_ik C_lj at ((i, j), (l, k)) for C = F^-T.
template <int d>
void inverse_derivative(const Eigen::Matrix<double, d, d>& C, Eigen::Matrix<double, d * d, d * d>& D) {
  for (int k = 0; k < d; ++k) {
    for (int l = 0; l < d; ++l) {
      for (int j = 0; j < d; ++j) D.template block<d, 1>(d * j, d * k + l) = -C(l, j) * C.col(k);
    }
  }
}

// Largest positive root of t^3 + a t^2 + b t + c, or 0. Newton's iteration from a side where it is monotone.
double largest_positive_root(double a, double b, double c) {
  const auto q = [&](double t) { return ((t + a) * t + b) * t + c; };
  const auto slope = [&](double t) { return (3.0 * t + 2.0 * a) * t + b; };
  const double bound =
      2.0 * std::max({std::abs(a), std::sqrt(std::abs(b)), std::cbrt(std::abs(c)), std::numeric_limits<double>::min()});
  const double discriminant = a * a - 3.0 * b;
  const double inflection = -a / 3.0;
  // The curve falls to a minimum right of the inflection, or rises everywhere. Where it is not above zero there, the
  // largest root is to the right, on a convex part; else on the concave part left of the inflection.
  const double lowest = discriminant > 0.0 ? inflection + std::sqrt(discriminant) / 3.0 : inflection;
  const bool convex = q(lowest) <= 0.0;
  if (convex && lowest <= 0.0 && c >= 0.0) return 0.0;  // q rises from c on
  if (!convex && c >= 0.0) return 0.0;                  // the only root is not positive
  double t = convex ? bound : 0.0;
  for (int step = 0; step < 200; ++step) {
    const double rise = slope(t);
    if (!(rise > 0.0)) break;
    const double next = t - q(t) / rise;
    if (!(convex ? next < t : next > t)) break;
    t = next;
  }
  return t;
}

}  // namespace

Eigen::Matrix4d symmetric_dirichlet_root(const Eigen::Matrix2d& F) {
  // F is a similarity plus a reflected one: (a, b) and (c, d) in the bases I, J and diag(1, -1), offdiag(1, 1), over
  // sqrt 2 each. Twist and mean stretch are in the span of the first two, flip and difference of stretches in the
  // other.
  const double a = 0.5 * (F(0, 0) + F(1, 1));
  const double b = 0.5 * (F(1, 0) - F(0, 1));
  const double c = 0.5 * (F(0, 0) - F(1, 1));
  const double d = 0.5 * (F(1, 0) + F(0, 1));
  const double mean = std::sqrt(a * a + b * b);
  const double difference = std::sqrt(c * c + d * d);
  const double determinant = F.determinant();
  const double s1 = mean + difference;
  const double s2 = determinant / s1;
  const double ca = a / mean;
  const double sa = b / mean;
  const bool equal = !(difference > 0.0);  // then all four have the same eigenvalue but the twist
  const double cc = equal ? 1.0 : c / difference;
  const double sc = equal ? 0.0 : d / difference;
  const double squares = s1 * s1 + s2 * s2;
  const double cube = 1.0 / (determinant * determinant * determinant);
  const double i1 = 1.0 / (s1 * s1);
  const double i2 = 1.0 / (s2 * s2);
  const double twist = kHalfRoot * std::sqrt(std::max(0.0, 1.0 - (squares - determinant) * cube));
  const double flip = kHalfRoot * std::sqrt(1.0 + (squares + determinant) * cube);
  const double stretch1 = 0.5 * std::sqrt(1.0 + 3.0 * i1 * i1);
  const double stretch2 = 0.5 * std::sqrt(1.0 + 3.0 * i2 * i2);
  // vec of ca I + sa J etc.: (f11, f21, f12, f22).
  const Eigen::RowVector4d rotation(ca, sa, -sa, ca);
  const Eigen::RowVector4d reflection(cc, sc, sc, -cc);
  Eigen::Matrix4d R;
  R.row(0) = stretch1 * (rotation + reflection);
  R.row(1) = stretch2 * (rotation - reflection);
  R.row(2) = twist * Eigen::RowVector4d(-sa, ca, -ca, -sa);
  R.row(3) = flip * Eigen::RowVector4d(-sc, cc, cc, sc);
  return R;
}

Matrix99 symmetric_dirichlet_root(const Eigen::Matrix3d& F) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d& U = svd.matrixU();
  const Eigen::Matrix3d& V = svd.matrixV();
  const Eigen::Vector3d& s = svd.singularValues();
  Matrix99 R;
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3;
    const int j = (k + 2) % 3;
    const Eigen::Vector3d ui = U.col(i);
    const Eigen::Vector3d uj = U.col(j);
    const Eigen::Vector3d vi = V.col(i);
    const Eigen::Vector3d vj = V.col(j);
    const Eigen::Vector3d uk = U.col(k);
    const Eigen::Vector3d vk = V.col(k);
    const double product = s[i] * s[j];
    const double squares = s[i] * s[i] + s[j] * s[j];
    const double cube = 1.0 / (product * product * product);
    const double inverse = 1.0 / (s[k] * s[k]);
    const Eigen::Matrix<double, 9, 1> ij = outer<3, 3>(ui, vj);
    const Eigen::Matrix<double, 9, 1> ji = outer<3, 3>(uj, vi);
    R.row(k) = std::sqrt(1.0 + 3.0 * inverse * inverse) * outer<3, 3>(uk, vk).transpose();
    R.row(3 + k) = kHalfRoot * std::sqrt(std::max(0.0, 1.0 - (squares - product) * cube)) * (ij - ji).transpose();
    R.row(6 + k) = kHalfRoot * std::sqrt(1.0 + (squares + product) * cube) * (ij + ji).transpose();
  }
  return R;
}

Eigen::Matrix4d closest_rotation_root(const Eigen::Matrix2d& F) {
  const double p = F(0, 0) + F(1, 1);
  const double q = F(0, 1) - F(1, 0);
  const double length = std::hypot(p, q);  // s_1 + s_2
  if (!(length > 0.0)) return Eigen::Matrix4d::Identity();
  const double c = p / length;
  const double s = q / length;
  const Eigen::Vector4d twist = kHalfRoot * Eigen::Vector4d(-s, -c, c, -s);
  return Eigen::Matrix4d::Identity() - taken(2.0 / length) * twist * twist.transpose();
}

Matrix99 closest_rotation_root(const Eigen::Matrix3d& F) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sigma = svd.singularValues();
  Eigen::Matrix3d S = svd.matrixU();
  const Eigen::Matrix3d& V = svd.matrixV();
  if ((S * V.transpose()).determinant() < 0.0) {
    S.col(2) = -S.col(2);
    sigma[2] = -sigma[2];
  }
  Matrix99 R = Matrix99::Identity();
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3;
    const int j = (k + 2) % 3;
    const double sum = sigma[i] + sigma[j];
    if (!(sum > 0.0)) continue;  // not unique
    const Eigen::Vector3d ui = S.col(i);
    const Eigen::Vector3d uj = S.col(j);
    const Eigen::Vector3d vi = V.col(i);
    const Eigen::Vector3d vj = V.col(j);
    const Eigen::Matrix<double, 9, 1> twist = kHalfRoot * (outer<3, 3>(ui, vj) - outer<3, 3>(uj, vi));
    R -= taken(2.0 / sum) * twist * twist.transpose();
  }
  return R;
}

Matrix66 closest_orthonormal_rows_root(const Matrix23& F) {
  Matrix66 R = Matrix66::Identity();
  const Eigen::Matrix2d S = F * F.transpose();
  const double angle = 0.5 * std::atan2(2.0 * S(0, 1), S(0, 0) - S(1, 1));
  const Eigen::Vector2d u1(std::cos(angle), std::sin(angle));
  const Eigen::Vector2d u2(-u1[1], u1[0]);
  const Eigen::Vector3d first = F.transpose() * u1;
  const double s1 = first.norm();
  if (!(s1 > 0.0)) return R;
  const Eigen::Vector3d v1 = first / s1;
  Eigen::Vector3d second = F.transpose() * u2;
  second -= v1.dot(second) * v1;
  const double s2 = second.norm();
  if (!(s2 > 0.0)) return R;
  const Eigen::Vector3d v2 = second / s2;
  const Eigen::Vector3d n = v1.cross(v2);
  const Eigen::Matrix<double, 6, 1> twist = kHalfRoot * (outer<2, 3>(u1, v2) - outer<2, 3>(u2, v1));
  const Eigen::Matrix<double, 6, 1> normal1 = outer<2, 3>(u1, n);
  const Eigen::Matrix<double, 6, 1> normal2 = outer<2, 3>(u2, n);
  R -= taken(2.0 / (s1 + s2)) * twist * twist.transpose();
  R -= taken(1.0 / s1) * normal1 * normal1.transpose();
  R -= taken(1.0 / s2) * normal2 * normal2.transpose();
  return R;
}

bool inverse_transposed(const Eigen::Matrix2d& F, Eigen::Matrix2d& C, Eigen::Matrix4d* derivative) {
  if (derivative != nullptr) derivative->setZero();
  const double determinant = F.determinant();
  if (!(determinant > 0.0)) return false;
  const double inverse = 1.0 / determinant;
  C << inverse * F(1, 1), -inverse * F(1, 0), -inverse * F(0, 1), inverse * F(0, 0);
  if (derivative != nullptr) inverse_derivative<2>(C, *derivative);
  return true;
}

bool inverse_transposed(const Eigen::Matrix3d& F, Eigen::Matrix3d& C, Matrix99* derivative) {
  if (derivative != nullptr) derivative->setZero();
  const Eigen::Matrix3d all = cofactors(F);
  const double determinant = all.col(0).dot(F.col(0));
  if (!(determinant > 0.0)) return false;
  C = all / determinant;
  if (derivative != nullptr) inverse_derivative<3>(C, *derivative);
  return true;
}

double longest_unflipped_step(const Eigen::Matrix2d& F, const Eigen::Matrix2d& dF) {
  // With t = 1/s: t^2 + a t + b = 0, largest root.
  const double determinant = F.determinant();
  const double a = (F(0, 0) * dF(1, 1) + F(1, 1) * dF(0, 0) - F(0, 1) * dF(1, 0) - F(1, 0) * dF(0, 1)) / determinant;
  const double b = dF.determinant() / determinant;
  const double discriminant = a * a - 4.0 * b;
  if (!(discriminant >= 0.0)) return std::numeric_limits<double>::infinity();
  const double root = std::sqrt(discriminant);
  const double t = a <= 0.0 ? 0.5 * (root - a) : -2.0 * b / (root + a);
  return t > 0.0 ? 1.0 / t : std::numeric_limits<double>::infinity();
}

double longest_unflipped_step(const Eigen::Matrix3d& F, const Eigen::Matrix3d& dF) {
  const Eigen::Matrix3d of_F = cofactors(F);
  const Eigen::Matrix3d of_dF = cofactors(dF);
  const double determinant = of_F.col(0).dot(F.col(0));
  const double t =
      largest_positive_root(of_F.cwiseProduct(dF).sum() / determinant, of_dF.cwiseProduct(F).sum() / determinant,
                            of_dF.col(0).dot(dF.col(0)) / determinant);
  return t > 0.0 ? 1.0 / t : std::numeric_limits<double>::infinity();
}

}  // namespace variform
