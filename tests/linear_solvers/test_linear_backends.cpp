// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <random>
#include <regex>
#include <set>

#include "framework/base/error.h"
#include "solvers/linear/blas.h"
#include "solvers/linear/linear_backends.h"
#include "tests/support.h"

// SuperLU, which PETSc factorizes with, keeps what it had when a matrix turns out to be singular.
extern "C" const char* __lsan_default_suppressions() { return "leak:libsuperlu"; }

namespace variform {
namespace {

using testing::message_of;
using testing::test_name;

using ::testing::AllOf;
using ::testing::HasSubstr;
using Triplets = std::vector<Eigen::Triplet<double>>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

SparseMatrix from_triplets(Index rows, Index columns, const Triplets& triplets) {
  SparseMatrix A(rows, columns);
  A.setFromTriplets(triplets.begin(), triplets.end());
  return A;
}

/// About `per_row` random entries in every row.
SparseMatrix random_sparse(Index rows, Index columns, Index per_row, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<Index> column(0, columns - 1);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  Triplets triplets;
  for (Index i = 0; i < rows; ++i) {
    for (Index k = 0; k < per_row; ++k) triplets.emplace_back(i, column(generator), value(generator));
  }
  return from_triplets(rows, columns, triplets);
}

SparseMatrix lower(const SparseMatrix& A) { return A.triangularView<Eigen::Lower>(); }

SparseMatrix identity(Index n) {
  SparseMatrix I(n, n);
  I.setIdentity();
  return I;
}

/// All entries of a random positive definite matrix.
SparseMatrix random_spd(Index n, unsigned seed) {
  const SparseMatrix J = random_sparse(2 * n, n, 3, seed);
  return SparseMatrix(J.transpose() * J) + 0.1 * identity(n);
}

/// Lower triangle of the Dirichlet Laplacian on an m x m (x m) grid: 5- or 7-point stencil.
SparseMatrix grid_laplacian(Index m, int dimension) {
  const Index depth = dimension == 3 ? m : 1;
  Triplets triplets;
  const auto number = [m](Index x, Index y, Index z) { return (z * m + y) * m + x; };
  for (Index z = 0; z < depth; ++z) {
    for (Index y = 0; y < m; ++y) {
      for (Index x = 0; x < m; ++x) {
        const Index i = number(x, y, z);
        triplets.emplace_back(i, i, 2.0 * dimension);
        if (x + 1 < m) triplets.emplace_back(number(x + 1, y, z), i, -1.0);
        if (y + 1 < m) triplets.emplace_back(number(x, y + 1, z), i, -1.0);
        if (z + 1 < depth) triplets.emplace_back(number(x, y, z + 1), i, -1.0);
      }
    }
  }
  return from_triplets(m * m * depth, m * m * depth, triplets);
}

Eigen::MatrixXd random_dense(Index rows, Index columns, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> value;
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return value(generator); });
}

double difference(const Eigen::MatrixXd& X, const Eigen::MatrixXd& expected) {
  return (X - expected).norm() / expected.norm();
}

Eigen::MatrixXd dense_symmetric(const SparseMatrix& lower_triangle) {
  return Eigen::MatrixXd(lower_triangle).selfadjointView<Eigen::Lower>();
}

/// A backend under test, with a tolerance that makes iterations as accurate as direct methods.
std::unique_ptr<LinearBackend> make(const std::string& name) {
  Parameters parameters(linear_backends().find(name).parameters);
  if (!linear_backends().find(name).capabilities.direct) parameters.set("tolerance", 1e-14);
  return make_linear_backend(name, parameters);
}

std::vector<std::string> available(bool LinearCapabilities::*capability) {
  std::vector<std::string> names;
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    if (entry.available && entry.capabilities.*capability) names.push_back(entry.name);
  }
  return names;
}

// ---------------------------------------------------------------------------------------------------------------------

class SpdBackend : public ::testing::TestWithParam<std::string> {
 protected:
  std::unique_ptr<LinearBackend> backend_ = make(GetParam());
};
INSTANTIATE_TEST_SUITE_P(All, SpdBackend, ::testing::ValuesIn(available(&LinearCapabilities::spd)), test_name);

TEST_P(SpdBackend, AgreesWithDenseOnRandomMatrix) {
  const SparseMatrix A = lower(random_spd(150, 1));
  const Eigen::MatrixXd B = random_dense(150, 3, 2);
  backend_->factorize(A, MatrixKind::spd);
  EXPECT_LT(difference(backend_->solve(B), dense_symmetric(A).llt().solve(B)), 1e-9);
}

TEST_P(SpdBackend, AgreesWithDenseOnLaplacianAndReports) {
  const SparseMatrix A = grid_laplacian(15, 2);
  const Eigen::MatrixXd B = random_dense(225, 1, 3);
  backend_->factorize(A, MatrixKind::spd);
  EXPECT_LT(difference(backend_->solve(B), dense_symmetric(A).llt().solve(B)), 1e-9);

  const LinearReport& report = backend_->report();
  EXPECT_TRUE(report.ok) << report.reason;
  EXPECT_EQ(report.rows, 225);
  EXPECT_EQ(report.columns, 225);
  EXPECT_EQ(report.nnz_matrix, A.nonZeros());
  EXPECT_EQ(report.solves, 1);
  EXPECT_LT(report.residual, 1e-12);
  EXPECT_EQ(backend_->capabilities().direct, linear_backends().find(GetParam()).capabilities.direct);
  if (backend_->capabilities().direct) {
    EXPECT_GE(report.nnz_factor, A.nonZeros());
    EXPECT_LT(report.nnz_factor, 225 * 226 / 2);
    EXPECT_GE(report.flops, static_cast<double>(report.nnz_factor));
    EXPECT_FALSE(report.ordering.empty());
    EXPECT_EQ(report.iterations, 0);
  } else {
    EXPECT_GT(report.iterations, 1);
    ASSERT_EQ(report.residual_history.size(), static_cast<std::size_t>(report.iterations) + 1);
    EXPECT_DOUBLE_EQ(report.residual_history.front(), 1.0);
    EXPECT_NEAR(report.residual_history.back(), report.residual, 1e-13);
  }
}

