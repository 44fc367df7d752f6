// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/norm.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

constexpr FacetWeight kWeights[] = {FacetWeight::facet_measure, FacetWeight::facet_measure_unit,
                                    FacetWeight::finite_volume};

std::vector<Domain> domains() {
  return {Domain(rectangle_mesh({.h = 0.25, .jitter = 0.3})), Domain(bar_surface_mesh(1.0, 0.5, 0.5, 0.25)),
          Domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5))};
}

Domain unit_square() {
  Mesh mesh;
  mesh.positions.resize(4, 2);
  mesh.positions << 0, 0, 1, 0, 1, 1, 0, 1;
  mesh.cells.resize(2, 3);
  mesh.cells << 0, 1, 2, 0, 2, 3;
  return Domain(mesh);
}

// Two triangles of the unit square: every number is known in closed form.
TEST(CellNorm, WorkedExampleOfTheUnitSquare) {
  const Domain domain = unit_square();
  const double beta = 0.3;
  const Eigen::MatrixXd W = cell_norm(domain, {.beta = beta})->matrix();
  const double root2 = std::numbers::sqrt2;
  Eigen::Matrix2d expected;
  expected << (1 - beta) / 2 + root2 * beta, -root2 * beta, -root2 * beta, (1 - beta) / 2 + root2 * beta;
  EXPECT_LT((W - expected).cwiseAbs().maxCoeff(), 1e-16);
  const Vector eigenvalues = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(W).eigenvalues();
  EXPECT_NEAR(eigenvalues[0], (1 - beta) / 2, 1e-15);
  EXPECT_NEAR(eigenvalues[1], (1 - beta) / 2 + 2 * root2 * beta, 1e-15);
  const Eigen::MatrixXd G = gradient_matrix(domain);
  Eigen::MatrixXd expected_G(4, 4);
  expected_G << -1, 1, 0, 0, 0, 0, 1, -1, 0, -1, 1, 0, -1, 0, 0, 1;
  EXPECT_EQ(G, expected_G);
}

TEST(CellNorm, IsTheStatedMatrix) {
  for (const Domain& domain : domains()) {
    for (const FacetWeight weight : kWeights) {
      const double beta = 0.4;
      const auto norm = cell_norm(domain, {.beta = beta, .facet_weight = weight});
      const Eigen::MatrixXd W = norm->matrix();
      const Vector b = facet_weights(domain, weight);
      Eigen::MatrixXd Q = Eigen::MatrixXd::Zero(domain.facet_count(), domain.cell_count());
      for (Index f = 0; f < domain.facet_count(); ++f) {
        Q(f, domain.facet_cells()(f, 0)) = 1.0;
        Q(f, domain.facet_cells()(f, 1)) = -1.0;
      }
      const Eigen::MatrixXd expected =
          (1 - beta) * Eigen::MatrixXd(domain.cell_measures().asDiagonal()) + beta * Q.transpose() * b.asDiagonal() * Q;
      const double scale = expected.cwiseAbs().maxCoeff();
      EXPECT_LT((W - expected).cwiseAbs().maxCoeff(), 1e-15 * scale);
      EXPECT_LT((W.rowwise().sum() - (1 - beta) * domain.cell_measures()).cwiseAbs().maxCoeff(), 1e-13 * scale);
      EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(W).eigenvalues()[0],
                0.999 * (1 - beta) * domain.cell_measures().minCoeff());
      const Eigen::MatrixXd S = norm->root();
      EXPECT_LT((S.transpose() * S - W).cwiseAbs().maxCoeff(), 1e-14 * scale);
      const Matrix R = Matrix::Random(domain.cell_count(), 4);
      EXPECT_NEAR(norm->squared(R), (R.transpose() * W * R).trace(), 1e-12 * scale * R.squaredNorm());
      EXPECT_NEAR(norm->squared(R), (1 - beta) * norm->plain_squared(R) + beta * residual_variation(domain, weight, R),
                  1e-12 * scale * R.squaredNorm());
      EXPECT_LT((norm->apply(R) - W * R).cwiseAbs().maxCoeff(), 1e-13 * scale);
    }
  }
}

