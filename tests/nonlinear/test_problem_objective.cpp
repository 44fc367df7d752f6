// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>

#include "framework/base/error.h"
#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/nonlinear/arap_problems.h"

namespace variform {
namespace {

using testing::ArapProblem;
using ::testing::HasSubstr;

ArapProblem transported_parametrization() {
  ArapProblem problem = testing::arap_problems()[3];
  const EnergyEntry& entry = energies().find("arap_parametrization");
  Parameters parameters(entry.parameters);
  parameters.set("gauge", std::string("transport"));
  problem.name = "transported parametrization";
  problem.energy = entry.make(parameters);
  return problem;
}

// Linear equalities that share vertices with each other, with identified and with fixed ones.
ArapProblem with_equalities() {
  ArapProblem problem = testing::arap_problems()[4];
  problem.name = "linear equalities";
  const Matrix& x = problem.domain->positions();
  const auto at = [&](double a, double b) { return testing::nearest(x, Eigen::RowVector2d(a, b)); };
  Constraints& constraints = problem.constraints;
  constraints.combine({at(0.4, 0.4), at(0.6, 0.4), at(0.6, 0.6)}, {0.2, 0.3, 0.5}, Eigen::RowVector2d(0.6, 0.5));
  constraints.combine({at(0.6, 0.6), at(0.0, 1.0)}, {1.0, -1.0}, Eigen::RowVector2d(0.5, -0.4));
  constraints.combine({at(0.4, 0.0), at(0.4, 0.2)}, {-1.0, 1.0}, Eigen::RowVector2d(0.05, 0.25));
  problem.start = closest_feasible(constraints, problem.start);
  return problem;
}

struct Setting {
  ArapProblem of;
  NormOptions norm;

  std::string name() const {
    return of.name + ", beta " + std::to_string(norm.beta) +
           (norm.regularizer == Regularizer::tikhonov ? ", Tikhonov" : "");
  }
};

std::vector<Setting> settings() {
  std::vector<ArapProblem> problems = testing::arap_problems();
  problems.push_back(transported_parametrization());
  problems.push_back(with_equalities());
  ArapProblem soft = problems[2];  // of the default weight, in space
  soft.name = "tetrahedral, soft";
  soft.constraints.attract(20, soft.start.row(20) + Eigen::RowVector3d(0.1, 0.0, 0.2));
  problems.push_back(soft);
  std::vector<Setting> all;
  for (const ArapProblem& problem : problems) {
    for (const double beta : {0.0, 0.3}) all.push_back({problem, {.beta = beta}});
    all.push_back({problem, {.beta = 0.2, .facet_weight = FacetWeight::finite_volume}});
    all.push_back({problem, {.beta = 0.2, .regularizer = Regularizer::tikhonov}});
  }
  return all;
}

// An objective at a state that is neither a minimum nor special.
struct AtState {
  explicit AtState(const Setting& setting)
      : problem(*setting.of.domain, *setting.of.energy, setting.norm, setting.of.constraints),
        linear(make_linear_backend("eigen.ldlt")),
        objective(problem, *linear) {
    std::srand(11);
    const Eigen::VectorXd y = objective.variables(setting.of.start);
    variables = y + 0.03 * Eigen::VectorXd::Random(y.size());
  }

  double value(const Eigen::VectorXd& y) { return objective.value(objective.state(y)).objective(); }
  LeastSquares least_squares(const Eigen::VectorXd& y) { return objective.least_squares(objective.state(y)); }