TEST_P(SpdBackend, NewValuesReuseTheAnalysis) {
  SparseMatrix A = grid_laplacian(12, 2);
  const Eigen::MatrixXd B = random_dense(144, 2, 4);
  backend_->factorize(A, MatrixKind::spd);
  const Eigen::MatrixXd first = backend_->solve(B);
  A *= 2.0;
  A.diagonal().array() += 1.0;
  backend_->factorize(A, MatrixKind::spd);
  EXPECT_EQ(backend_->report().analyses, 1);
  EXPECT_EQ(backend_->report().factorizations, 2);
  EXPECT_LT(difference(backend_->solve(B), dense_symmetric(A).llt().solve(B)), 1e-9);
  EXPECT_GT(difference(backend_->solve(B), first), 0.1);
}

TEST_P(SpdBackend, NewPatternIsAnalysed) {
  backend_->factorize(grid_laplacian(12, 2), MatrixKind::spd);
  for (const SparseMatrix& A : {lower(random_spd(144, 5)), grid_laplacian(7, 2)}) {
    const Eigen::MatrixXd B = random_dense(static_cast<Index>(A.rows()), 2, 6);
    backend_->factorize(A, MatrixKind::spd);
    EXPECT_LT(difference(backend_->solve(B), dense_symmetric(A).llt().solve(B)), 1e-9);
  }
  EXPECT_EQ(backend_->report().analyses, 3);
}

TEST_P(SpdBackend, ManyRightHandSidesEqualColumnByColumn) {
  const SparseMatrix A = lower(random_spd(120, 7));
  const Eigen::MatrixXd B = random_dense(120, 32, 8);
  backend_->factorize(A, MatrixKind::spd);
  const Eigen::MatrixXd X = backend_->solve(B);
  ASSERT_EQ(X.cols(), 32);
  for (Index j = 0; j < 32; ++j) EXPECT_LT(difference(backend_->solve(B.col(j)), X.col(j)), 1e-9);
  EXPECT_EQ(backend_->solve(Eigen::MatrixXd(120, 0)).cols(), 0);
  EXPECT_TRUE(backend_->solve(Eigen::MatrixXd::Zero(120, 2)).isZero(0.0));
}

TEST_P(SpdBackend, RefusesWhatIsNotPositiveDefiniteAndRecovers) {
  const SparseMatrix good = grid_laplacian(10, 2);
  SparseMatrix negative = good;
  negative.coeffRef(37, 37) = -5.0;
  const std::string message = message_of([&] { backend_->factorize(negative, MatrixKind::spd); }, ExitCode::solver);
  EXPECT_THAT(message, HasSubstr("not positive definite"));
  EXPECT_THAT(message, HasSubstr("100"));
  EXPECT_FALSE(backend_->report().ok);
  EXPECT_THAT(backend_->report().reason, HasSubstr("not positive definite"));
  EXPECT_THROW(backend_->solve(Vector::Ones(100)), SolverError);

  backend_->factorize(good, MatrixKind::spd);
  EXPECT_LT(difference(dense_symmetric(good) * backend_->solve(Vector::Ones(100)), Vector::Ones(100)), 1e-9);
  EXPECT_TRUE(backend_->report().ok);
  EXPECT_EQ(backend_->report().analyses, 1);
}

TEST_P(SpdBackend, IndefiniteWithPositiveDiagonalGivesNoWrongAnswer) {
  const SparseMatrix A = from_triplets(3, 3, {{0, 0, 1.0}, {1, 0, 2.0}, {1, 1, 1.0}, {2, 2, 1.0}});
  if (backend_->capabilities().direct) {
    EXPECT_THROW(backend_->factorize(A, MatrixKind::spd), SolverError);
    return;
  }
  // Iterations cannot see it in advance: they may solve the system, or fail.
  backend_->factorize(A, MatrixKind::spd);
  try {
    const Eigen::MatrixXd X = backend_->solve(Vector::Ones(3));
    EXPECT_LT(difference(dense_symmetric(A) * X, Vector::Ones(3)), 1e-7);
  } catch (const SolverError&) {
    EXPECT_FALSE(backend_->report().ok);
  }
}

TEST_P(SpdBackend, RefusesSingular) {
  // The Neumann Laplacian of a path: constants are in the kernel, so this right-hand side has no solution.
  Triplets triplets;
  for (Index i = 0; i < 50; ++i) {
    triplets.emplace_back(i, i, i == 0 || i == 49 ? 1.0 : 2.0);
    if (i > 0) triplets.emplace_back(i, i - 1, -1.0);
  }
  const SparseMatrix A = from_triplets(50, 50, triplets);
  EXPECT_THROW(
      {
        backend_->factorize(A, MatrixKind::spd);
        backend_->solve(Vector::Ones(50));
      },
      SolverError);
  backend_->factorize(grid_laplacian(5, 2), MatrixKind::spd);
  EXPECT_NO_THROW(backend_->solve(Vector::Ones(25)));
}

TEST_P(SpdBackend, RefusesNan) {
  SparseMatrix A = grid_laplacian(5, 2);
  A.coeffRef(3, 3) = kNan;
  EXPECT_THAT(message_of([&] { backend_->factorize(A, MatrixKind::spd); }, ExitCode::solver), HasSubstr("not finite"));
  backend_->factorize(grid_laplacian(5, 2), MatrixKind::spd);
  EXPECT_THAT(message_of([&] { backend_->solve(Vector::Constant(25, kNan)); }, ExitCode::solver),
              HasSubstr("not finite"));
  EXPECT_NO_THROW(backend_->solve(Vector::Ones(25)));
}