TEST(CellNorm, VariationSeesAllButOneConstantPerComponent) {
  // Two squares that meet in a vertex: two components, so the jumps have rank |T| - 2.
  Mesh mesh;
  mesh.positions.resize(7, 2);
  mesh.positions << 0, 0, 1, 0, 1, 1, 0, 1, 2, 1, 2, 2, 1, 2;
  mesh.cells.resize(4, 3);
  mesh.cells << 0, 1, 2, 0, 2, 3, 2, 4, 5, 2, 5, 6;
  std::vector<Domain> all = domains();
  all.emplace_back(mesh);
  for (const Domain& domain : all) {
    Eigen::MatrixXd Q = Eigen::MatrixXd::Zero(domain.facet_count(), domain.cell_count());
    for (Index f = 0; f < domain.facet_count(); ++f) {
      Q(f, domain.facet_cells()(f, 0)) = 1.0;
      Q(f, domain.facet_cells()(f, 1)) = -1.0;
    }
    EXPECT_EQ(Eigen::FullPivLU<Eigen::MatrixXd>(Q).rank(), domain.cell_count() - domain.component_count());
  }
}

TEST(CellNorm, NumberingOfCellsDoesNotMatter) {
  const Domain domain = domains()[0];
  const Index cells = domain.cell_count();
  Mesh permuted{domain.positions(), IndexMatrix(cells, 3)};
  const Matrix R = Matrix::Random(cells, 3);
  Matrix permuted_R(cells, 3);
  for (Index t = 0; t < cells; ++t) {
    // Another order of cells swaps left and right at many facets; another first corner changes nothing either.
    const Index from = (7 * t + 3) % cells;
    for (int i = 0; i < 3; ++i) permuted.cells(t, i) = domain.cells()(from, (i + t) % 3);
    permuted_R.row(t) = R.row(from);
  }
  ASSERT_NE(cells % 7, 0);
  for (const FacetWeight weight : kWeights) {
    const double expected = cell_norm(domain, {.beta = 0.4, .facet_weight = weight})->squared(R);
    const double actual = cell_norm(Domain(permuted), {.beta = 0.4, .facet_weight = weight})->squared(permuted_R);
    EXPECT_NEAR(actual, expected, 1e-13 * expected);
  }
}

TEST(CellNorm, BetaZeroIsThePlainMeasureNorm) {
  for (const Domain& domain : domains()) {
    const auto norm = cell_norm(domain, {.beta = 0.0});
    EXPECT_EQ(norm->link_count(), 0);
    EXPECT_EQ(norm->diagonal(), domain.cell_measures());
  }
}

TEST(CellNorm, IsThePlainPartAndTheVariation) {
  for (const Domain& domain : domains()) {
    const NormOptions options{.beta = 0.3};
    const auto variation = variation_norm(domain, options);
    const Eigen::MatrixXd whole(cell_norm(domain, options)->matrix());
    const Eigen::MatrixXd plain = 0.7 * Eigen::MatrixXd(domain.cell_measures().asDiagonal());
    EXPECT_LT((Eigen::MatrixXd(variation->matrix()) + plain - whole).cwiseAbs().maxCoeff(), 1e-14 * whole.norm());
    EXPECT_NEAR(variation->squared(Matrix::Constant(domain.cell_count(), 2, 3.0)), 0.0, 1e-12 * whole.norm());
    const Eigen::MatrixXd S(variation->root());
    EXPECT_LT((S.transpose() * S - Eigen::MatrixXd(variation->matrix())).cwiseAbs().maxCoeff(), 1e-14 * whole.norm());
  }
}

TEST(VariationNorm, OfWeightOneIsTheVariation) {
  for (const Domain& domain : domains()) {
    const Matrix R = Matrix::Random(domain.cell_count(), 3);
    for (const FacetWeight weight : kWeights) {
      const auto norm = variation_norm(domain, {.beta = 1.0, .facet_weight = weight});
      const double expected = residual_variation(domain, weight, R);
      EXPECT_NEAR(norm->squared(R), expected, 1e-12 * expected);
    }
    EXPECT_THROW(variation_norm(domain, {.beta = 1.1}), UsageError);
    EXPECT_THROW(cell_norm(domain, {.beta = 1.0}), UsageError);
  }
}

TEST(CellNorm, FacetWeightsScaleAsDocumented) {
  for (const Domain& domain : domains()) {
    Domain scaled = domain;
    const double s = 10.0;
    scaled.set_positions(s * domain.positions());
    const int m = domain.intrinsic_dimension();
    const double powers[] = {m - 1.0, static_cast<double>(m), static_cast<double>(m)};
    for (int k = 0; k < 3; ++k) {
      const Vector ratio =
          facet_weights(scaled, kWeights[k]).cwiseQuotient(facet_weights(domain, kWeights[k])) / std::pow(s, powers[k]);
      EXPECT_LT((ratio.array() - 1.0).abs().maxCoeff(), 1e-12);
    }
  }
}

