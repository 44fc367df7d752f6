// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

#include "energies/energies.h"
#include "energies/parametrization/parametrization.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem_objective.h"
#include "framework/operators/distortion.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/energies/curved_meshes.h"
#include "tests/support.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<Energy> make(const std::string& name, const std::string& gauge = "") {
  const EnergyEntry& entry = energies().find(name);
  Parameters parameters(entry.parameters);
  if (!gauge.empty()) parameters.set("gauge", gauge);
  return entry.make(parameters);
}

// An energy on a small domain, at a state where it is defined.
struct Case {
  std::string name;
  std::unique_ptr<Energy> energy;
  Domain domain;
  Matrix U;
};

// The rest state, or its shadow, turned a little, scaled and disturbed: 0.02 leaves all cells upright.
Case at_state(const std::string& name, const Domain& domain, double scale, const std::string& gauge = "") {
  auto energy = make(name, gauge);
  const int d = energy->traits(domain).dimension();
  std::srand(7);
  Matrix U = scale * (domain.positions().leftCols(d) + 0.02 * Matrix::Random(domain.vertex_count(), d));
  return {name + " " + gauge + " on " + to_string(domain.kind()), std::move(energy), domain, std::move(U)};
}

std::vector<Case> cases(double scale) {
  const Domain plane(rectangle_mesh({.h = 0.25, .jitter = 0.2}));
  const Domain sheet(testing::bump_mesh(0.25));
  const Domain body(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  std::vector<Case> all;
  all.push_back(at_state("symmetric_dirichlet", plane, scale));
  all.push_back(at_state("symmetric_dirichlet", body, scale));
  for (const std::string gauge : {"world", "transport", "raw"}) {
    all.push_back(at_state("symmetric_dirichlet_parametrization", sheet, scale, gauge));
  }
  all.push_back(at_state("arap", plane, scale));
  all.push_back(at_state("arap", sheet, scale));
  all.push_back(at_state("arap", body, scale));
  all.push_back(at_state("arap_parametrization", sheet, scale, "world"));
  all.push_back(at_state("arap_parametrization", sheet, scale, "transport"));
  return all;
}

Constraints one_pin(const Case& at) {
  Constraints constraints(at.domain.vertex_count(), static_cast<int>(at.U.cols()));
  constraints.fix(0, at.U.row(0));
  return constraints;
}

TEST(NewtonModel, GradientIsThatOfTheObjectiveByDifferences) {
  for (const Case& at : cases(1.0)) {
    for (const NormOptions& norm :
         {NormOptions{}, NormOptions{.beta = 0.3}, NormOptions{.beta = 0.3, .regularizer = Regularizer::tikhonov}}) {
      SCOPED_TRACE(at.name + " beta " + std::to_string(norm.beta));
      Constraints constraints = one_pin(at);
      constraints.attract(3, at.U.row(3).array() + 0.1, 0.7);
      Problem problem(at.domain, *at.energy, norm, constraints);
      const auto linear = make_linear_backend("eigen.ldlt");
      ProblemObjective objective(problem, *linear);
      NewtonModel model(problem);
      ASSERT_TRUE(std::isfinite(objective.value(at.U).total));
      const Matrix gradient = model.gradient(at.U);
      for (int sample = 0; sample < 5; ++sample) {
        Matrix direction = Matrix::Random(at.U.rows(), at.U.cols());
        direction.row(0).setZero();
        const double step = 1e-6;
        const double difference = (objective.value(at.U + step * direction).objective() -
                                   objective.value(at.U - step * direction).objective()) /
                                  (2 * step);
        EXPECT_NEAR(difference, gradient.cwiseProduct(direction).sum(), 1e-6 * gradient.norm());
      }
      // The slope of the direction is that of the gradient.
      objective.value(at.U);
      const Direction newton = objective.newton(at.U, 1e-9);
      EXPECT_LT(newton.slope, 0.0);
      EXPECT_NEAR(newton.slope, gradient.cwiseProduct(newton.step).sum(), 1e-7 * std::abs(newton.slope));
      EXPECT_TRUE(newton.step.row(0).isZero(0.0));
    }
  }
}

Eigen::MatrixXd hessian_by_differences(Problem& problem, const Matrix& U) {
  NewtonModel model(problem);
  const double step = 1e-5;
  const auto gradient = [&](const Matrix& at) {
    EXPECT_EQ(problem.refresh_target(at), 0);
    return model.gradient(at);
  };
  const Eigen::Index d = U.cols();
  Eigen::MatrixXd H(U.size(), U.size());
  for (Eigen::Index k = d; k < U.size(); ++k) {
    Matrix forward = U;
    Matrix backward = U;
    forward.data()[k] += step;
    backward.data()[k] -= step;
    const Matrix column = (gradient(forward) - gradient(backward)) / (2 * step);
    H.col(k) = Eigen::Map<const Eigen::VectorXd>(column.data(), column.size());
  }
  problem.refresh_target(U);
  return H.bottomRightCorner(U.size() - d, U.size() - d);  // vertex 0 is held
}

// Stretched, the energies are convex on every cell: nothing is projected.
TEST(NewtonModel, MatrixIsHalfTheHessianWhereNoCellHasNegativeCurvature) {
  for (const Case& at : cases(2.0)) {
    if (at.name.find("arap on surface") == 0) continue;  // flat directions across the surface stay
    SCOPED_TRACE(at.name);
    Problem problem(at.domain, *at.energy, {}, one_pin(at));
    problem.refresh_target(at.U);
    NewtonModel model(problem);
    const Eigen::MatrixXd found = 2.0 * testing::dense_symmetric(model.matrix(at.U));
    const Eigen::MatrixXd expected = hessian_by_differences(problem, at.U);
    EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-6 * expected.cwiseAbs().maxCoeff());
  }
}