TEST_P(SpdBackend, RefusesWrongCalls) {
  const SparseMatrix A = grid_laplacian(5, 2);
  EXPECT_THAT(message_of([&] { backend_->solve(Vector::Ones(25)); }, ExitCode::solver), HasSubstr("before factorize"));
  backend_->analyze(A, MatrixKind::spd);
  EXPECT_THROW(backend_->solve(Vector::Ones(25)), SolverError);
  backend_->factorize(A, MatrixKind::spd);
  EXPECT_EQ(backend_->report().analyses, 1);
  EXPECT_THAT(message_of([&] { backend_->solve(Vector::Ones(24)); }, ExitCode::usage),
              AllOf(HasSubstr("24"), HasSubstr("25")));
  EXPECT_THROW(backend_->factorize(random_sparse(6, 5, 2, 1), MatrixKind::spd), UsageError);
  EXPECT_THAT(message_of([&] { backend_->factorize(random_spd(10, 1), MatrixKind::spd); }, ExitCode::usage),
              HasSubstr("lower triangle"));
  if (!backend_->capabilities().least_squares) {
    EXPECT_THROW(backend_->factorize(random_sparse(6, 5, 2, 1), MatrixKind::least_squares), UsageError);
  }
  EXPECT_NO_THROW(backend_->solve(Vector::Ones(25)));
}

TEST_P(SpdBackend, SolvesForNoUnknowns) {
  backend_->factorize(SparseMatrix(0, 0), MatrixKind::spd);
  const Eigen::MatrixXd X = backend_->solve(Eigen::MatrixXd(0, 3));
  EXPECT_EQ(X.rows(), 0);
  EXPECT_EQ(X.cols(), 3);
  EXPECT_TRUE(backend_->report().ok);
  backend_->factorize(identity(1), MatrixKind::spd);
  EXPECT_DOUBLE_EQ(backend_->solve(Vector::Constant(1, 7.0))(0, 0), 7.0);
}

// ---------------------------------------------------------------------------------------------------------------------

class LuBackend : public ::testing::TestWithParam<std::string> {
 protected:
  std::unique_ptr<LinearBackend> backend_ = make(GetParam());
};
INSTANTIATE_TEST_SUITE_P(All, LuBackend, ::testing::ValuesIn(available(&LinearCapabilities::general)), test_name);

TEST_P(LuBackend, SolvesNonsymmetric) {
  const Eigen::MatrixXd B = random_dense(150, 3, 11);
  for (const double scale : {1.0, 3.0}) {
    const SparseMatrix A = scale * random_sparse(150, 150, 4, 10) + 2.0 * identity(150);
    backend_->factorize(A, MatrixKind::general);
    EXPECT_LT(difference(backend_->solve(B), Eigen::MatrixXd(A).partialPivLu().solve(B)), 1e-9);
  }
  EXPECT_EQ(backend_->report().analyses, 1);
  EXPECT_EQ(backend_->report().factorizations, 2);
  if (backend_->capabilities().direct) {
    EXPECT_GE(backend_->report().nnz_factor, 150);
  }
}

TEST_P(LuBackend, SolvesKkt) {
  const Index n = 60;
  const Index m = 20;
  const Eigen::MatrixXd B = random_dense(n + m, 2, 13);
  for (const double scale : {1.0, -0.5}) {
    const SparseMatrix constraints = scale * random_sparse(m, n, 4, 22);
    Triplets triplets;
    for (const auto& [block, row] : {std::pair(lower(random_spd(n, 23)), 0), std::pair(constraints, n)}) {
      for (Index j = 0; j < n; ++j) {
        for (SparseMatrix::InnerIterator entry(block, j); entry; ++entry) {
          triplets.emplace_back(row + entry.row(), j, entry.value());
        }
      }
    }
    const SparseMatrix A = from_triplets(n + m, n + m, triplets);
    backend_->factorize(A, MatrixKind::symmetric_indefinite);
    EXPECT_LT(difference(backend_->solve(B), dense_symmetric(A).partialPivLu().solve(B)), 1e-9);
  }
  EXPECT_EQ(backend_->report().analyses, 1);
  EXPECT_EQ(backend_->report().factorizations, 2);
}

TEST_P(LuBackend, KindsAreToldApart) {
  const SparseMatrix A = grid_laplacian(6, 2);  // a lower triangle, also valid as a general matrix
  const Vector b = Vector::Ones(36);
  backend_->factorize(A, MatrixKind::general);
  EXPECT_LT(difference(Eigen::MatrixXd(A) * backend_->solve(b), b), 1e-9);
  backend_->factorize(A, MatrixKind::symmetric_indefinite);
  EXPECT_LT(difference(dense_symmetric(A) * backend_->solve(b), b), 1e-9);
  EXPECT_EQ(backend_->report().analyses, 2);
}

TEST_P(LuBackend, RefusesSingularAndRecovers) {
  const Vector b = random_dense(4, 1, 14);
  const SparseMatrix empty_column = from_triplets(4, 4, {{0, 0, 1.0}, {1, 1, 1.0}, {2, 2, 1.0}, {3, 0, 1.0}});
  const SparseMatrix equal_rows =
      from_triplets(4, 4, {{0, 0, 1.0}, {0, 1, 2.0}, {1, 0, 1.0}, {1, 1, 2.0}, {2, 2, 1.0}, {3, 3, 1.0}, {3, 0, 1.0}});
  for (const SparseMatrix& A : {empty_column, equal_rows, SparseMatrix(4, 4)}) {
    const auto attempt = [&] {
      backend_->factorize(A, MatrixKind::general);
      backend_->solve(b);
    };
    EXPECT_THAT(message_of(attempt, ExitCode::solver), HasSubstr("singular"));
  }
  SparseMatrix nan = identity(4);
  nan.coeffRef(2, 2) = kNan;
  EXPECT_THROW(backend_->factorize(nan, MatrixKind::general), SolverError);
  backend_->factorize(identity(4), MatrixKind::general);
  EXPECT_LT(difference(backend_->solve(b), b), 1e-15);
  backend_->factorize(SparseMatrix(0, 0), MatrixKind::general);
  EXPECT_EQ(backend_->solve(Eigen::MatrixXd(0, 2)).cols(), 2);
}