// The finite-volume weight discretizes the integral of |grad e|^2: for a field sampled at centroids of a regular mesh
// it converges, while the published weight vanishes like h.
TEST(CellNorm, FiniteVolumeVariationIsMeshIndependent) {
  double published[2];
  double consistent[2];
  for (int level = 0; level < 2; ++level) {
    const Domain domain(
        rectangle_mesh({.h = level == 0 ? 1.0 / 64 : 1.0 / 128, .tessellation = Tessellation::alternating}));
    Matrix R(domain.cell_count(), 1);
    for (Index t = 0; t < domain.cell_count(); ++t) {
      double x = 0.0;
      for (int i = 0; i < 3; ++i) x += domain.positions()(domain.cells()(t, i), 0) / 3.0;
      R(t, 0) = std::sin(3.0 * x);
    }
    published[level] = residual_variation(domain, FacetWeight::facet_measure, R);
    consistent[level] = residual_variation(domain, FacetWeight::finite_volume, R);
  }
  EXPECT_NEAR(published[0] / published[1], 2.0, 0.05);
  EXPECT_NEAR(consistent[0] / consistent[1], 1.0, 0.02);
}

TEST(CellNorm, RefusesBetaOutsideItsRange) {
  const Domain domain = unit_square();
  for (const double beta : {-0.1, 1.0, 1.5, std::nan("")}) {
    EXPECT_THROW(cell_norm(domain, {.beta = beta}), UsageError) << beta;
  }
}

TEST(CellNorm, OneCellHasNoVariation) {
  Mesh mesh;
  mesh.positions.resize(3, 2);
  mesh.positions << 0, 0, 1, 0, 0, 1;
  mesh.cells.resize(1, 3);
  mesh.cells << 0, 1, 2;
  EXPECT_NEAR(cell_norm(Domain(mesh), {.beta = 0.25})->matrix().coeff(0, 0), 0.75 * 0.5, 1e-16);
}

// A residual held in arbitrary cell frames must cost what it costs in the common frame.
TEST(CellNorm, TransportMakesFramesIrrelevant) {
  const Domain domain(rectangle_mesh({.h = 0.2, .jitter = 0.3}));
  const Vector angles = std::numbers::pi * Vector::Random(domain.cell_count());
  Matrix frames(domain.cell_count(), 4);
  const Matrix world = Matrix::Random(domain.cell_count(), 4);
  Matrix local(world.rows(), 4);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::Matrix2d B;
    B << std::cos(angles[t]), std::sin(angles[t]), -std::sin(angles[t]), std::cos(angles[t]);
    frames.row(t) << B.row(0), B.row(1);
    for (int pair = 0; pair < 2; ++pair) {
      local.row(t).segment(2 * pair, 2) = (B * world.row(t).segment(2 * pair, 2).transpose()).transpose();
    }
  }
  const auto plain = cell_norm(domain, {.beta = 0.4});
  const auto transported = cell_norm(domain, {.beta = 0.4}, frames);
  EXPECT_NEAR(transported->squared(local), plain->squared(world), 1e-13 * plain->squared(world));
  EXPECT_GT(std::abs(plain->squared(local) - plain->squared(world)), 1e-3 * plain->squared(world));
  EXPECT_NEAR((local.array() * transported->apply(local).array()).sum(), plain->squared(world), 1e-12);
}

TEST(VertexNorm, IsMassPlusLaplacian) {
  for (const Domain& domain : domains()) {
    const double beta = 0.3;
    const auto norm = vertex_norm(domain, {.beta = beta});
    const Eigen::MatrixXd expected =
        (1 - beta) * Eigen::MatrixXd(mass_matrix(domain)) + beta * Eigen::MatrixXd(cotangent_laplacian(domain));
    EXPECT_LT((Eigen::MatrixXd(norm->matrix()) - expected).cwiseAbs().maxCoeff(), 1e-14);
    const Eigen::MatrixXd S = norm->root();
    EXPECT_LT((S.transpose() * S - expected).cwiseAbs().maxCoeff(), 1e-13);
    const Matrix R = Matrix::Random(domain.vertex_count(), 2);
    EXPECT_NEAR(norm->plain_squared(R), (R.transpose() * mass_matrix(domain) * R).trace(), 1e-12);
  }
}

}  // namespace
}  // namespace variform
