// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "framework/operators/rotation.h"

namespace variform {
namespace {

template <class M, class Closest>
void expect_derivative_of_differences(const M& F, const Closest& closest) {
  using Jacobian = Eigen::Matrix<double, M::SizeAtCompileTime, M::SizeAtCompileTime>;
  M R;
  Jacobian D;
  ASSERT_TRUE(closest(F, R, &D));
  Jacobian* const none = nullptr;
  Jacobian differences;
  const double step = 1e-6;
  for (int k = 0; k < M::SizeAtCompileTime; ++k) {
    M forward = F;
    M backward = F;
    forward(k % M::RowsAtCompileTime, k / M::RowsAtCompileTime) += step;
    backward(k % M::RowsAtCompileTime, k / M::RowsAtCompileTime) -= step;
    M a;
    M b;
    ASSERT_TRUE(closest(forward, a, none));
    ASSERT_TRUE(closest(backward, b, none));
    const M slope = (a - b) / (2 * step);
    differences.col(k) = Eigen::Map<const Eigen::Matrix<double, M::SizeAtCompileTime, 1>>(slope.data());
  }
  EXPECT_LT((D - differences).cwiseAbs().maxCoeff(), 1e-6 * (1.0 + D.cwiseAbs().maxCoeff())) << F;
}

TEST(ClosestRotation, PlanarIsARotationAndNoOtherIsCloser) {
  std::srand(1);
  for (int sample = 0; sample < 50; ++sample) {
    const Eigen::Matrix2d F = Eigen::Matrix2d::Random();
    Eigen::Matrix2d R;
    ASSERT_TRUE(closest_rotation(F, R));
    EXPECT_NEAR(R.determinant(), 1.0, 1e-14);
    EXPECT_LT((R * R.transpose() - Eigen::Matrix2d::Identity()).norm(), 1e-14);
    for (double angle = 0.0; angle < 6.3; angle += 0.1) {
      EXPECT_GE((F - Eigen::Rotation2Dd(angle).toRotationMatrix()).norm(), (F - R).norm() - 1e-14);
    }
    expect_derivative_of_differences(F, [](const auto& A, auto& B, auto* D) { return closest_rotation(A, B, D); });
  }
}

TEST(ClosestRotation, OfAPlaneInSpaceIsThePlanarOneInEveryFrame) {
  std::srand(8);
  for (int sample = 0; sample < 50; ++sample) {
    const Eigen::Matrix3d Q = Eigen::Quaterniond::UnitRandom().toRotationMatrix();
    const Matrix23 B = Q.topRows<2>();  // oriented by the third row
    const Eigen::Matrix2d F = Eigen::Matrix2d::Random();
    Eigen::Matrix2d planar;
    ASSERT_TRUE(closest_rotation(F, planar));
    Matrix32 R;
    ASSERT_TRUE(closest_rotation(Eigen::Vector3d(Q.row(2)), Matrix32(B.transpose() * F), R));
    EXPECT_LT((R - B.transpose() * planar).norm(), 1e-14);
    Eigen::Matrix2d reflected;  // as far from all rotations
    reflected << 1.0, 0.0, 0.0, -1.0;
    Matrix32 unchanged = R;
    EXPECT_FALSE(closest_rotation(Eigen::Vector3d::UnitZ(),
                                  Matrix32(Eigen::Matrix3d::Identity().leftCols<2>() * reflected), unchanged));
    EXPECT_EQ(unchanged, R);
  }
}

TEST(ClosestRotation, InSpaceIsARotationAndNoOtherIsCloser) {
  std::srand(2);
  for (int sample = 0; sample < 50; ++sample) {
    const Eigen::Matrix3d F = Eigen::Matrix3d::Random();  // half of them reflect
    Eigen::Matrix3d R;
    ASSERT_TRUE(closest_rotation(F, R));
    EXPECT_NEAR(R.determinant(), 1.0, 1e-13);
    EXPECT_LT((R * R.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-13);
    for (int other = 0; other < 200; ++other) {
      const Eigen::Matrix3d Q = Eigen::Quaterniond::UnitRandom().toRotationMatrix();
      EXPECT_GE((F - Q).norm(), (F - R).norm() - 1e-13);
    }
    // Near the singular set differences of any step are off: keep away from it.
    const Eigen::Vector3d s = F.jacobiSvd().singularValues();
    if (s[1] + (F.determinant() < 0.0 ? -s[2] : s[2]) < 0.05) continue;
    expect_derivative_of_differences(F, [](const auto& A, auto& B, auto* D) { return closest_rotation(A, B, D); });
  }
}

// Without the derivative well-conditioned matrices take a shorter way than the singular value decomposition.
TEST(ClosestRotation, InSpaceIsTheSameWithAndWithoutItsDerivative) {
  std::srand(4);
  for (int sample = 0; sample < 2000; ++sample) {
    // Rotations near and far, stretched by up to 1e6 in ratio, of any size.
    const Eigen::Matrix3d Q = Eigen::Quaterniond::UnitRandom().toRotationMatrix();
    const Eigen::Matrix3d V = Eigen::Quaterniond::UnitRandom().toRotationMatrix();
    const double spread = sample % 7;
    const Eigen::Vector3d sigma = (spread * 2.3 * Eigen::Array3d::Random()).exp();
    const double size = std::pow(10.0, sample % 5 * 60 - 120);
    const Eigen::Matrix3d F = size * Q * V * sigma.asDiagonal() * V.transpose();
    Eigen::Matrix3d direct;
    Eigen::Matrix3d by_svd;
    Matrix99 D;
    ASSERT_TRUE(closest_rotation(F, by_svd, &D));
    ASSERT_TRUE(closest_rotation(F, direct));
    // The two smallest singular values say how well it is determined.
    std::array<double, 3> sorted = {sigma[0], sigma[1], sigma[2]};
    std::sort(sorted.begin(), sorted.end());
    EXPECT_LT((direct - by_svd).norm(), 2e-15 * (10.0 + sorted[2] / (sorted[0] + sorted[1]))) << F;
    if (spread <= 1) {
      EXPECT_LT((direct - by_svd).norm(), 1e-12) << F;
    }
  }
}

TEST(ClosestRotation, IsUndefinedWhereItIsNotUnique) {
  Eigen::Matrix2d planar = Eigen::Matrix2d::Identity();
  Eigen::Matrix4d D;
  EXPECT_FALSE(closest_rotation(Eigen::Matrix2d(Eigen::Vector2d(1.0, -1.0).asDiagonal()), planar, &D));
  EXPECT_EQ(planar, Eigen::Matrix2d::Identity());
  EXPECT_TRUE(D.isZero());
  Eigen::Matrix3d spatial = Eigen::Matrix3d::Identity();
  EXPECT_FALSE(closest_rotation(Eigen::Matrix3d::Zero().eval(), spatial));
  EXPECT_FALSE(closest_rotation(Eigen::Matrix3d(Eigen::Vector3d(2.0, 1.0, -1.0).asDiagonal()), spatial));
  EXPECT_TRUE(closest_rotation(Eigen::Matrix3d(Eigen::Vector3d(2.0, 1.0, -0.5).asDiagonal()), spatial));
  Matrix23 rows = Matrix23::Identity();
  Matrix23 flat;
  flat << 1.0, 2.0, 3.0, 2.0, 4.0, 6.0;
  EXPECT_FALSE(closest_orthonormal_rows(flat, rows));
  EXPECT_EQ(rows, Matrix23::Identity());
}

TEST(ClosestOrthonormalRows, AreThePolarFactorAndMoveWithTheMatrix) {
  std::srand(3);
  for (int sample = 0; sample < 50; ++sample) {
    const Matrix23 F = Matrix23::Random();
    Matrix23 R;
    ASSERT_TRUE(closest_orthonormal_rows(F, R));
    const Eigen::JacobiSVD<Eigen::Matrix<double, 2, 3>, Eigen::ColPivHouseholderQRPreconditioner> svd(
        F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Matrix23 polar = svd.matrixU() * svd.matrixV().leftCols<2>().transpose();
    EXPECT_LT((R - polar).norm(), 1e-11 * svd.singularValues()[0] / svd.singularValues()[1]);
    if (svd.singularValues()[1] < 0.05) continue;
    expect_derivative_of_differences(F,
                                     [](const auto& A, auto& B, auto* D) { return closest_orthonormal_rows(A, B, D); });
  }
}

// Martinez Esturo 2013, sec. 7.4.3: the singular vectors of the vanishing singular value of G U become the normals at
// rest and now; projected to the tangent plane that rotation is the polar factor in tangent coordinates (errata C6).
TEST(ClosestOrthonormalRows, EqualTheProjectedNormalCompletedRotation) {
  std::srand(4);
  for (int sample = 0; sample < 20; ++sample) {
    const Eigen::Matrix3d x = Eigen::Matrix3d::Random();  // rows: vertices at rest, and now
    const Eigen::Matrix3d u = Eigen::Matrix3d::Random();
    const auto normal = [](const Eigen::Matrix3d& p) {
      return Eigen::Vector3d((p.row(1) - p.row(0)).transpose().cross((p.row(2) - p.row(0)).transpose()).normalized());
    };
    const Eigen::Vector3d n = normal(x);
    Eigen::Matrix3d X;
    X << x.row(1) - x.row(0), x.row(2) - x.row(0), n.transpose();
    Eigen::Matrix3d edges = Eigen::Matrix3d::Zero();
    edges.row(0) = u.row(1) - u.row(0);
    edges.row(1) = u.row(2) - u.row(0);
    const Eigen::Matrix3d F = X.inverse() * edges;  // G U
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d S = svd.matrixU();
    Eigen::Matrix3d T = svd.matrixV();
    S.col(2) = n;
    T.col(2) = normal(u);
    const Eigen::Matrix3d rotation = S * T.transpose();
    EXPECT_NEAR(rotation.determinant(), 1.0, 1e-10);
    Matrix23 B;
    B.row(0) = (x.row(1) - x.row(0)).normalized();
    B.row(1) = n.transpose().cross(B.row(0));
    Matrix23 R;
    ASSERT_TRUE(closest_orthonormal_rows(B * F, R));
    const Eigen::Matrix3d tangential = (Eigen::Matrix3d::Identity() - n * n.transpose()) * rotation;
    EXPECT_LT((B.transpose() * R - tangential).norm(), 1e-10);
  }
}

}  // namespace
}  // namespace variform