// ---------------------------------------------------------------------------------------------------------------------

class LeastSquaresBackend : public ::testing::TestWithParam<std::string> {
 protected:
  std::unique_ptr<LinearBackend> backend_ = make(GetParam());
};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(LeastSquaresBackend);
INSTANTIATE_TEST_SUITE_P(All, LeastSquaresBackend, ::testing::ValuesIn(available(&LinearCapabilities::least_squares)),
                         test_name);

TEST_P(LeastSquaresBackend, AgreesWithNormalEquations) {
  const Eigen::MatrixXd B = random_dense(300, 4, 31);
  for (const double scale : {1.0, -2.5}) {
    const SparseMatrix A = scale * random_sparse(300, 100, 5, 30);
    const Eigen::MatrixXd dense = A;
    backend_->factorize(A, MatrixKind::least_squares);
    const Eigen::MatrixXd X = backend_->solve(B);
    ASSERT_EQ(X.rows(), 100);
    EXPECT_LT(difference(X, (dense.transpose() * dense).ldlt().solve(dense.transpose() * B)), 1e-9);
    for (Index j = 0; j < 4; ++j) EXPECT_LT(difference(backend_->solve(B.col(j)), X.col(j)), 1e-9);
  }
  const LinearReport& report = backend_->report();
  EXPECT_EQ(report.analyses, 1);
  EXPECT_EQ(report.factorizations, 2);
  EXPECT_GE(report.nnz_factor, 100);
  EXPECT_GT(report.flops, 0.0);
  EXPECT_LT(report.residual, 1e-12);
  EXPECT_FALSE(report.ordering.empty());
}

TEST_P(LeastSquaresBackend, AcceptsRightHandSideOrthogonalToTheRange) {
  const SparseMatrix A = random_sparse(40, 10, 3, 32);
  const Eigen::MatrixXd dense = A;
  const Vector any = random_dense(40, 1, 33);
  const Vector orthogonal = any - dense * (dense.transpose() * dense).ldlt().solve(dense.transpose() * any);
  backend_->factorize(A, MatrixKind::least_squares);
  EXPECT_LT(backend_->solve(orthogonal).norm(), 1e-12);
}

TEST_P(LeastSquaresBackend, RefusesRankDeficientAndRecovers) {
  const SparseMatrix good = random_sparse(40, 10, 3, 34);
  SparseMatrix twice(40, 10);  // column 9 is twice column 4
  Triplets triplets;
  for (Index j = 0; j < 10; ++j) {
    for (SparseMatrix::InnerIterator entry(good, j == 9 ? 4 : j); entry; ++entry) {
      triplets.emplace_back(entry.row(), j, entry.value() * (j == 9 ? 2.0 : 1.0));
    }
  }
  twice.setFromTriplets(triplets.begin(), triplets.end());
  EXPECT_THAT(message_of([&] { backend_->factorize(twice, MatrixKind::least_squares); }, ExitCode::solver),
              HasSubstr("rank 9"));
  EXPECT_THAT(message_of([&] { backend_->factorize(SparseMatrix(good.transpose()), MatrixKind::least_squares); },
                         ExitCode::usage),
              HasSubstr("10 x 40"));
  backend_->factorize(good, MatrixKind::least_squares);
  EXPECT_NO_THROW(backend_->solve(Vector::Ones(40)));
  EXPECT_THROW(backend_->solve(Vector::Ones(10)), UsageError);
  backend_->factorize(SparseMatrix(5, 0), MatrixKind::least_squares);
  EXPECT_EQ(backend_->solve(Vector::Ones(5)).rows(), 0);
}

// ---------------------------------------------------------------------------------------------------------------------

const bool kWithPetsc = linear_backends().find("petsc").available;

/// A backend with some parameters of strings.
std::unique_ptr<LinearBackend> make(const std::string& name, const std::map<std::string, ParameterValue>& values) {
  Parameters parameters(linear_backends().find(name).parameters);
  for (const auto& [key, value] : values) parameters.set(key, value);
  return make_linear_backend(name, parameters);
}

TEST(EigenCg, PreconditionersAgree) {
  const SparseMatrix A = grid_laplacian(40, 2);
  const Eigen::MatrixXd B = random_dense(1600, 2, 41);
  std::map<std::string, Index> iterations;
  std::vector<std::string> preconditioners = {"none", "diagonal", "incomplete_cholesky"};
  if (kWithPetsc) preconditioners.push_back("amg");
  const Eigen::MatrixXd X = dense_symmetric(A).llt().solve(B);
  for (const std::string& preconditioner : preconditioners) {
    const auto backend = make("eigen.cg", {{"preconditioner", preconditioner}});
    backend->factorize(A, MatrixKind::spd);
    EXPECT_LT(difference(backend->solve(B), X), 1e-8) << preconditioner;
    EXPECT_LE(backend->report().residual, 1.01e-10) << preconditioner;
    if (preconditioner != "amg") {
      EXPECT_GT(backend->report().peak_memory, 12.0 * A.nonZeros()) << preconditioner;
    }
    iterations[preconditioner] = backend->report().iterations;
  }
  EXPECT_LT(iterations["incomplete_cholesky"], iterations["diagonal"]);
  if (kWithPetsc) {
    EXPECT_LT(iterations["amg"], iterations["incomplete_cholesky"] / 2);
  }
}

TEST(EigenCg, IncompleteCholeskyShiftsWherePivotsBreakDown) {
  // Kershaw 1978: positive definite, but the incomplete factorization without fill meets a negative pivot.
  const SparseMatrix A = from_triplets(
      4, 4,
      {{0, 0, 3.0}, {1, 1, 3.0}, {2, 2, 3.0}, {3, 3, 3.0}, {1, 0, -2.0}, {3, 0, 2.0}, {2, 1, -2.0}, {3, 2, -2.0}});
  ASSERT_GT(dense_symmetric(A).eigenvalues().real().minCoeff(), 0.1);
  const auto backend = make("eigen.cg", {{"preconditioner", std::string("incomplete_cholesky")}, {"tolerance", 1e-14}});
  backend->factorize(A, MatrixKind::spd);
  const Vector b = random_dense(4, 1, 42);
  EXPECT_LT(difference(backend->solve(b), dense_symmetric(A).llt().solve(b)), 1e-12);
}

