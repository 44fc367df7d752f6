// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cmath>
#include <numbers>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/assembly.h"
#include "framework/form/energy.h"
#include "tests/allocation_count.h"
#include "tests/support.h"

namespace variform {
namespace {

Form random_form(const Domain& domain, int residuals, int unknowns, int columns) {
  Form form(domain.vertex_count(), domain.cells(), residuals, unknowns, columns);
  for (Index s = 0; s < form.site_count(); ++s) {
    form.block(s).setRandom();
    form.target(s).setRandom();
  }
  return form;
}

// I_n (x) W for rows site by site is W (x) I_n; explicit here, as a reference only.
SparseMatrix expanded(const SparseMatrix& W, int n) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  for (Index j = 0; j < W.outerSize(); ++j) {
    for (SparseMatrix::InnerIterator it(W, j); it; ++it) {
      for (int i = 0; i < n; ++i) triplets.emplace_back(static_cast<Index>(it.row()) * n + i, j * n + i, it.value());
    }
  }
  SparseMatrix result(W.rows() * n, W.cols() * n);
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

void expect_equals_sparse_product(const std::vector<Term>& terms) {
  Assembly assembly(terms);
  for (int pass = 0; pass < 2; ++pass) {  // the second replaces the values of the first
    assembly.refill(terms);
    assembly.refill_targets(terms);
  }
  const Index size = terms.front().form.unknown_count();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(size, terms.front().form.columns());
  for (const Term& term : terms) {
    const SparseMatrix E = term.form.sparse_operator();
    const SparseMatrix W = expanded(term.norm->matrix(), term.form.residuals());
    H += Eigen::MatrixXd(E.transpose() * W * E);
    g += E.transpose() * W * term.form.stacked_targets();
  }
  const Eigen::MatrixXd assembled = testing::dense_symmetric(assembly.matrix());
  EXPECT_LT((assembled - H).cwiseAbs().maxCoeff(), 1e-13 * H.cwiseAbs().maxCoeff());
  EXPECT_LT((assembly.right_hand_side() - g).cwiseAbs().maxCoeff(), 1e-12 * g.cwiseAbs().maxCoeff());

  const Eigen::MatrixXd A = stacked_operator(terms);
  EXPECT_LT((A.transpose() * A - H).cwiseAbs().maxCoeff(), 1e-12 * H.cwiseAbs().maxCoeff());
  EXPECT_LT((A.transpose() * stacked_targets(terms) - g).cwiseAbs().maxCoeff(), 1e-12 * g.cwiseAbs().maxCoeff());
}

std::vector<Term> one_term(Form form, std::unique_ptr<Norm> norm) {
  std::vector<Term> terms;
  terms.push_back({std::move(form), std::move(norm)});
  return terms;
}

TEST(Assembly, EqualsTheSparseProductForAllShapesOfBlocks) {
  const Domain planar(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  for (const Domain* domain : {&planar, &solid}) {
    for (const double beta : {0.0, 0.3, 0.9}) {
      for (const auto& [n, u, k] : {std::tuple(2, 1, 2), std::tuple(3, 1, 3), std::tuple(4, 2, 1), std::tuple(3, 2, 1),
                                    std::tuple(9, 3, 1), std::tuple(5, 2, 3), std::tuple(1, 1, 1)}) {
        expect_equals_sparse_product(one_term(random_form(*domain, n, u, k), cell_norm(*domain, {.beta = beta})));
      }
    }
  }
}

TEST(Assembly, TakesVertexResidualsAndSparseForms) {
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  // A residual at each vertex that looks at vertices far away: anything but cell-local.
  SparseMatrix E(2 * domain.vertex_count(), 2 * domain.vertex_count());
  std::vector<Eigen::Triplet<double, Index>> triplets;
  for (Index row = 0; row < E.rows(); ++row) {
    for (int k = 0; k < 3; ++k)
      triplets.emplace_back(row, (row * 7 + k * 11) % static_cast<Index>(E.cols()), 1.0 + 0.1 * k + 0.01 * row);
  }
  E.setFromTriplets(triplets.begin(), triplets.end());
  const Eigen::MatrixXd c = Eigen::MatrixXd::Random(E.rows(), 2);
  Form form = Form::from_sparse(E, c, 2);
  EXPECT_LT((Eigen::MatrixXd(form.sparse_operator()) - Eigen::MatrixXd(E)).norm(), 1e-15);
  EXPECT_EQ(form.stacked_targets(), c);
  expect_equals_sparse_product(one_term(std::move(form), vertex_norm(domain, {.beta = 0.3})));
}

TEST(Assembly, AddsTerms) {
  const Domain domain(rectangle_mesh({.h = 0.25}));
  std::vector<Term> terms = one_term(random_form(domain, 4, 2, 1), cell_norm(domain, {.beta = 0.5}));
  terms.push_back({random_form(domain, 3, 2, 1), diagonal_norm(Vector::Random(domain.cell_count()).cwiseAbs())});
  expect_equals_sparse_product(terms);
}

TEST(Assembly, TransportsGiveTheMatrixOfTheCommonFrame) {
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  Form world = random_form(domain, 4, 2, 1);
  Form local = world;
  Matrix frames(domain.cell_count(), 4);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const double angle = 1.7 * t;
    Eigen::Matrix2d B;
    B << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
    frames.row(t) << B.row(0), B.row(1);
    for (int pair = 0; pair < 2; ++pair) {
      local.block(t).middleRows(2 * pair, 2) = B * world.block(t).middleRows(2 * pair, 2);
      local.target(t).middleRows(2 * pair, 2) = B * world.target(t).middleRows(2 * pair, 2);
    }
  }
  const std::vector<Term> in_world = one_term(std::move(world), cell_norm(domain, {.beta = 0.4}));
  const std::vector<Term> in_frames = one_term(std::move(local), cell_norm(domain, {.beta = 0.4}, frames));
  Assembly expected(in_world);
  Assembly actual(in_frames);
  for (auto [assembly, terms] : {std::pair(&expected, &in_world), std::pair(&actual, &in_frames)}) {
    assembly->refill(*terms);
    assembly->refill_targets(*terms);
  }
  EXPECT_LT((Eigen::MatrixXd(expected.matrix()) - Eigen::MatrixXd(actual.matrix())).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT((expected.right_hand_side() - actual.right_hand_side()).cwiseAbs().maxCoeff(), 1e-13);
  const SparseMatrix a = stacked_operator(in_world);
  const SparseMatrix b = stacked_operator(in_frames);
  EXPECT_LT((Eigen::MatrixXd(a.transpose() * a) - Eigen::MatrixXd(b.transpose() * b)).norm(), 1e-12);
}

TEST(Assembly, SameBitsOnAnyNumberOfThreads) {
  const Domain domain(rectangle_mesh({.h = 1.0 / 40, .jitter = 0.3}));
  const std::vector<Term> terms = one_term(random_form(domain, 4, 2, 1), cell_norm(domain, {.beta = 0.4}));
  Assembly assembly(terms);
  Vector values[2];
  Matrix rhs[2];
  for (int threads = 1; threads <= 2; ++threads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    assembly.refill(terms);
    assembly.refill_targets(terms);
    values[threads - 1] = Eigen::Map<const Vector>(assembly.matrix().valuePtr(), assembly.matrix().nonZeros());
    rhs[threads - 1] = assembly.right_hand_side();
  }
  EXPECT_EQ(values[0], values[1]);
  EXPECT_EQ(rhs[0], rhs[1]);
}

TEST(Assembly, RefillAllocatesNothing) {
  const Domain domain(rectangle_mesh({.h = 1.0 / 20}));
  const std::vector<Term> terms = one_term(random_form(domain, 2, 1, 2), cell_norm(domain, {.beta = 0.4}));
  Assembly assembly(terms);
  assembly.refill(terms);
  assembly.refill_targets(terms);
  const long before = testing::allocation_count();
  assembly.refill(terms);
  assembly.refill_targets(terms);
  EXPECT_EQ(testing::allocation_count() - before, 0);
}

TEST(Assembly, PatternIsWhatTheNormCouples) {
  const Domain domain(rectangle_mesh({.h = 1.0 / 40, .tessellation = Tessellation::regular}));
  const auto per_row = [&](double beta) {
    const Assembly assembly(one_term(random_form(domain, 2, 1, 1), cell_norm(domain, {.beta = beta})));
    return (2.0 * assembly.matrix().nonZeros() - domain.vertex_count()) / domain.vertex_count();
  };
  // Valence 6: the vertex and its ring; the six opposite vertices of the facets of the ring join for beta > 0.
  EXPECT_NEAR(per_row(0.0), 7.0, 0.3);
  EXPECT_NEAR(per_row(0.3), 13.0, 0.9);
}

TEST(Assembly, RefusesTermsThatDoNotFit) {
  const Domain domain(rectangle_mesh({.h = 0.5}));
  std::vector<Term> terms = one_term(random_form(domain, 4, 2, 1), cell_norm(domain, {}));
  terms.push_back({random_form(domain, 2, 1, 2), cell_norm(domain, {})});
  EXPECT_THROW(Assembly{terms}, UsageError);
  EXPECT_THROW(Assembly{one_term(random_form(domain, 2, 1, 1), vertex_norm(domain, {}))}, UsageError);
  const Matrix frames = Eigen::RowVector4d(1.0, 0.0, 0.0, 1.0).replicate(domain.cell_count(), 1);
  EXPECT_THROW(Assembly{one_term(random_form(domain, 3, 1, 1), cell_norm(domain, {.beta = 0.3}, frames))}, UsageError);
  EXPECT_THROW(Form::from_sparse(SparseMatrix(5, 3), Eigen::MatrixXd(5, 1), 2), UsageError);
}

}  // namespace
}  // namespace variform