  Problem problem;
  std::unique_ptr<LinearBackend> linear;
  ProblemObjective objective;
  Eigen::VectorXd variables;
};

TEST(ProblemObjective, StatesOfVariablesSatisfyTheConstraints) {
  for (const Setting& setting : settings()) {
    SCOPED_TRACE(setting.name());
    AtState at(setting);
    const Matrix U = at.objective.state(at.variables);
    const Constraints& constraints = setting.of.constraints;
    for (const auto& fixed : constraints.fixed()) EXPECT_EQ(U.row(fixed.vertex), fixed.value);
    for (const auto& pair : constraints.identified()) EXPECT_EQ(U.row(pair.first), U.row(pair.second));
    for (const auto& equality : constraints.equalities()) {
      Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(U.cols());
      for (std::size_t i = 0; i < equality.vertices.size(); ++i) {
        sum += equality.weights[i] * U.row(equality.vertices[i]);
      }
      EXPECT_LT((sum - equality.value).norm(), 1e-13);
    }
    EXPECT_EQ(at.objective.variables(U), at.variables);
    EXPECT_LT((at.objective.state(at.objective.variables(setting.of.start)) - setting.of.start).norm(), 1e-12);
    // Nothing that the constraints leave free is missing: d rows for each hard constraint.
    const auto held = constraints.fixed().size() + constraints.identified().size() + constraints.equalities().size();
    EXPECT_EQ(at.variables.size(), U.size() - static_cast<Eigen::Index>(held) * U.cols());
  }
}

TEST(ProblemObjective, GradientIsThatOfTheValueByDifferences) {
  for (const Setting& setting : settings()) {
    SCOPED_TRACE(setting.name());
    AtState at(setting);
    const Eigen::VectorXd gradient = at.objective.gradient(at.objective.state(at.variables));
    ASSERT_EQ(gradient.size(), at.variables.size());
    const double h = 1e-5;
    Eigen::VectorXd differences(gradient.size());
    for (Eigen::Index j = 0; j < gradient.size(); ++j) {
      Eigen::VectorXd y = at.variables;
      y[j] += h;
      const double above = at.value(y);
      y[j] -= 2.0 * h;
      differences[j] = (above - at.value(y)) / (2.0 * h);
    }
    EXPECT_LT((gradient - differences).cwiseAbs().maxCoeff(), 1e-6 * gradient.cwiseAbs().maxCoeff());
  }
}

TEST(ProblemObjective, SquareOfTheStackedResidualIsTheValue) {
  for (const Setting& setting : settings()) {
    SCOPED_TRACE(setting.name());
    AtState at(setting);
    const double value = at.value(at.variables);
    EXPECT_NEAR(at.least_squares(at.variables).residual.squaredNorm(), value, 1e-12 * value);
  }
}

TEST(ProblemObjective, StackedJacobianIsThatOfTheResidualByDifferences) {
  for (const Setting& setting : settings()) {
    SCOPED_TRACE(setting.name());
    AtState at(setting);
    const LeastSquares model = at.least_squares(at.variables);
    ASSERT_EQ(model.jacobian.cols(), at.variables.size());
    ASSERT_TRUE(model.jacobian.isCompressed());
    const double h = 1e-5;
    for (int k = 0; k < 5; ++k) {
      const Eigen::VectorXd direction = Eigen::VectorXd::Random(at.variables.size());
      const Eigen::VectorXd difference = (at.least_squares(at.variables + h * direction).residual -
                                          at.least_squares(at.variables - h * direction).residual) /
                                         (2.0 * h);
      const Eigen::VectorXd derivative = model.jacobian * direction;
      EXPECT_LT((derivative - difference).cwiseAbs().maxCoeff(), 1e-6 * derivative.cwiseAbs().maxCoeff());
    }
    const Eigen::VectorXd gradient = at.objective.gradient(at.objective.state(at.variables));
    EXPECT_LT((2.0 * model.jacobian.transpose() * model.residual - gradient).norm(), 1e-11 * gradient.norm());
  }
}

TEST(ProblemObjective, GaussNewtonDirectionSolvesTheLeastSquaresProblem) {
  for (const Setting& setting : settings()) {
    SCOPED_TRACE(setting.name());
    if (!setting.of.constraints.equalities().empty()) continue;  // eigen.ldlt takes definite systems only
    AtState at(setting);
    const Matrix U = at.objective.state(at.variables);
    const LeastSquares model = at.objective.least_squares(U);
    const Eigen::VectorXd step = Eigen::MatrixXd(model.jacobian).colPivHouseholderQr().solve(-model.residual);
    const Direction direction = at.objective.gauss_newton(U, 0.0);
    EXPECT_LT((at.objective.state(at.variables + step) - U - direction.step).cwiseAbs().maxCoeff(),
              1e-7 * direction.step.cwiseAbs().maxCoeff());
    EXPECT_NEAR(at.objective.gradient(U).dot(step), direction.slope, 1e-9 * std::abs(direction.slope));
  }
}

TEST(ProblemObjective, PatternOfTheJacobianStays) {
  for (const Setting& setting : settings()) {
    SCOPED_TRACE(setting.name());
    AtState at(setting);
    const SparseMatrix rest = at.objective.least_squares(setting.of.start).jacobian;
    const SparseMatrix here = at.least_squares(at.variables).jacobian;
    ASSERT_EQ(rest.nonZeros(), here.nonZeros());
    EXPECT_TRUE(std::equal(rest.innerIndexPtr(), rest.innerIndexPtr() + rest.nonZeros(), here.innerIndexPtr()));
  }
}

TEST(ProblemObjective, StatesThatViolateConstraintsHaveNoGradient) {
  const Setting setting{testing::arap_problems()[0], {}};
  AtState at(setting);
  Matrix U = setting.of.start;
  const Index vertex = setting.of.constraints.fixed().back().vertex;
  U(vertex, 1) += 0.25;
  for (const std::function<void()>& ask : {std::function<void()>([&] { at.objective.gradient(U); }),
                                           std::function<void()>([&] { at.objective.least_squares(U); }),
                                           std::function<void()>([&] { at.objective.variables(U); })}) {
    try {
      ask();
      ADD_FAILURE() << "no error";
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("vertex " + std::to_string(vertex) + " is 0.25 away"));
    }
  }
}

TEST(FreeVariables, ContradictingEqualitiesAreAnError) {
  Constraints constraints(4, 2);
  constraints.combine({0, 1}, {1.0, 1.0}, Eigen::RowVector2d(1.0, 0.0));
  constraints.combine({1, 2}, {1.0, 1.0}, Eigen::RowVector2d(1.0, 0.0));
  EXPECT_EQ(FreeVariables(constraints).count(), 4);
  constraints.combine({0, 1}, {2.0, 2.0}, Eigen::RowVector2d(2.0, 0.0));  // says the same twice
  EXPECT_EQ(FreeVariables(constraints).count(), 4);
  constraints.combine({0, 2}, {1.0, -1.0}, Eigen::RowVector2d(0.5, 0.0));  // follows from these, but for the value
  EXPECT_THROW(FreeVariables{constraints}, DataError);
}

// Equalities between fixed vertices, or those that are identified, take no variable away.
TEST(FreeVariables, EqualitiesThatHoldAlreadyTakeNothingAway) {
  const Eigen::RowVector2d zero = Eigen::RowVector2d::Zero();
  Constraints fixed(3, 2);
  fixed.fix(0, Eigen::RowVector2d(1.0, 2.0));
  fixed.fix(1, Eigen::RowVector2d(1.0, 2.0));
  fixed.combine({0, 1}, {1.0, -1.0}, zero);
  const FreeVariables variables(fixed);
  EXPECT_EQ(variables.count(), 2);
  EXPECT_EQ(variables.state(Eigen::Vector2d(5.0, 6.0)), (Matrix{{1.0, 2.0}, {1.0, 2.0}, {5.0, 6.0}}));
  fixed.combine({0, 1}, {1.0, 1.0}, zero);
  EXPECT_THROW(FreeVariables{fixed}, DataError);

  Constraints seam(3, 2);
  seam.identify(0, 1);
  seam.combine({0, 1}, {1.0, -1.0}, zero);
  EXPECT_EQ(FreeVariables(seam).count(), 4);
}

// Through Lagrange multipliers: steps stay on the equalities, and lead to where the gradient on them vanishes.
TEST(ProblemObjective, SecondOrderBackendsMinimizeUnderLinearEqualities) {
  const ArapProblem of = with_equalities();
  for (const double beta : {0.0, 0.3}) {
    std::vector<double> energies;
    for (const std::string name : {"gauss_newton", "newton"}) {
      SCOPED_TRACE(name + ", beta " + std::to_string(beta));
      Problem problem(*of.domain, *of.energy, {.beta = beta}, of.constraints);
      const auto linear = make_linear_backend("eigen.lu");
      ProblemObjective objective(problem, *linear);
      const auto backend = make_nonlinear_backend(name);
      const Matrix U = backend->minimize(objective, of.start, {.tolerance = 1e-12, .gradient_tolerance = 1e-9});
      EXPECT_TRUE(backend->report().converged) << backend->report().reason;
      EXPECT_GT(backend->report().iterations, 1);
      EXPECT_LT((objective.state(objective.variables(U)) - U).cwiseAbs().maxCoeff(), 1e-11);
      const EnergyValue value = objective.value(U);
      EXPECT_LT(stationarity(objective, objective.gradient(U), value), 1e-4);
      energies.push_back(value.objective());
    }
    EXPECT_NEAR(energies[0], energies[1], 1e-9 * energies[0]);
  }
}

}  // namespace
}  // namespace variform