TEST(EigenCg, MultigridIterationsHardlyGrowWithTheSize) {
  if (!kWithPetsc) {
    EXPECT_THAT(message_of(
                    [] {
                      make("eigen.cg", {{"preconditioner", std::string("amg")}});
                    },
                    ExitCode::usage),
                HasSubstr("VARIFORM_PETSC=ON"));
    return;
  }
  for (const char* library : {"boomeramg", "gamg"}) {
    const auto iterations = [&](Index m) {
      const auto backend =
          make("eigen.cg", {{"preconditioner", std::string("amg")}, {"multigrid", std::string(library)}});
      backend->factorize(grid_laplacian(m, 2), MatrixKind::spd);
      backend->solve(Vector::Ones(m * m));
      return backend->report().iterations;
    };
    const Index small = iterations(20);
    EXPECT_GT(small, 2) << library;
    EXPECT_LE(iterations(160), 2 * small) << library;  // diagonal: eight times as many
  }
}

TEST(EigenCg, MultigridTakesBlocksAndOptions) {
  if (!kWithPetsc) return;
  // Two coordinates that hardly couple, interleaved.
  const SparseMatrix L = grid_laplacian(30, 2);
  Triplets triplets;
  for (Index j = 0; j < L.cols(); ++j) {
    for (SparseMatrix::InnerIterator entry(L, j); entry; ++entry) {
      for (Index c = 0; c < 2; ++c) triplets.emplace_back(2 * entry.row() + c, 2 * j + c, entry.value() * (1 + 9 * c));
    }
    triplets.emplace_back(2 * j + 1, 2 * j, 0.01);
  }
  const SparseMatrix A = from_triplets(1800, 1800, triplets);
  const Vector b = random_dense(1800, 1, 43);
  const Eigen::MatrixXd X = dense_symmetric(A).llt().solve(b);
  for (const char* library : {"boomeramg", "gamg"}) {
    const auto backend = make("eigen.cg", {{"preconditioner", std::string("amg")},
                                           {"multigrid", std::string(library)},
                                           {"block_size", std::int64_t{2}},
                                           {"tolerance", 1e-12}});
    backend->factorize(A, MatrixKind::spd);
    EXPECT_LT(difference(backend->solve(b), X), 1e-9);
    EXPECT_LT(backend->report().iterations, 40);
    EXPECT_THAT(message_of([&] { backend->factorize(grid_laplacian(5, 2), MatrixKind::spd); }, ExitCode::usage),
                HasSubstr("block_size = 2"));
  }
  const auto misspelt = make("eigen.cg", {{"preconditioner", std::string("amg")},
                                          {"multigrid_options", std::string("-pc_hypre_boomeramg_treshold 0.5")}});
  EXPECT_THAT(message_of([&] { misspelt->factorize(A, MatrixKind::spd); }, ExitCode::usage),
              HasSubstr("-pc_hypre_boomeramg_treshold"));
}

TEST(ConjugateGradients, OptionsOfMultigridAreRefusedWithoutIt) {
  const std::vector<std::pair<std::string, ParameterValue>> options = {
      {"multigrid", std::string("gamg")}, {"block_size", std::int64_t{2}}, {"multigrid_options", std::string("-x 1")}};
  for (const auto& [option, value] : options) {
    for (const char* preconditioner : {"diagonal", "incomplete_cholesky", "none"}) {
      Parameters parameters(linear_backends().find("eigen.cg").parameters);
      parameters.set("preconditioner", std::string(preconditioner));
      parameters.set(option, value);
      EXPECT_THAT(message_of([&] { make_linear_backend("eigen.cg", parameters); }, ExitCode::usage),
                  AllOf(HasSubstr(option), HasSubstr(preconditioner)));
    }
  }
}

/// Has no memory for a factor.
class Exhausted final : public LinearBackend {
 public:
  Exhausted() : LinearBackend("exhausted") {}
  LinearCapabilities capabilities() const override { return {.spd = true}; }

 private:
  void do_analyze() override {}
  void do_factorize() override { throw std::bad_alloc(); }
  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override { X = B; }
};

TEST(LinearBackend, ALackOfMemoryIsToldFromAFailure) {
  Exhausted backend;
  EXPECT_THROW(backend.factorize(grid_laplacian(3, 2), MatrixKind::spd), std::bad_alloc);
  EXPECT_FALSE(backend.report().ok);
  EXPECT_EQ(backend.report().reason, "out of memory (9 x 9 system)");
}

TEST(Petsc, MethodsAndPreconditionersAreChosenByName) {
  if (!kWithPetsc) return;
  const SparseMatrix A = grid_laplacian(30, 2);
  const Vector b = random_dense(900, 1, 44);
  const Eigen::MatrixXd X = dense_symmetric(A).llt().solve(b);
  std::map<std::string, Index> iterations;
  for (const auto& [ksp, pc] : std::vector<std::pair<std::string, std::string>>{{"cg", "gamg"},
                                                                                {"cg", "hypre"},
                                                                                {"cg", "icc"},
                                                                                {"gmres", "ilu"},
                                                                                {"minres", "jacobi"},
                                                                                {"preonly", "cholesky"}}) {
    const auto backend = make("petsc", {{"ksp", ksp}, {"pc", pc}, {"tolerance", 1e-12}});
    backend->factorize(A, MatrixKind::spd);
    EXPECT_LT(difference(backend->solve(b), X), 1e-7) << ksp << " " << pc;
    EXPECT_THAT(backend->report().reason, AllOf(HasSubstr(ksp), HasSubstr(pc)));
    iterations[pc] = backend->report().iterations;
  }
  EXPECT_LT(iterations["gamg"], iterations["icc"]);
  EXPECT_LT(iterations["icc"], iterations["jacobi"]);
}

