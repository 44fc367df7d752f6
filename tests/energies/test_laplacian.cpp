// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include "energies/energies.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"
#include "tests/energies/curved_meshes.h"

namespace variform {
namespace {

std::unique_ptr<Energy> make() {
  const EnergyEntry& entry = energies().find("laplacian");
  return entry.make(Parameters(entry.parameters));
}

Matrix minimize(const Domain& domain, const Energy& energy, const NormOptions& norm, const Constraints& constraints) {
  Problem problem(domain, energy, norm, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  return problem.solve(*linear);
}

// r = M_l^{-1} L (u - x); the plain norm is that of the consistent mass matrix, and beta weighs the gradient.
TEST(Laplacian, HasTheStatedValue) {
  const Domain flat(rectangle_mesh({.h = 0.2, .jitter = 0.3}));
  const Domain bump(testing::bump_mesh(0.2));
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  for (const Domain* domain : {&flat, &bump, &solid}) {
    const int p = domain->ambient_dimension();
    const Matrix U = domain->positions() + 0.1 * Matrix::Random(domain->vertex_count(), p);
    const Eigen::MatrixXd L = cotangent_laplacian(*domain);
    const Eigen::MatrixXd M = mass_matrix(*domain);
    // The lumped masses are the row sums of the consistent ones.
    const Eigen::MatrixXd R = M.rowwise().sum().cwiseInverse().asDiagonal() * L * (U - domain->positions());
    const double plain = (R.transpose() * M * R).trace();
    const double smooth = (R.transpose() * L * R).trace();
    Constraints pin(domain->vertex_count(), p);
    pin.fix(0, U.row(0));
    const auto energy = make();
    const EnergyValue value = Problem(*domain, *energy, {.beta = 0.3}, pin).value(U);
    EXPECT_NEAR(value.plain, plain, 1e-11 * plain);
    EXPECT_NEAR(value.total, 0.7 * plain + 0.3 * smooth, 1e-11 * value.total);
  }
}

// The curvature normal: on a sphere of radius r, L x is 2 x / r^2 up to the size of the mesh.
TEST(Laplacian, KeepsTwiceTheMeanCurvatureNormal) {
  const Domain cap(testing::stereographic_cap_mesh(0.8, 0.05));
  const Form form = make()->declare(cap);
  double worst = 0.0;
  for (Index v = 0; v < cap.vertex_count(); ++v) {
    if (cap.boundary_vertices()[v]) continue;
    worst = std::max(worst, (Eigen::RowVector3d(form.target(v)) - 2.0 * cap.positions().row(v)).norm());
  }
  EXPECT_LT(worst, 0.3);
  EXPECT_GT(worst, 0.0);
}

TEST(Laplacian, TranslatesWithItsHandles) {
  const Domain bump(testing::bump_mesh(0.2));
  const Eigen::RowVector3d shift(0.3, -1.0, 2.0);
  const auto energy = make();
  for (const double beta : {0.0, 0.3}) {
    Constraints handles(bump.vertex_count(), 3);
    handles.fix(2, bump.positions().row(2) + shift);
    handles.fix(20, bump.positions().row(20) + shift);
    const Matrix U = minimize(bump, *energy, {.beta = beta}, handles);
    EXPECT_LT((U - (bump.positions().rowwise() + shift)).cwiseAbs().maxCoeff(), 1e-9);
  }
}

// The operator follows the positions, the differential coordinates stay those of the declared shape.
TEST(Laplacian, KeepsItsCoordinatesOnAShapeThatMoves) {
  Domain bump(testing::bump_mesh(0.2));
  const auto energy = make();
  Form form = energy->declare(bump);
  const Eigen::MatrixXd targets = form.stacked_targets();
  bump.set_positions(2.0 * bump.positions());
  energy->refresh_operator(bump, form);
  EXPECT_EQ(form.stacked_targets(), targets);
  const Form anew = energy->declare(bump);
  EXPECT_EQ(Eigen::MatrixXd(form.sparse_operator()), Eigen::MatrixXd(anew.sparse_operator()));
  EXPECT_LT((anew.stacked_targets() - 0.5 * targets).norm(), 1e-11 * targets.norm());
}

}  // namespace
}  // namespace variform