// Shrunk, twists have negative curvature: the Hessian of each cell, by differences, without its negative eigenvalues.
TEST(NewtonModel, MatrixIsTheSumOfTheProjectedHessiansOfTheCells) {
  for (const Case& at : cases(0.7)) {
    SCOPED_TRACE(at.name);
    const auto& energy = dynamic_cast<const TargetEnergy&>(*at.energy);
    Problem problem(at.domain, *at.energy, {}, one_pin(at));
    problem.refresh_target(at.U);
    const Form& form = problem.terms().front().form;
    const auto d = static_cast<int>(at.U.cols());
    const int corners = at.domain.cell_size();
    const int size = d * corners;
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(at.U.size(), at.U.size());
    bool projected = false;
    for (Index t = 0; t < at.domain.cell_count(); ++t) {
      const auto value = [&](const Eigen::VectorXd& u) {
        Matrix moved = at.U;
        for (int i = 0; i < size; ++i) moved(form.node(t, i / d), i % d) += u[i];
        const TargetEnergy::SmallMatrix Y = TargetEnergy::value(form, t, moved);
        TargetEnergy::SmallMatrix c = Y;
        EXPECT_TRUE(energy.target_of(at.domain, t, Y, c, nullptr));
        return at.domain.cell_measures()[t] * (Y - c).squaredNorm();
      };
      // Second differences, fourth order.
      const double h = 2e-3 * std::sqrt(at.domain.cell_measures()[t]);
      Eigen::MatrixXd H(size, size);
      for (int i = 0; i < size; ++i) {
        for (int j = 0; j <= i; ++j) {
          double sum = 0.0;
          for (const auto& [a, wa] : {std::pair(-2, 1.0), {-1, -8.0}, {1, 8.0}, {2, -1.0}}) {
            for (const auto& [b, wb] : {std::pair(-2, 1.0), {-1, -8.0}, {1, 8.0}, {2, -1.0}}) {
              Eigen::VectorXd u = Eigen::VectorXd::Zero(size);
              u[i] += a * h;
              u[j] += b * h;
              sum += wa * wb * value(u);
            }
          }
          H(i, j) = H(j, i) = sum / (144.0 * h * h);
        }
      }
      // Negative eigenvalues are those of vec Y: through an orthonormal basis of the values, Y = Q z.
      Eigen::MatrixXd coupled(form.residuals() * d, size);
      coupled.setZero();
      for (int i = 0; i < corners; ++i) {
        for (int j = 0; j < d; ++j)
          coupled.block(j * form.residuals(), i * d + j, form.residuals(), 1) = form.block(t).col(i);
      }
      Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(coupled);
      qr.setThreshold(1e-10);
      const Eigen::MatrixXd Q = Eigen::MatrixXd(qr.householderQ()).leftCols(qr.rank());
      const Eigen::MatrixXd z_of_u = Q.transpose() * coupled;
      const Eigen::MatrixXd u_of_z = z_of_u.completeOrthogonalDecomposition().pseudoInverse();
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(u_of_z.transpose() * H * u_of_z);
      projected = projected || eigen.eigenvalues().minCoeff() < -0.1 * at.domain.cell_measures()[t];
      const Eigen::MatrixXd positive = z_of_u.transpose() * eigen.eigenvectors() *
                                       eigen.eigenvalues().cwiseMax(0.0).asDiagonal() *
                                       eigen.eigenvectors().transpose() * z_of_u;
      for (int i = 0; i < size; ++i) {
        for (int j = 0; j < size; ++j) {
          expected(form.node(t, i / d) * d + i % d, form.node(t, j / d) * d + j % d) += positive(i, j);
        }
      }
    }
    EXPECT_TRUE(projected);
    NewtonModel model(problem);
    const Eigen::MatrixXd found = 2.0 * testing::dense_symmetric(model.matrix(at.U));
    const auto rest = at.U.size() - d;
    EXPECT_LT((found - expected.bottomRightCorner(rest, rest)).cwiseAbs().maxCoeff(),
              1e-5 * expected.cwiseAbs().maxCoeff());
    const Vector eigenvalues = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(found).eigenvalues();
    EXPECT_GE(eigenvalues.minCoeff(), -1e-12 * eigenvalues.maxCoeff());
  }
}