TEST(Petsc, OptionsComeLastAndEveryOneIsUnderstood) {
  if (!kWithPetsc) return;
  const SparseMatrix A = grid_laplacian(30, 2);
  const Vector b = Vector::Ones(900);
  const auto limited = make("petsc", {{"options", std::string("-ksp_max_it 3 -pc_type jacobi")}});
  limited->factorize(A, MatrixKind::spd);
  EXPECT_THAT(message_of([&] { limited->solve(b); }, ExitCode::solver),
              AllOf(HasSubstr("3 iterations of cg with jacobi"), HasSubstr("relative residual")));
  EXPECT_EQ(limited->report().iterations, 3);

  const auto misspelt = make("petsc", {{"options", std::string("-pc_gamg_treshold 0.02")}});
  misspelt->factorize(A, MatrixKind::spd);
  for (const char* time : {"first", "second"}) {
    EXPECT_THAT(message_of([&] { misspelt->solve(b); }, ExitCode::usage), HasSubstr("-pc_gamg_treshold")) << time;
  }
  EXPECT_THAT(message_of(
                  [] {
                    make("petsc", {{"options", std::string("gamg")}});
                  },
                  ExitCode::usage),
              HasSubstr("\"gamg\""));
  for (const char* key : {"ksp", "pc"}) {
    const auto unknown = make("petsc", {{key, std::string("nonesuch")}});
    EXPECT_THAT(message_of([&] { unknown->factorize(A, MatrixKind::spd); }, ExitCode::solver), HasSubstr("nonesuch"));
  }
  // Nothing of all that is left behind.
  const auto plain = make("petsc");
  plain->factorize(A, MatrixKind::spd);
  EXPECT_LT(difference(dense_symmetric(A) * plain->solve(b), b), 1e-9);
}

TEST(Petsc, GoesOnInAForkedProcess) {
  if (!kWithPetsc) return;
  const SparseMatrix A = grid_laplacian(10, 2);
  const Vector b = Vector::Ones(100);
  const auto solves = [&] {
    const auto backend = make("petsc");
    backend->factorize(A, MatrixKind::spd);
    return difference(dense_symmetric(A) * backend->solve(b), b) < 1e-9;
  };
  EXPECT_TRUE(solves());
  EXPECT_EXIT(std::exit(solves() ? 42 : 1), ::testing::ExitedWithCode(42), "");
}

TEST(EigenCg, SaysWhenItDoesNotConverge) {
  Parameters parameters(linear_backends().find("eigen.cg").parameters);
  parameters.set("max_iterations", std::int64_t{5});
  const auto backend = make_linear_backend("eigen.cg", parameters);
  backend->factorize(grid_laplacian(30, 2), MatrixKind::spd);
  EXPECT_THAT(message_of([&] { backend->solve(Vector::Ones(900)); }, ExitCode::solver),
              AllOf(HasSubstr("5 iterations"), HasSubstr("relative residual")));
  EXPECT_EQ(backend->report().iterations, 5);
}

class UpdatingBackend : public ::testing::TestWithParam<std::string> {
 protected:
  std::unique_ptr<LinearBackend> backend_ = make(GetParam());
};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(UpdatingBackend);
INSTANTIATE_TEST_SUITE_P(All, UpdatingBackend, ::testing::ValuesIn(available(&LinearCapabilities::update)), test_name);

TEST_P(UpdatingBackend, UpdateAndDowndateEqualANewFactorization) {
  const SparseMatrix A = lower(random_spd(150, 51));
  const SparseMatrix C = random_sparse(150, 3, 1, 52) * 2.0;
  const Eigen::MatrixXd B = random_dense(150, 2, 53);
  const Eigen::MatrixXd dense = dense_symmetric(A);
  const Eigen::MatrixXd CC = Eigen::MatrixXd(C) * Eigen::MatrixXd(C).transpose();
  backend_->factorize(A, MatrixKind::spd);
  backend_->update(C, 1);
  EXPECT_LT(difference(backend_->solve(B), (dense + CC).llt().solve(B)), 1e-10);
  EXPECT_LT(backend_->report().residual, 1e-12);
  backend_->update(C, -1);
  EXPECT_LT(difference(backend_->solve(B), dense.llt().solve(B)), 1e-9);
  EXPECT_EQ(backend_->report().factorizations, 1);
  EXPECT_EQ(backend_->report().updates, 2);
  backend_->factorize(2.0 * A, MatrixKind::spd);
  EXPECT_LT(difference(backend_->solve(B), (2.0 * dense).llt().solve(B)), 1e-10);
}

TEST_P(UpdatingBackend, DowndateToIndefiniteIsRefused) {
  backend_->factorize(identity(5), MatrixKind::spd);
  const SparseMatrix C = from_triplets(5, 1, {{2, 0, 2.0}});
  EXPECT_THAT(message_of([&] { backend_->update(C, -1); }, ExitCode::solver), HasSubstr("not positive definite"));
  EXPECT_THROW(backend_->solve(Vector::Ones(5)), SolverError);
  backend_->factorize(identity(5), MatrixKind::spd);
  EXPECT_LT(difference(backend_->solve(Vector::Ones(5)), Vector::Ones(5)), 1e-15);
}

