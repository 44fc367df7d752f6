// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <set>

#include "framework/base/error.h"
#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/nonlinear/arap_problems.h"

namespace variform {
namespace {

using ::testing::AnyOf;
using testing::ArapProblem;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// Those that wrap a library, in this build.
std::vector<NonlinearBackendEntry> library_backends() {
  std::vector<NonlinearBackendEntry> entries;
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    if (entry.available && !entry.package.empty()) entries.push_back(entry);
  }
  return entries;
}

struct Outcome {
  Matrix U;
  double energy = 0.0;
  NonlinearReport report;
};

Outcome minimize(NonlinearBackend& backend, const ArapProblem& of, double beta, const NonlinearOptions& options,
                 const NonlinearBackend::Observer& observer = {}) {
  Problem problem(*of.domain, *of.energy, {.beta = beta}, of.constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  Outcome outcome;
  outcome.U = backend.minimize(objective, of.start, options, observer);
  outcome.energy = objective.value(outcome.U).objective();
  outcome.report = backend.report();
  return outcome;
}

Outcome minimize(const std::string& backend, const ArapProblem& of, double beta, const NonlinearOptions& options,
                 const NonlinearBackend::Observer& observer = {}) {
  return minimize(*make_nonlinear_backend(backend), of, beta, options, observer);
}

// Of the registered backends, `coupled` alone is left out: it minimizes over targets that it carries along, each exact
// with all others held, and may end in another, poorer minimum (a diagnostic). For beta > 0 `local_global` has a fixed
// point of its own, too. The moving asymptotes know no curvature across variables and may end at the iteration limit.
TEST(NonlinearBackends, ReachTheSameMinimumOrSayWhyNot) {
  for (const ArapProblem& of : testing::arap_problems()) {
    for (const double beta : {0.0, 0.3}) {
      const Outcome best = minimize("gauss_newton", of, beta, {.tolerance = 1e-12, .gradient_tolerance = 1e-8});
      ASSERT_TRUE(best.report.converged) << best.report.reason;
      for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
        if (!entry.available || entry.name == "coupled" || (entry.name == "local_global" && beta > 0.0)) continue;
        SCOPED_TRACE(entry.name + " on " + of.name + ", beta " + std::to_string(beta));
        const Outcome run = minimize(entry.name, of, beta, {.tolerance = 1e-8, .max_iterations = 2500});
        SCOPED_TRACE(run.report.reason);
        EXPECT_GE(run.energy, best.energy * (1.0 - 1e-6));
        if (run.report.converged) {
          EXPECT_THAT(run.report.reason, HasSubstr("at most"));
        } else {
          EXPECT_THAT(run.report.reason, AnyOf(StartsWith("iteration limit"), StartsWith("the library gives up")));
        }
        if (run.report.converged || entry.name != "nlopt.mma") {
          EXPECT_LE(run.energy, best.energy * (1.0 + 1e-6));
        }
      }
    }
  }
}

TEST(NonlinearBackends, EveryChoiceOfCeresReachesTheMinimum) {
  const ArapProblem of = testing::arap_problems()[3];
  const double energy = minimize("gauss_newton", of, 0.3, {}).energy;
  const auto with = [&](const std::string& backend, const std::string& key, const std::string& choice) {
    Parameters parameters(nonlinear_backends().find(backend).parameters);
    parameters.set(key, choice);
    const auto made = make_nonlinear_backend(backend, parameters);
    const Outcome run = minimize(*made, of, 0.3, {.max_iterations = 20000});
    EXPECT_TRUE(run.report.converged) << choice << ": " << run.report.reason;
    EXPECT_NEAR(run.energy, energy, 1e-6 * energy) << choice;
  };
  for (const NonlinearBackendEntry& entry : library_backends()) {
    if (entry.name == "ceres.trust_region") {
      with(entry.name, "strategy", "dogleg");
      with(entry.name, "linear_solver", "cgnr");
      Parameters both(entry.parameters);
      both.set("strategy", std::string("dogleg"));
      both.set("linear_solver", std::string("cgnr"));
      EXPECT_THROW(entry.make(both), UsageError);
    }
    if (entry.name == "ceres.line_search") with(entry.name, "direction", "conjugate_gradient");
  }
}

TEST(LibraryBackends, HistoryNeverRises) {
  for (const ArapProblem& of : testing::arap_problems()) {
    for (const NonlinearBackendEntry& entry : library_backends()) {
      SCOPED_TRACE(entry.name + " on " + of.name);
      int seen = 0;
      const Outcome run = minimize(entry.name, of, 0.3, {.max_iterations = 200}, [&](const NonlinearStep& row) {
        EXPECT_EQ(row.iteration, ++seen);
        return true;
      });
      const auto& history = run.report.history;
      EXPECT_EQ(seen, run.report.iterations);
      ASSERT_EQ(static_cast<int>(history.size()), run.report.iterations + 1);
      for (std::size_t i = 1; i < history.size(); ++i) {
        ASSERT_LE(history[i].energy.objective(), history[i - 1].energy.objective()) << i;
        ASSERT_GE(history[i].seconds, history[i - 1].seconds);
      }
      EXPECT_LT(history.back().energy.objective(), 0.9 * history.front().energy.objective());
      // The state that is returned is that of the last row.
      EXPECT_NEAR(run.energy, history.back().energy.objective(), 1e-13 * run.energy);
    }
  }
}

TEST(LibraryBackends, ConstraintsHoldExactly) {
  for (const ArapProblem& of : testing::arap_problems()) {
    for (const NonlinearBackendEntry& entry : library_backends()) {
      SCOPED_TRACE(entry.name + " on " + of.name);
      const Outcome run = minimize(entry.name, of, 0.3, {.max_iterations = 20});
      for (const auto& fixed : of.constraints.fixed()) EXPECT_EQ(run.U.row(fixed.vertex), fixed.value);
      for (const auto& pair : of.constraints.identified()) EXPECT_EQ(run.U.row(pair.first), run.U.row(pair.second));
    }
  }
}

TEST(NonlinearBackends, IterationLimitIsNotConvergence) {
  const ArapProblem of = testing::arap_problems()[0];
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    if (!entry.available) continue;
    for (const int limit : {0, 1, 3}) {
      SCOPED_TRACE(entry.name);
      const Outcome run = minimize(entry.name, of, 0.3, {.tolerance = 1e-12, .max_iterations = limit});
      EXPECT_FALSE(run.report.converged);
      EXPECT_THAT(run.report.reason, StartsWith("iteration limit " + std::to_string(limit) + " "));
      EXPECT_EQ(run.report.iterations, limit);
      EXPECT_EQ(static_cast<int>(run.report.history.size()), limit + 1);
    }
  }
}

