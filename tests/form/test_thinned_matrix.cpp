// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "energies/energies.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "framework/form/thinned_matrix.h"
#include "solvers/linear/linear_backends.h"
#include "tests/allocation_count.h"

namespace variform {
namespace {

std::unique_ptr<Energy> make(const std::string& name) {
  const EnergyEntry& entry = energies().find(name);
  return entry.make(Parameters(entry.parameters));
}

// One side held, the opposite one moved.
Constraints stretched(const Domain& domain, int d) {
  Constraints constraints(domain.vertex_count(), d);
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    Eigen::RowVectorXd x = domain.positions().row(v).leftCols(d);
    if (x[0] == 0.0) constraints.fix(v, x);
    if (x[0] == 1.0) constraints.fix(v, 1.3 * x);
  }
  return constraints;
}

Eigen::MatrixXd full(const SparseMatrix& K) { return Eigen::MatrixXd(K).selfadjointView<Eigen::Lower>(); }

// At interior edges the two coordinates of conformal energies do not see each other.
TEST(ThinnedMatrix, HalvesConformalEnergiesAndKeepsTheirSolution) {
  const Domain domain(rectangle_mesh({.h = 1.0 / 16, .jitter = 0.3}));
  for (const std::string name : {"asap", "lscm"}) {
    const auto energy = make(name);
    Problem problem(domain, *energy, {.beta = 0.0}, stretched(domain, 2));
    const SparseMatrix& K = problem.reduced_matrix();
    ThinnedMatrix thinned;
    const SparseMatrix& thin = thinned.refill(K);
    EXPECT_LT(thin.nonZeros(), 0.62 * K.nonZeros()) << name;
    EXPECT_LT((full(thin) - full(K)).norm(), 1e-14 * full(K).norm()) << name;
    const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(K.rows(), -1.0, 2.0);
    const Eigen::VectorXd x = full(K).llt().solve(b);
    EXPECT_LT((full(thin).llt().solve(b) - x).norm(), 1e-12 * x.norm()) << name;

    const auto backend = make_linear_backend("eigen.ldlt");
    problem.solve(*backend);
    EXPECT_EQ(backend->report().nnz_matrix, thin.nonZeros()) << name;
  }
}

TEST(ThinnedMatrix, IsTheMatrixItselfWhereNothingCancels) {
  const Domain domain(rectangle_mesh({.h = 1.0 / 16, .jitter = 0.3}));
  for (const double beta : {0.0, 0.3}) {
    const auto energy = make("arap");
    Problem problem(domain, *energy, {.beta = beta}, stretched(domain, 2));
    const SparseMatrix& K = problem.reduced_matrix();
    ThinnedMatrix thinned;
    EXPECT_EQ(&thinned.refill(K), &K);
  }
}

TEST(ThinnedMatrix, FollowsItsValuesWithoutAllocationsAndPutsBackWhatNoLongerCancels) {
  const auto asap = make("asap");
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  Problem problem(domain, *asap, {.beta = 0.0}, stretched(domain, 2));
  SparseMatrix K = problem.reduced_matrix();
  ThinnedMatrix thinned;
  ASSERT_LT(thinned.refill(K).nonZeros(), K.nonZeros());
  K *= 2.0;
  const long before = testing::allocation_count();
  const SparseMatrix& doubled = thinned.refill(K);
  EXPECT_EQ(testing::allocation_count() - before, 0);
  EXPECT_LT((full(doubled) - full(K)).norm(), 1e-14 * full(K).norm());
  // One entry that was left out comes back: the others stay out.
  const Index column = 0;
  K.coeffRef(column + 1, column) = 0.25;
  EXPECT_EQ(full(thinned.refill(K))(column + 1, column), 0.25);
  EXPECT_LT(thinned.refill(K).nonZeros(), K.nonZeros());
  for (Index k = 0; k < K.nonZeros(); ++k) K.valuePtr()[k] += 1e-3;
  EXPECT_EQ(&thinned.refill(K), &K);
}

TEST(ThinnedMatrix, LeavesValuesThatAreNotFiniteToTheBackend) {
  const auto asap = make("asap");
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  Problem problem(domain, *asap, {.beta = 0.0}, stretched(domain, 2));
  SparseMatrix K = problem.reduced_matrix();
  ThinnedMatrix thinned;
  thinned.refill(K);
  for (Index k = 0; k < K.nonZeros(); ++k) K.valuePtr()[k] = std::nan("");
  EXPECT_EQ(&thinned.refill(K), &K);
}

// In a box of cubes, cut into tetrahedra alike, diagonals bring nothing; after a jitter they do.
TEST(ThinnedMatrix, IsChosenAnewWhenPositionsMove) {
  const auto arap = make("arap");
  const Mesh regular = bar_tet_mesh(1.0, 1.0, 1.0, 0.25);
  const Mesh moved = bar_tet_mesh(1.0, 1.0, 1.0, 0.25, 0.3);
  ASSERT_EQ(regular.cells, moved.cells);
  Domain domain(regular);
  const Constraints constraints = stretched(domain, 3);
  Problem problem(domain, *arap, {.beta = 0.0}, constraints);
  const auto backend = make_linear_backend("eigen.ldlt");
  problem.solve(*backend);
  EXPECT_LT(backend->report().nnz_matrix, 0.75 * problem.reduced_matrix().nonZeros());
  domain.set_positions(moved.positions);
  problem.refresh_operator();
  problem.refresh_target(moved.positions);
  const Matrix U = problem.solve(*backend);
  EXPECT_EQ(backend->report().nnz_matrix, problem.reduced_matrix().nonZeros());

  const Domain afresh(moved);
  Problem other(afresh, *arap, {.beta = 0.0}, constraints);
  other.refresh_target(moved.positions);
  const Matrix expected = other.solve(*make_linear_backend("eigen.ldlt"));
  EXPECT_LT((U - expected).norm(), 1e-12 * expected.norm());
}

}  // namespace
}  // namespace variform