TEST_P(UpdatingBackend, HeldUnknownsEqualAMatrixWithoutThem) {
  const Index n = 200;
  const SparseMatrix A = lower(random_spd(n, 54));
  const Eigen::MatrixXd full = dense_symmetric(A);
  const Eigen::MatrixXd B = random_dense(n, 3, 55);
  std::set<Index> held;
  const auto expected = [&] {
    Eigen::MatrixXd K = full;
    for (const Index i : held) {
      K.row(i).setZero();
      K.col(i).setZero();
      K(i, i) = 1.0;
    }
    return Eigen::MatrixXd(K.llt().solve(B));
  };
  backend_->factorize(A, MatrixKind::spd);
  for (int i = 0; i < 3; ++i) backend_->solve(B);  // factors may be converted for these
  const auto hold = [&](const std::vector<Index>& unknowns) {
    backend_->hold(unknowns);
    held.insert(unknowns.begin(), unknowns.end());
  };
  const auto release = [&](const std::vector<Index>& unknowns) {
    backend_->release(unknowns);
    for (const Index i : unknowns) held.erase(i);
  };
  hold({3, 77, 78, 79, 150});
  EXPECT_LT(difference(backend_->solve(B), expected()), 1e-10);
  EXPECT_EQ(backend_->solve(B).row(77), B.row(77));
  release({78, 3});
  EXPECT_LT(difference(backend_->solve(B), expected()), 1e-10);
  hold({0, 199});
  EXPECT_LT(difference(backend_->solve(B), expected()), 1e-10);
  release({199, 150, 0, 77, 79});
  EXPECT_TRUE(held.empty());
  EXPECT_LT(difference(backend_->solve(B), expected()), 1e-10);
  EXPECT_EQ(backend_->report().factorizations, 1);
  hold({5});
  backend_->factorize(A, MatrixKind::spd);  // forgets
  held.clear();
  EXPECT_LT(difference(backend_->solve(B), expected()), 1e-10);
  EXPECT_EQ(backend_->report().analyses, 1);
}

TEST_P(UpdatingBackend, RefusesWrongUpdates) {
  const SparseMatrix C = from_triplets(25, 1, {{2, 0, 2.0}});
  EXPECT_THAT(message_of([&] { backend_->update(C, 1); }, ExitCode::solver), HasSubstr("before factorize"));
  backend_->factorize(grid_laplacian(5, 2), MatrixKind::spd);
  EXPECT_THROW(backend_->update(C, 2), UsageError);
  EXPECT_THROW(backend_->update(from_triplets(24, 1, {}), 1), UsageError);
  EXPECT_THAT(message_of([&] { backend_->hold({25}); }, ExitCode::usage), HasSubstr("25"));
  EXPECT_THAT(message_of([&] { backend_->release({4}); }, ExitCode::usage), HasSubstr("is not held"));
  backend_->hold({4});
  EXPECT_THAT(message_of([&] { backend_->hold({4}); }, ExitCode::usage), HasSubstr("held already"));
  EXPECT_THROW(backend_->update(C, 1), UsageError);
  const auto without = make_linear_backend("eigen.ldlt");
  without->factorize(grid_laplacian(5, 2), MatrixKind::spd);
  EXPECT_THAT(message_of([&] { without->hold({4}); }, ExitCode::usage), HasSubstr("cholmod.simplicial"));
}

TEST_P(UpdatingBackend, UpdatesGoOnWithMatricesThatLookHermitian) {
  // Real blocks (a -b; b a) of a Hermitian matrix of half the order.
  const SparseMatrix L = grid_laplacian(12, 2);
  Triplets triplets;
  for (Index j = 0; j < L.cols(); ++j) {
    for (SparseMatrix::InnerIterator entry(L, j); entry; ++entry) {
      for (Index c = 0; c < 2; ++c) triplets.emplace_back(2 * entry.row() + c, 2 * j + c, entry.value());
      if (entry.row() == j) continue;
      triplets.emplace_back(2 * entry.row() + 1, 2 * j, 0.3);
      triplets.emplace_back(2 * entry.row(), 2 * j + 1, -0.3);
    }
  }
  const SparseMatrix A = from_triplets(288, 288, triplets) + identity(288);
  Eigen::MatrixXd K = dense_symmetric(A);
  const Eigen::MatrixXd B = random_dense(288, 2, 56);
  const SparseMatrix C = random_sparse(288, 2, 1, 57);
  const Eigen::MatrixXd CC = Eigen::MatrixXd(C) * Eigen::MatrixXd(C).transpose();
  backend_->factorize(A, MatrixKind::spd);
  for (int times = 1; times <= 2; ++times) {
    backend_->update(C, 1);
    EXPECT_LT(difference(backend_->solve(B), (K + times * CC).llt().solve(B)), 1e-10);
  }
  backend_->factorize(A, MatrixKind::spd);
  EXPECT_LT(difference(backend_->solve(B), K.llt().solve(B)), 1e-10);
  const auto other = make(GetParam());
  other->factorize(A, MatrixKind::spd);
  other->update(C, 1);
  other->hold({7});
  other->release({7});
  EXPECT_LT(difference(other->solve(B), (K + CC).llt().solve(B)), 1e-10);

  backend_ = make(GetParam());
  backend_->factorize(A, MatrixKind::spd);
  backend_->hold({100});
  K.row(100).setZero();
  K.col(100).setZero();
  K(100, 100) = 1.0;
  EXPECT_LT(difference(backend_->solve(B), K.llt().solve(B)), 1e-10);

  const Eigen::MatrixXd full = dense_symmetric(A);
  const SparseMatrix wide = random_sparse(288, 3, 1, 57);
  const Eigen::MatrixXd square = Eigen::MatrixXd(wide) * Eigen::MatrixXd(wide).transpose();
  backend_->analyze(identity(3), MatrixKind::spd);  // forgets
  backend_->factorize(A, MatrixKind::spd);
  EXPECT_THAT(backend_->report().ordering, HasSubstr("complex"));
  backend_->update(wide, 1);
  EXPECT_LT(difference(backend_->solve(B), (full + square).llt().solve(B)), 1e-10);
  backend_->update(wide, -1);
  EXPECT_LT(difference(backend_->solve(B), full.llt().solve(B)), 1e-9);
}

// ---------------------------------------------------------------------------------------------------------------------