TEST(NonlinearBackends, ObserverStopsThem) {
  const ArapProblem of = testing::arap_problems()[0];
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    if (!entry.available) continue;
    SCOPED_TRACE(entry.name);
    const Outcome run =
        minimize(entry.name, of, 0.3, {.tolerance = 1e-12}, [](const NonlinearStep& row) { return row.iteration < 2; });
    EXPECT_FALSE(run.report.converged);
    EXPECT_EQ(run.report.reason, "stopped by the observer");
    EXPECT_EQ(run.report.iterations, 2);
  }
}

// A start that is a minimum already takes no iteration: every backend that minimizes the objective sees it.
TEST(LibraryBackends, RestPoseIsConvergedAtOnce) {
  ArapProblem of = testing::arap_problems()[0];
  of.constraints = Constraints(of.domain->vertex_count(), 2);
  of.constraints.fix(0, of.domain->positions().row(0));
  of.constraints.fix(5, of.domain->positions().row(5));
  of.start = of.domain->positions();
  for (const NonlinearBackendEntry& entry : library_backends()) {
    SCOPED_TRACE(entry.name);
    const Outcome run = minimize(entry.name, of, 0.3, {});
    EXPECT_TRUE(run.report.converged) << run.report.reason;
    EXPECT_EQ(run.report.iterations, 0);
    EXPECT_EQ(run.U, of.start);
  }
}

TEST(LibraryBackends, StartThatViolatesAConstraintIsAnError) {
  ArapProblem of = testing::arap_problems()[0];
  of.start(of.constraints.fixed().front().vertex, 0) += 0.1;
  for (const NonlinearBackendEntry& entry : library_backends()) {
    EXPECT_THROW(minimize(entry.name, of, 0.0, {}), UsageError) << entry.name;
  }
}