// For beta > 0 the plain part keeps its Hessian, and the variation adds J' Q'BQ J with J = dr/du by differences.
TEST(NewtonModel, RegularizedMatrixAddsTheGaussNewtonMatrixOfTheVariation) {
  const double beta = 0.3;
  for (const Case& at : cases(0.9)) {
    if (at.name.find("transport") != std::string::npos) continue;  // no scalar matrix: see the gradients
    SCOPED_TRACE(at.name);
    Problem plain(at.domain, *at.energy, {}, one_pin(at));
    Problem problem(at.domain, *at.energy, {.beta = beta}, one_pin(at));
    plain.refresh_target(at.U);
    problem.refresh_target(at.U);
    NewtonModel plain_model(plain);
    NewtonModel model(problem);
    const Eigen::MatrixXd plain_matrix = testing::dense_symmetric(plain_model.matrix(at.U));
    const Eigen::MatrixXd found = testing::dense_symmetric(model.matrix(at.U));
    // Residuals as rows of components, cells in the columns' place: W acts on each component.
    Problem other(at.domain, *at.energy, {}, one_pin(at));
    const auto residual = [&](const Matrix& U) {
      EXPECT_EQ(other.refresh_target(U), 0);
      return other.residual(U);
    };
    const double step = 1e-6;
    const auto d = at.U.cols();
    std::vector<Matrix> columns;
    for (Eigen::Index k = d; k < at.U.size(); ++k) {
      Matrix forward = at.U;
      Matrix backward = at.U;
      forward.data()[k] += step;
      backward.data()[k] -= step;
      columns.emplace_back((residual(forward) - residual(backward)) / (2 * step));
    }
    const Vector weights = facet_weights(at.domain, FacetWeight::facet_measure);
    Eigen::MatrixXd variation(columns.size(), columns.size());
    std::vector<Matrix> jumps;
    for (const Matrix& column : columns) {
      Matrix jump(at.domain.facet_count(), column.cols());
      for (Index f = 0; f < at.domain.facet_count(); ++f) {
        jump.row(f) = std::sqrt(weights[f]) *
                      (column.row(at.domain.facet_cells()(f, 0)) - column.row(at.domain.facet_cells()(f, 1)));
      }
      jumps.push_back(std::move(jump));
    }
    for (std::size_t i = 0; i < jumps.size(); ++i) {
      for (std::size_t j = 0; j < jumps.size(); ++j) variation(i, j) = jumps[i].cwiseProduct(jumps[j]).sum();
    }
    const Eigen::MatrixXd expected = (1.0 - beta) * plain_matrix + beta * variation;
    EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-7 * expected.cwiseAbs().maxCoeff());
  }
}