TEST(AutoBackend, ChoosesByTheSizeOfTheFactor) {
  const auto backend = make_linear_backend("auto");
  backend->factorize(grid_laplacian(30, 2), MatrixKind::spd);
  EXPECT_EQ(backend->report().backend, "eigen.ldlt");
  if (!linear_backends().find("cholmod.supernodal").available) return;
  const SparseMatrix A = grid_laplacian(40, 3);
  const Vector b = Vector::Ones(A.rows());
  backend->factorize(A, MatrixKind::spd);
  EXPECT_EQ(backend->report().backend, "cholmod.supernodal");
  backend->solve(b);
  EXPECT_LT(backend->report().residual, 1e-10);
  EXPECT_GT(backend->report().peak_memory, 8.0 * static_cast<double>(backend->report().nnz_factor));

  Parameters parameters(linear_backends().find("auto").parameters);
  parameters.set("threshold", 1.0);
  const auto eager = make_linear_backend("auto", parameters);
  eager->factorize(grid_laplacian(30, 2), MatrixKind::spd);
  EXPECT_EQ(eager->report().backend, "cholmod.supernodal");
}

TEST(AutoBackend, ChoosesByTheKind) {
  const bool with_suitesparse = linear_backends().find("umfpack").available;
  const auto backend = make_linear_backend("auto");
  backend->factorize(identity(3), MatrixKind::general);
  EXPECT_EQ(backend->report().backend, with_suitesparse ? "umfpack" : "eigen.lu");
  backend->factorize(identity(3), MatrixKind::symmetric_indefinite);
  EXPECT_EQ(backend->report().backend, with_suitesparse ? "umfpack" : "eigen.lu");
  if (with_suitesparse) {
    backend->factorize(random_sparse(6, 2, 2, 1), MatrixKind::least_squares);
    EXPECT_EQ(backend->report().backend, "spqr");
  } else {
    EXPECT_THROW(backend->factorize(random_sparse(6, 2, 2, 1), MatrixKind::least_squares), UsageError);
  }
}

// ---------------------------------------------------------------------------------------------------------------------

TEST(LinearRegistry, UnknownNameListsTheKnownOnes) {
  EXPECT_THAT(
      message_of([] { make_linear_backend("eigen.cholesky"); }, ExitCode::usage),
      AllOf(HasSubstr("eigen.cholesky"), HasSubstr("eigen.ldlt"), HasSubstr("cholmod.supernodal"), HasSubstr("auto")));
}

TEST(LinearRegistry, EntriesAreComplete) {
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    SCOPED_TRACE(entry.name);
    EXPECT_FALSE(entry.doc.empty());
    EXPECT_FALSE(entry.licence.empty());
    if (entry.available) {
      const auto backend = make_linear_backend(entry.name);
      EXPECT_EQ(backend->report().backend, entry.name);
      for (const MatrixKind kind :
           {MatrixKind::spd, MatrixKind::symmetric_indefinite, MatrixKind::general, MatrixKind::least_squares}) {
        EXPECT_EQ(backend->capabilities().supports(kind), entry.capabilities.supports(kind));
      }
    } else {
      EXPECT_FALSE(entry.package.empty());
      EXPECT_THAT(message_of([&] { make_linear_backend(entry.name); }, ExitCode::usage),
                  AllOf(HasSubstr(entry.package), HasSubstr(entry.option + "=ON")));
    }
  }
}

TEST(LinearRegistry, HoldsEveryBackendInTheFolder) {
  std::set<std::string> described;
  const std::regex definition(R"(^LinearBackendEntry describe_(\w+)\(\) \{)", std::regex::multiline);
  for (const auto& file : std::filesystem::directory_iterator(VARIFORM_SOURCE_DIR "/solvers/linear")) {
    if (file.path().extension() != ".cpp") continue;
    std::ifstream stream(file.path());
    const std::string text(std::istreambuf_iterator<char>(stream), {});
    std::smatch match;
    if (!std::regex_search(text, match, definition)) continue;
    EXPECT_EQ(file.path().stem(), match[1].str());
    std::string name = match[1];
    if (const auto dot = name.find('_'); dot != std::string::npos) name[dot] = '.';
    described.insert(name);
  }
  const std::vector<std::string> names = linear_backends().names();
  EXPECT_EQ(described, std::set<std::string>(names.begin(), names.end()));
}

TEST(Blas, ProbeMeasuresSomething) {
  const BlasInfo info = probe_blas();
  EXPECT_GT(info.gflops, 0.0);
  EXPECT_FALSE(info.implementation.empty());
  EXPECT_FALSE(info.core.empty());
  RecordProperty("implementation", info.implementation);
  RecordProperty("core", info.core);
}

TEST(Blas, SetsThreads) {
  const int before = probe_blas().threads;
  set_blas_threads(1);
  EXPECT_EQ(probe_blas().threads, before < 0 ? before : 1);  // a BLAS other than OpenBLAS is left alone
  set_blas_threads(before);
}

TEST(Blas, AdviceOnMisdetectedCores) {
  const std::string intel = "vendor_id\t: GenuineIntel\nflags\t\t: fpu avx avx2 fma\n";
  const std::string amd = "vendor_id\t: AuthenticAMD\nflags\t\t: fpu avx avx2 fma\n";
  const std::string avx512 = "vendor_id\t: GenuineIntel\nflags\t\t: avx avx2 avx512f avx512dq avx512bw avx512vl\n";
  const std::string old = "vendor_id\t: GenuineIntel\nflags\t\t: fpu avx\n";
  EXPECT_THAT(blas_core_advice("Prescott", intel), HasSubstr("OPENBLAS_CORETYPE=Haswell"));
  EXPECT_THAT(blas_core_advice("Barcelona", amd), HasSubstr("OPENBLAS_CORETYPE=Zen"));
  EXPECT_THAT(blas_core_advice("Sandybridge", avx512), HasSubstr("OPENBLAS_CORETYPE=SkylakeX"));
  EXPECT_EQ(blas_core_advice("Haswell", avx512), "");
  EXPECT_EQ(blas_core_advice("Nehalem", old), "");
  EXPECT_EQ(blas_core_advice("unknown", intel), "");
}

}  // namespace
}  // namespace variform