// Sum of u + 1/u - 2 over the coordinates, plus 1: a barrier at 0, beyond which there is no value; minimal at u = 1.
class Barrier final : public Objective {
 public:
  EnergyValue value(const Matrix& U) override {
    ++values;
    if (values == throws_at) throw SolverError("broken on purpose");
    if (!(U.array() > 0.0).all()) return {.total = std::numeric_limits<double>::infinity()};
    lowest = std::min(lowest, U.minCoeff());
    return {.total = 1.0 + (U.array() + U.array().inverse() - 2.0).sum()};
  }
  Eigen::VectorXd variables(const Matrix& U) override { return Eigen::Map<const Eigen::VectorXd>(U.data(), U.size()); }
  Matrix state(const Eigen::VectorXd& y) override { return Eigen::Map<const Matrix>(y.data(), y.size() / 2, 2); }
  Eigen::VectorXd gradient(const Matrix& U) override {
    EXPECT_TRUE((U.array() > 0.0).all()) << "asked for a gradient beyond the barrier";
    const Eigen::VectorXd y = variables(U);
    return 1.0 - y.array().square().inverse();
  }
  // r = (u - 1) / sqrt(u), and a constant row for the 1.
  LeastSquares least_squares(const Matrix& U) override {
    const Eigen::VectorXd y = variables(U);
    LeastSquares model;
    model.residual.resize(y.size() + 1);
    model.residual << (y.array() - 1.0) / y.array().sqrt(), 1.0;
    model.jacobian.resize(y.size() + 1, y.size());
    for (Eigen::Index i = 0; i < y.size(); ++i) {
      model.jacobian.insert(i, i) = 0.5 * (1.0 + 1.0 / y[i]) / std::sqrt(y[i]);
    }
    model.jacobian.makeCompressed();
    return model;
  }
  Matrix local_global_step(const Matrix& U) override { return U; }
  double length_scale() const override { return 1.0; }

  int values = 0;
  int throws_at = -1;
  double lowest = 1e300;
};

const Matrix kFar = Matrix{{30.0, 0.05}, {2.0, 8.0}, {0.001, 1.0}};

TEST(LibraryBackends, StayOnThisSideOfABarrier) {
  for (const NonlinearBackendEntry& entry : library_backends()) {
    SCOPED_TRACE(entry.name);
    Barrier objective;
    const auto backend = make_nonlinear_backend(entry.name);
    const Matrix U = backend->minimize(objective, kFar, {.max_iterations = 2000, .gradient_tolerance = 1e-5});
    EXPECT_TRUE(backend->report().converged) << backend->report().reason;
    EXPECT_LT((U.array() - 1.0).abs().maxCoeff(), 1e-4);
    EXPECT_GT(objective.lowest, 0.0);
  }
}

TEST(LibraryBackends, StartBeyondABarrierIsAnError) {
  for (const NonlinearBackendEntry& entry : library_backends()) {
    Barrier objective;
    const Matrix start{{1.0, -1.0}};
    EXPECT_THROW(make_nonlinear_backend(entry.name)->minimize(objective, start, {}), SolverError) << entry.name;
  }
}

TEST(LibraryBackends, ErrorsOfTheObjectiveComeThrough) {
  for (const NonlinearBackendEntry& entry : library_backends()) {
    for (const int at : {2, 3, 6}) {
      Barrier objective;
      objective.throws_at = at;
      try {
        make_nonlinear_backend(entry.name)->minimize(objective, kFar, {.gradient_tolerance = 1e-12});
        ADD_FAILURE() << entry.name << ": no error";
      } catch (const SolverError& error) {
        EXPECT_STREQ(error.what(), "broken on purpose") << entry.name;
        EXPECT_EQ(objective.values, at) << entry.name << " goes on after an error";
      }
    }
  }
}

TEST(LibraryBackends, DenseMethodsRefuseLargeProblems) {
  for (const NonlinearBackendEntry& entry : library_backends()) {
    if (entry.name != "nlopt.slsqp") continue;
    Parameters parameters(entry.parameters);
    parameters.set("most_variables", std::int64_t{10});
    try {
      minimize(*entry.make(parameters), testing::arap_problems()[0], 0.0, {});
      ADD_FAILURE() << "no error";
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("most_variables"));
      EXPECT_THAT(error.what(), HasSubstr("58 variables"));
    }
  }
}

TEST(NonlinearBackends, WhatIsNotCompiledInSaysWhichPackageBringsIt) {
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    if (entry.available) {
      EXPECT_NE(make_nonlinear_backend(entry.name), nullptr);
      continue;
    }
    try {
      make_nonlinear_backend(entry.name);
      ADD_FAILURE() << entry.name;
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr(entry.package));
      EXPECT_THAT(error.what(), HasSubstr(entry.option));
    }
  }
}

TEST(Stationarity, IsTheShareOfTheEnergyThatChangesToFirstOrder) {
  // E = 1 + sum of u + 1/u - 2, L = 1: with u = (2, 1/2) E is 2, the derivatives 3/4 and -3.
  Barrier objective;
  const Matrix U{{2.0, 0.5}};
  EXPECT_DOUBLE_EQ(stationarity(objective, objective.gradient(U), objective.value(U)), (0.75 + 3.0) / 2.0);
  EXPECT_EQ(stationarity(objective, Eigen::Vector2d::Zero(), EnergyValue{}), 0.0);
  EXPECT_EQ(stationarity(objective, Eigen::Vector2d::Ones(), EnergyValue{}), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace variform