// The same through the stacked residuals of the objective, for all gauges: J'W J at beta less its plain part.
TEST(NewtonModel, RegularizedMatrixAddsTheVariationOfTheStackedResidual) {
  const double beta = 0.3;
  for (const Case& at : cases(0.9)) {
    SCOPED_TRACE(at.name);
    Problem plain(at.domain, *at.energy, {}, one_pin(at));
    Problem problem(at.domain, *at.energy, {.beta = beta}, one_pin(at));
    const auto linear = make_linear_backend("eigen.ldlt");
    const auto normal = [&](Problem& of) {
      const SparseMatrix J = ProblemObjective(of, *linear).least_squares(at.U).jacobian;  // refreshes the targets
      return Eigen::MatrixXd(J.transpose() * J);
    };
    const Eigen::MatrixXd variation = normal(problem) - (1.0 - beta) * normal(plain);
    NewtonModel plain_model(plain);
    NewtonModel model(problem);
    const Eigen::MatrixXd expected = (1.0 - beta) * testing::dense_symmetric(plain_model.matrix(at.U)) + variation;
    const Eigen::MatrixXd found = testing::dense_symmetric(model.matrix(at.U));
    EXPECT_GT(variation.cwiseAbs().maxCoeff(), 0.1 * found.cwiseAbs().maxCoeff());
    EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-12 * expected.cwiseAbs().maxCoeff());
  }
}

TEST(NewtonModel, MatrixHasTheSameBitsOnOneThread) {
  const Case at = at_state("symmetric_dirichlet", Domain(rectangle_mesh({.h = 1.0 / 40, .jitter = 0.2})), 1.0);
  const Matrix U = at.domain.positions() * Eigen::Matrix2d{{0.8, 0.3}, {0.0, 1.1}};
  Constraints constraints(at.domain.vertex_count(), 2);
  constraints.fix(0, U.row(0));
  Problem problem(at.domain, *at.energy, {}, constraints);
  problem.refresh_target(U);
  NewtonModel model(problem);
  const SparseMatrix many = model.matrix(U);
  const Matrix gradient = model.gradient(U);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const SparseMatrix& single = model.matrix(U);
  ASSERT_EQ(many.nonZeros(), single.nonZeros());
  EXPECT_TRUE(std::equal(many.valuePtr(), many.valuePtr() + many.nonZeros(), single.valuePtr()));
  EXPECT_EQ(gradient, model.gradient(U));
}

struct Outcome {
  Matrix U;
  NonlinearReport report;
};

Outcome minimize(const std::string& backend, const Domain& domain, const Energy& energy, const NormOptions& norm,
                 const Constraints& constraints, const Matrix& start,
                 const NonlinearOptions& options = {.tolerance = 1e-12, .max_iterations = 1000}) {
  Problem problem(domain, energy, norm, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  const auto nonlinear = make_nonlinear_backend(backend);
  Outcome run;
  run.U = nonlinear->minimize(objective, start, options);
  run.report = nonlinear->report();
  return run;
}

Constraints boundary_at(const Domain& domain, const Matrix& U) {
  Constraints constraints(domain.vertex_count(), static_cast<int>(U.cols()));
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.boundary_vertices()[v]) constraints.fix(v, U.row(v));
  }
  return constraints;
}

// The energy is polyconvex: with the boundary at an affine map, this map is the minimizer (Ball 1977).
TEST(SymmetricDirichlet, AffineBoundariesHaveAffineMinimizers) {
  const Domain plane(rectangle_mesh({.h = 0.1, .jitter = 0.2}));
  const Domain body(bar_tet_mesh(1.0, 1.0, 1.0, 0.25, 0.2));
  const auto energy = make("symmetric_dirichlet");
  const auto check = [&](const Domain& domain, const Eigen::MatrixXd& A, double density) {
    const Matrix expected = domain.positions() * A;
    Matrix start = expected;
    std::srand(2);
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (!domain.boundary_vertices()[v]) start.row(v) += 0.015 * Eigen::RowVectorXd::Random(A.cols());
    }
    ASSERT_TRUE(distortion(domain, start).flipped.empty());
    for (const double beta : {0.0, 0.3}) {
      for (const std::string backend : {"newton", "gauss_newton"}) {
        const Outcome run = minimize(backend, domain, *energy, {.beta = beta}, boundary_at(domain, expected), start);
        EXPECT_TRUE(run.report.converged) << backend << ": " << run.report.reason;
        EXPECT_LT((run.U - expected).cwiseAbs().maxCoeff(), 1e-6) << backend << " beta " << beta;
        EXPECT_NEAR(run.report.history.back().energy.plain, density * domain.total_measure(), 1e-9);
      }
    }
  };
  check(plane, Eigen::Vector2d(1.5, 0.8).asDiagonal(), 2.25 + 0.64 + 1 / 2.25 + 1 / 0.64 - 4.0);
  check(body, Eigen::Vector3d(1.2, 0.9, 1.0).asDiagonal(), 1.44 + 0.81 + 1.0 + 1 / 1.44 + 1 / 0.81 + 1.0 - 6.0);
}

