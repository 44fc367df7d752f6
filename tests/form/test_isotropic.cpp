// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/operators/isotropic.h"

namespace variform {
namespace {

// Half the Hessian of |F - c(F)|^2 by differences of its gradient 2 (I - D)'(F - c), and that with its negative
// eigenvalues set to zero.
template <class M, class Target>
Eigen::MatrixXd projected_half_hessian(const M& F, const Target& target, double* least) {
  constexpr int n = M::SizeAtCompileTime;
  using Jacobian = Eigen::Matrix<double, n, n>;
  using Vec = Eigen::Matrix<double, n, 1>;
  const auto half_gradient = [&](const M& at) -> Vec {
    M C;
    Jacobian D;
    EXPECT_TRUE(target(at, C, &D));
    const M r = at - C;
    const Eigen::Map<const Vec> vec(r.data());
    return vec - D.transpose() * vec;
  };
  const double step = 1e-6;
  Eigen::MatrixXd H(n, n);
  for (int k = 0; k < n; ++k) {
    M forward = F;
    M backward = F;
    forward.data()[k] += step;
    backward.data()[k] -= step;
    H.col(k) = (half_gradient(forward) - half_gradient(backward)) / (2 * step);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(0.5 * (H + H.transpose()));
  *least = eigen.eigenvalues().minCoeff();
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * eigen.eigenvectors().transpose();
}

template <class M, class Target, class Root>
void expect_projected_hessians(const Target& target, const Root& root, double least_size, double largest_size) {
  std::srand(3);
  int indefinite = 0;
  int definite = 0;
  for (int sample = 0; sample < 200; ++sample) {
    M F = M::Random();
    if constexpr (static_cast<int>(M::RowsAtCompileTime) == static_cast<int>(M::ColsAtCompileTime)) {
      if (F.determinant() < 0.05) F.row(0) = -F.row(0);
      if (F.determinant() < 0.05) continue;
      if (sample % 10 == 0) F.setIdentity();  // equal singular values
    }
    F *= least_size + (largest_size - least_size) * (sample % 7) / 6.0;
    double least = 0.0;
    const Eigen::MatrixXd expected = projected_half_hessian(F, target, &least);
    const auto R = root(F);
    const Eigen::MatrixXd found = R.transpose() * R;
    EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-6 * (1.0 + expected.cwiseAbs().maxCoeff())) << F;
    (least < -1e-6 ? indefinite : definite) += 1;
  }
  EXPECT_GT(indefinite, 10);
  EXPECT_GT(definite, 10);
}

TEST(Isotropic, RootsOfSymmetricDirichletAreThoseOfItsProjectedHessian) {
  const auto target = [](const auto& F, auto& C, auto* D) { return inverse_transposed(F, C, D); };
  const auto root = [](const auto& F) { return symmetric_dirichlet_root(F); };
  expect_projected_hessians<Eigen::Matrix2d>(target, root, 0.7, 4.0);
  expect_projected_hessians<Eigen::Matrix3d>(target, root, 0.9, 5.0);
}

TEST(Isotropic, RootsOfDistancesFromRotationsAreThoseOfTheirProjectedHessian) {
  const auto target = [](const auto& F, auto& C, auto* D) { return closest_rotation(F, C, D); };
  const auto root = [](const auto& F) { return closest_rotation_root(F); };
  expect_projected_hessians<Eigen::Matrix2d>(target, root, 0.7, 4.0);
  expect_projected_hessians<Eigen::Matrix3d>(target, root, 0.7, 5.0);
  expect_projected_hessians<Matrix23>([](const auto& F, auto& C, auto* D) { return closest_orthonormal_rows(F, C, D); },
                                      [](const auto& F) { return closest_orthonormal_rows_root(F); }, 0.7, 5.0);
}

TEST(Isotropic, SymmetricDirichletIsTheDistanceFromTheInverseTransposed) {
  std::srand(2);
  for (int sample = 0; sample < 20; ++sample) {
    Eigen::Matrix3d F = Eigen::Matrix3d::Random();
    if (F.determinant() < 0.0) F = -F;
    Eigen::Matrix3d C;
    ASSERT_TRUE(inverse_transposed(F, C));
    const double energy = F.squaredNorm() + F.inverse().squaredNorm() - 6.0;
    EXPECT_NEAR((F - C).squaredNorm(), energy, 1e-10 * (1.0 + energy));
    EXPECT_FALSE(inverse_transposed(Eigen::Matrix3d(-F), C));
    Eigen::Matrix2d unchanged;
    EXPECT_FALSE(inverse_transposed(Eigen::Matrix2d::Zero(), unchanged));
  }
}

// Against the sign of the determinant on a fine grid of steps.
template <int d>
void expect_first_zero() {
  using M = Eigen::Matrix<double, d, d>;
  std::srand(4);
  int finite = 0;
  int infinite = 0;
  for (int sample = 0; sample < 500; ++sample) {
    M F = M::Random();
    if (F.determinant() < 0.0) F.row(0) = -F.row(0);
    M dF = M::Random();
    if (sample % 5 == 0) dF = F * (M::Identity() + 0.1 * M::Random());  // grows
    if (sample % 5 == 1) dF *= 1e-8;
    if (sample % 5 == 2) dF *= 1e8;
    if (sample % 50 == 3) dF = dF.col(0) * dF.row(0).eval();  // rank one: a linear polynomial
    const double s = longest_unflipped_step(F, dF);
    EXPECT_GT(s, 0.0);
    const double reach = std::isfinite(s) ? s : 1e3 * F.norm() / dF.norm();
    const double size = std::pow(F.norm() + reach * dF.norm(), d);
    for (int k = 0; k < 2000; ++k) EXPECT_GT((F + reach * k / 2000.0 * dF).determinant(), -1e-14 * size);
    if (std::isfinite(s)) {
      ++finite;
      EXPECT_LT(std::abs((F + s * dF).determinant()), 1e-12 * size);
    } else {
      ++infinite;
    }
  }
  EXPECT_GT(finite, 50);
  EXPECT_GT(infinite, 50);
}

TEST(Isotropic, LongestStepEndsAtTheFirstZeroOfTheDeterminant) {
  expect_first_zero<2>();
  expect_first_zero<3>();
}

TEST(Isotropic, LongestStepOfKnownPolynomials) {
  const Eigen::Matrix2d I = Eigen::Matrix2d::Identity();
  EXPECT_DOUBLE_EQ(longest_unflipped_step(I, -0.25 * I), 4.0);  // double zero
  EXPECT_EQ(longest_unflipped_step(I, Eigen::Matrix2d::Zero()), std::numeric_limits<double>::infinity());
  EXPECT_EQ(longest_unflipped_step(I, Eigen::Matrix2d{{0.0, -1.0}, {1.0, 0.0}}),
            std::numeric_limits<double>::infinity());
  const Eigen::Matrix3d J = Eigen::Matrix3d::Identity();
  EXPECT_EQ(longest_unflipped_step(J, Eigen::Matrix3d::Zero()), std::numeric_limits<double>::infinity());
  EXPECT_EQ(longest_unflipped_step(J, J), std::numeric_limits<double>::infinity());
  const Eigen::Vector3d rates(-0.5, -0.2, 0.3);  // (1 - s/2) (1 - s/5) (1 + 3s/10)
  EXPECT_NEAR(longest_unflipped_step(J, Eigen::Matrix3d(rates.asDiagonal())), 2.0, 1e-14);
  EXPECT_NEAR(longest_unflipped_step(J, Eigen::Matrix3d(-0.25 * J)), 4.0, 1e-4);  // triple zero
}

}  // namespace
}  // namespace variform
