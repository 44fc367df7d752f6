// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <complex>
#include <random>
#include <string>
#include <vector>

#include "solvers/linear/hermitian_matrix.h"
#include "solvers/linear/linear_backends.h"

namespace variform {
namespace {

using ::testing::HasSubstr;
using Complex = std::complex<double>;

/// A sparse positive definite Hermitian matrix of order n, about `per_row` entries in each row.
Eigen::MatrixXcd random_hermitian(Index n, Index per_row, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<Index> column(0, n - 1);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  Eigen::MatrixXcd J = Eigen::MatrixXcd::Zero(2 * n, n);
  for (Index i = 0; i < 2 * n; ++i) {
    for (Index k = 0; k < per_row; ++k) J(i, column(generator)) = {value(generator), value(generator)};
  }
  return J.adjoint() * J + 0.1 * Eigen::MatrixXcd::Identity(n, n);
}

/// Lower triangle of the real matrix of twice the order, pairs of unknowns interleaved.
SparseMatrix realified(const Eigen::MatrixXcd& H) {
  const Eigen::Index n = H.rows();
  Eigen::MatrixXd K(2 * n, 2 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      K.block<2, 2>(2 * i, 2 * j) << H(i, j).real(), -H(i, j).imag(), H(i, j).imag(), H(i, j).real();
    }
  }
  SparseMatrix lower = Eigen::MatrixXd(K.triangularView<Eigen::Lower>()).sparseView();
  lower.makeCompressed();
  return lower;
}

Eigen::MatrixXcd dense(const HermitianMatrix& H) {
  Eigen::MatrixXcd result = Eigen::MatrixXcd::Zero(H.size(), H.size());
  for (Index j = 0; j < H.size(); ++j) {
    for (Index k = H.column_pointers()[j]; k < H.column_pointers()[j + 1]; ++k) {
      const Complex value(H.values()[2 * k], H.values()[2 * k + 1]);
      result(H.rows()[k], j) = value;
      result(j, H.rows()[k]) = std::conj(value);
    }
  }
  return result;
}

TEST(HermitianMatrix, IsFoundInItsRealForm) {
  const Eigen::MatrixXcd H = random_hermitian(30, 3, 1);
  HermitianMatrix found;
  ASSERT_TRUE(found.analyze(realified(H)));
  EXPECT_LT((dense(found) - H).norm(), 1e-14 * H.norm());
}

TEST(HermitianMatrix, EntriesThatAreZeroNeedNotBeStored) {
  Eigen::MatrixXcd H = random_hermitian(20, 3, 2);
  const Eigen::MatrixXd real_part = H.real();
  H.topLeftCorner(10, 10) = real_part.topLeftCorner(10, 10).cast<Complex>();  // couples no x with a y
  HermitianMatrix found;
  ASSERT_TRUE(found.analyze(realified(H)));
  EXPECT_LT((dense(found) - H).norm(), 1e-14 * H.norm());
}

TEST(HermitianMatrix, RoundingErrorsAreTakenForZeros) {
  const Eigen::MatrixXcd H = random_hermitian(25, 3, 7);
  SparseMatrix K = realified(H);
  for (Index j = 0; j < K.cols(); ++j) {
    if (j % 2 == 0) K.coeffRef(j + 1, j) = 1e-15 * K.coeff(j, j);  // on the diagonal of H, which is real
    K.coeffRef(j, j) *= 1.0 + (j % 3) * 2e-16;
  }
  HermitianMatrix found;
  K.makeCompressed();
  ASSERT_TRUE(found.analyze(K));
  EXPECT_LT((dense(found) - H).norm(), 1e-14 * H.norm());
  EXPECT_EQ(dense(found).diagonal().imag().norm(), 0.0);
}

TEST(HermitianMatrix, OtherMatricesAreNone) {
  const SparseMatrix K = realified(random_hermitian(12, 3, 3));
  HermitianMatrix found;
  for (Index k = 0; k < K.nonZeros(); ++k) {
    SparseMatrix changed = K;
    changed.valuePtr()[k] *= 1.0 + 1e-6;
    EXPECT_FALSE(found.analyze(changed)) << k;
  }
  const SparseMatrix odd = K.topLeftCorner(23, 23);
  EXPECT_FALSE(found.analyze(odd));
  SparseMatrix nan = K;
  nan.valuePtr()[5] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(found.analyze(nan));
}

std::vector<std::string> available_of(const std::vector<std::string>& names) {
  std::vector<std::string> available;
  for (const std::string& name : names) {
    if (linear_backends().find(name).available) available.push_back(name);
  }
  return available;
}

class CholmodBackends : public ::testing::TestWithParam<std::string> {};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(CholmodBackends);  // in builds without

TEST_P(CholmodBackends, FactorizeTheHermitianMatrixInsteadAndFallBackWhenValuesNoLongerFit) {
  const SparseMatrix K = realified(random_hermitian(60, 3, 4));
  const auto backend = make_linear_backend(GetParam());
  const Eigen::MatrixXd B = Eigen::MatrixXd::Random(120, 5);
  const auto error = [&](const SparseMatrix& A) {
    const Eigen::MatrixXd full = Eigen::MatrixXd(A).selfadjointView<Eigen::Lower>();
    return (backend->solve(B) - full.ldlt().solve(B)).norm() / full.ldlt().solve(B).norm();
  };
  backend->factorize(K, MatrixKind::spd);
  EXPECT_THAT(backend->report().ordering, HasSubstr("complex"));
  EXPECT_LT(error(K), 1e-11);

  const SparseMatrix other = realified(2.0 * random_hermitian(60, 3, 4));
  backend->factorize(other, MatrixKind::spd);
  EXPECT_THAT(backend->report().ordering, HasSubstr("complex"));
  EXPECT_LT(error(other), 1e-11);

  SparseMatrix real = K;
  for (Index j = 0; j < real.cols(); j += 2) real.coeffRef(j, j) += 0.1 * (j + 1);
  backend->factorize(real, MatrixKind::spd);
  EXPECT_EQ(backend->report().ordering.find("complex"), std::string::npos);
  EXPECT_LT(error(real), 1e-11);
}

TEST_P(CholmodBackends, RefuseHermitianMatricesThatAreNotDefinite) {
  Eigen::MatrixXcd H = random_hermitian(40, 3, 5);
  H(7, 7) = -1.0;
  const auto backend = make_linear_backend(GetParam());
  EXPECT_ANY_THROW(backend->factorize(realified(H), MatrixKind::spd));
}

// A supernodal factor that is used again and again with a few columns becomes a simplicial one.
TEST_P(CholmodBackends, SolveTheSameHoweverOftenAndRefactorize) {
  const Eigen::MatrixXd J = random_hermitian(80, 3, 6).real();
  Eigen::MatrixXd A = J;
  A.diagonal().array() += 1.0 + J.norm();
  SparseMatrix K = Eigen::MatrixXd(A.triangularView<Eigen::Lower>()).sparseView();
  const auto backend = make_linear_backend(GetParam());
  const Eigen::MatrixXd B = Eigen::MatrixXd::Random(80, 2);
  for (int values = 0; values < 3; ++values) {
    backend->factorize(K, MatrixKind::spd);
    const Eigen::MatrixXd exact = A.ldlt().solve(B);
    for (int repeat = 0; repeat < 4; ++repeat) {
      EXPECT_LT((backend->solve(B) - exact).norm(), 1e-12 * exact.norm()) << values << ' ' << repeat;
      const Eigen::MatrixXd many = Eigen::MatrixXd::Random(80, 7);
      EXPECT_LT((backend->solve(many) - A.ldlt().solve(many)).norm(), 1e-11) << values << ' ' << repeat;
    }
    K *= 3.0;
    A *= 3.0;
  }
  EXPECT_EQ(backend->report().analyses, 1);
}

INSTANTIATE_TEST_SUITE_P(Linear, CholmodBackends,
                         ::testing::ValuesIn(available_of({"cholmod.simplicial", "cholmod.supernodal"})));

}  // namespace
}  // namespace variform