TEST(SymmetricDirichlet, ValueIsTheSymmetricDirichletEnergyOfTheDistortion) {
  for (const Case& at : cases(0.9)) {
    if (at.name.find("symmetric_dirichlet") != 0) continue;
    Problem problem(at.domain, *at.energy, {}, one_pin(at));
    ASSERT_EQ(problem.refresh_target(at.U), 0);
    const double m = at.domain.intrinsic_dimension();
    const double expected = at.domain.cell_measures().dot(
        (cell_distortion(at.domain, at.U).symmetric_dirichlet.array() - 2.0 * m).matrix());
    EXPECT_NEAR(problem.value(at.U).plain, expected, 1e-11 * expected) << at.name;
  }
}

TEST(SymmetricDirichlet, InvertedStatesCostInfinitelyMuchAndAreNoStart) {
  const Domain domain(rectangle_mesh({.h = 0.25}));
  const auto energy = make("symmetric_dirichlet");
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(0, domain.positions().row(0));
  Problem problem(domain, *energy, {.beta = 0.2}, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  Matrix U = domain.positions();
  const Index inner = 12;
  ASSERT_FALSE(domain.boundary_vertices()[inner]);
  EXPECT_NEAR(objective.value(U).total, 0.0, 1e-20);
  U(inner, 0) += 0.5;
  const std::size_t flipped = distortion(domain, U).flipped.size();
  ASSERT_GT(flipped, 0U);
  EXPECT_EQ(objective.value(U).objective(), std::numeric_limits<double>::infinity());
  for (const std::string backend : {"newton", "gauss_newton"}) {
    try {
      make_nonlinear_backend(backend)->minimize(objective, U, {});
      FAIL() << backend;
    } catch (const DataError& error) {
      EXPECT_THAT(error.what(), HasSubstr(std::to_string(flipped) + " of 32"));
      EXPECT_THAT(error.what(), HasSubstr("Tutte"));
    }
  }
  // Back again.
  EXPECT_NEAR(objective.value(domain.positions()).total, 0.0, 1e-20);
}

TEST(SymmetricDirichlet, IsRefusedByAlternationsAndOnSurfacesInSpace) {
  const Domain domain(rectangle_mesh({.h = 0.25}));
  const auto energy = make("symmetric_dirichlet");
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(0, domain.positions().row(0));
  for (const std::string backend : {"local_global", "coupled"}) {
    try {
      minimize(backend, domain, *energy, {}, constraints, domain.positions());
      FAIL() << backend;
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("newton")) << backend;
    }
  }
  EXPECT_THROW(energy->traits(Domain(testing::bump_mesh(0.25))), UsageError);
}

TEST(SymmetricDirichlet, LongestStepIsWhereTheFirstCellFlips) {
  const Domain domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  const auto energy = make("symmetric_dirichlet");
  Constraints constraints(domain.vertex_count(), 3);
  constraints.fix(0, domain.positions().row(0));
  Problem problem(domain, *energy, {}, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  std::srand(1);
  const Matrix& U = domain.positions();
  const Matrix step = Matrix::Random(U.rows(), 3);
  const double longest = objective.longest_step(U, step);
  EXPECT_TRUE(std::isfinite(objective.value(U + 0.9999 * longest * step).total));
  EXPECT_FALSE(std::isfinite(objective.value(U + 1.0001 * longest * step).total));
  const auto arap = make("arap");
  Problem without(domain, *arap, {}, constraints);
  EXPECT_EQ(ProblemObjective(without, *linear).longest_step(U, step), std::numeric_limits<double>::infinity());
}

// A bumpy sheet to the plane from a Tutte map, one corner held.
TEST(Newton, ConvergesQuadraticallyOnSymmetricDirichlet) {
  const Domain domain(testing::bump_mesh(0.1, 0.6));
  const auto energy = make("symmetric_dirichlet_parametrization");
  const auto linear = make_linear_backend("auto");
  const Matrix start = tutte_map(domain, TutteBoundary::circle, TutteWeights::mean_value, *linear);
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(0, start.row(0));
  const Outcome run = minimize("newton", domain, *energy, {}, constraints, start);
  ASSERT_TRUE(run.report.converged) << run.report.reason;
  EXPECT_TRUE(distortion(domain, run.U).flipped.empty());
  const auto& history = run.report.history;
  for (std::size_t i = 1; i < history.size(); ++i) EXPECT_LE(history[i].energy.total, history[i - 1].energy.total);
  // Excess of the energy is squared from step to step: the order is that of the last ones above rounding.
  const double minimum = history.back().energy.total;
  double order = 0.0;
  for (std::size_t i = 2; i < history.size(); ++i) {
    const double a = history[i - 2].energy.total - minimum;
    const double b = history[i - 1].energy.total - minimum;
    const double c = history[i].energy.total - minimum;
    if (c > 1e-13 * minimum && a < 1e-1 * minimum) order = std::max(order, std::log(c / b) / std::log(b / a));
  }
  EXPECT_GT(order, 1.8);
  EXPECT_LT(history.size(), 60U);
}

TEST(Newton, ReachesTheMinimumOfGaussNewtonOnEveryEnergyForEveryBeta) {
  for (const Case& at : cases(1.0)) {
    for (const double beta : {0.0, 0.05, 0.3}) {
      SCOPED_TRACE(at.name + " beta " + std::to_string(beta));
      Constraints constraints(at.domain.vertex_count(), static_cast<int>(at.U.cols()));
      for (Index v = 0; v < at.domain.vertex_count(); ++v) {
        if (at.domain.positions()(v, 0) < 1e-9 || at.domain.positions()(v, 0) > 1.0 - 1e-9)
          constraints.fix(v, at.U.row(v));
      }
      const Outcome newton = minimize("newton", at.domain, *at.energy, {.beta = beta}, constraints, at.U);
      const Outcome gauss = minimize("gauss_newton", at.domain, *at.energy, {.beta = beta}, constraints, at.U);
      ASSERT_TRUE(newton.report.converged) << newton.report.reason;
      const double a = newton.report.history.back().energy.total;
      const double b = gauss.report.history.back().energy.total;
      // The linearized residual does not see how an unstretched surface bends: Gauss-Newton may stall there.
      if (gauss.report.converged) {
        EXPECT_NEAR(a, b, 1e-8 * b);
      } else {
        EXPECT_EQ(at.name, "arap  on surface") << gauss.report.reason;
        EXPECT_LE(a, b * (1 + 1e-8));
      }
      const auto& history = newton.report.history;
      for (std::size_t i = 1; i < history.size(); ++i) {
        EXPECT_LE(history[i].energy.total, history[i - 1].energy.total * (1 + 1e-14));
      }
    }
  }
}

TEST(Newton, NeedsAFeasibleStartAndTargetsOfTheCells) {
  const Domain domain(rectangle_mesh({.h = 0.5}));
  Constraints constraints(domain.vertex_count(), 2);
  for (Index v = 0; v < 3; ++v) constraints.fix(v, domain.positions().row(v).array() + (v == 1 ? 0.1 : 0.0));
  const auto linear = make_linear_backend("eigen.ldlt");
  const auto arap = make("arap");
  Problem problem(domain, *arap, {}, constraints);
  ProblemObjective objective(problem, *linear);
  EXPECT_THROW(objective.newton(domain.positions(), 0.0), UsageError);
  const auto asap = make("asap");
  Problem plain(domain, *asap, {}, constraints);
  ProblemObjective no_targets(plain, *linear);
  EXPECT_THROW(no_targets.newton(domain.positions(), 0.0), UsageError);
}

}  // namespace
}  // namespace variform
