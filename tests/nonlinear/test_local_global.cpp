// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "framework/base/error.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

// Every step goes half of the way to the goal: U_k - goal = (U_0 - goal) / 2^k, exactly, in binary arithmetic.
class Contraction final : public Objective {
 public:
  explicit Contraction(double scale = 1.0) : scale_(scale) {}

  EnergyValue value(const Matrix& U) override {
    const double distance = (U - goal()).squaredNorm();
    return {.total = distance, .plain = 2.0 * distance, .variation = 3.0 * distance};
  }
  Matrix local_global_step(const Matrix& U) override {
    ++steps;
    if (steps == breaks_at) return Matrix::Constant(U.rows(), U.cols(), broken_value);
    return 0.5 * (U + goal());
  }
  double length_scale() const override { return scale_; }

  static Matrix goal() { return Matrix{{1.0, -2.0}, {4.0, 0.5}}; }
  // Largest coordinate off the goal: 8.
  static Matrix start() { return goal() + Matrix{{8.0, 1.0}, {-2.0, 0.0}}; }

  int steps = 0;
  int breaks_at = -1;
  double broken_value = std::numeric_limits<double>::quiet_NaN();

 private:
  double scale_;
};

std::unique_ptr<NonlinearBackend> local_global() { return make_nonlinear_backend("local_global"); }

// Step k moves by 8 / 2^k.
TEST(LocalGlobal, StopsAtTheFirstStepWithinTheTolerance) {
  for (const auto& [scale, tolerance, iterations] :
       {std::tuple(1.0, 1e-6, 23), {1.0, 0.25, 5}, {1.0, 0.24, 6}, {64.0, 0.25 / 64.0, 5}, {64.0, 0.25, 1}}) {
    Contraction objective(scale);
    const auto backend = local_global();
    const Matrix U = backend->minimize(objective, Contraction::start(), {.tolerance = tolerance});
    const NonlinearReport& report = backend->report();
    EXPECT_TRUE(report.converged);
    EXPECT_THAT(report.reason, StartsWith("step "));
    EXPECT_THAT(report.reason, HasSubstr("at most tolerance"));
    EXPECT_EQ(report.backend, "local_global");
    EXPECT_EQ(report.iterations, iterations);
    EXPECT_EQ(objective.steps, iterations);
    EXPECT_EQ((U - Contraction::goal()).cwiseAbs().maxCoeff(), std::ldexp(8.0, -iterations));
  }
}

TEST(LocalGlobal, FixedPointIsConvergedAfterOneStep) {
  Contraction objective;
  const auto backend = local_global();
  EXPECT_EQ(backend->minimize(objective, Contraction::goal(), {.tolerance = 0.0}), Contraction::goal());
  EXPECT_TRUE(backend->report().converged);
  EXPECT_EQ(backend->report().iterations, 1);
}

TEST(LocalGlobal, HistoryBeginsWithTheStart) {
  Contraction objective(4.0);
  const auto backend = local_global();
  backend->minimize(objective, Contraction::start(), {.tolerance = 1e-3});
  const NonlinearReport& report = backend->report();
  ASSERT_EQ(static_cast<int>(report.history.size()), report.iterations + 1);
  ASSERT_GT(report.iterations, 3);
  const double at_start = (Contraction::start() - Contraction::goal()).squaredNorm();
  for (int k = 0; k <= report.iterations; ++k) {
    const NonlinearStep& row = report.history[k];
    EXPECT_EQ(row.iteration, k);
    EXPECT_EQ(row.energy.total, std::ldexp(at_start, -2 * k));
    EXPECT_EQ(row.energy.plain, 2.0 * row.energy.total);
    EXPECT_EQ(row.energy.variation, 3.0 * row.energy.total);
    EXPECT_EQ(row.step, k == 0 ? 0.0 : std::ldexp(8.0, -k) / 4.0);
    EXPECT_GE(row.seconds, k == 0 ? 0.0 : report.history[k - 1].seconds);
  }
  EXPECT_GE(report.seconds, report.history.back().seconds);
}

TEST(LocalGlobal, IterationLimitIsNotConvergence) {
  for (const int limit : {0, 1, 7}) {
    Contraction objective;
    const auto backend = local_global();
    const Matrix U = backend->minimize(objective, Contraction::start(), {.tolerance = 1e-6, .max_iterations = limit});
    EXPECT_EQ((U - Contraction::goal()).cwiseAbs().maxCoeff(), std::ldexp(8.0, -limit));
    EXPECT_FALSE(backend->report().converged);
    EXPECT_THAT(backend->report().reason, StartsWith("iteration limit " + std::to_string(limit) + " "));
    EXPECT_EQ(backend->report().iterations, limit);
    EXPECT_EQ(objective.steps, limit);
    EXPECT_EQ(static_cast<int>(backend->report().history.size()), limit + 1);
  }
}

// The last allowed step may still converge.
TEST(LocalGlobal, ConvergenceInTheLastIterationCounts) {
  Contraction objective;
  const auto backend = local_global();
  backend->minimize(objective, Contraction::start(), {.tolerance = 0.25, .max_iterations = 5});
  EXPECT_TRUE(backend->report().converged) << backend->report().reason;
  EXPECT_EQ(backend->report().iterations, 5);
}

TEST(LocalGlobal, ObserverStopsIt) {
  Contraction objective;
  const auto backend = local_global();
  const Matrix U = backend->minimize(objective, Contraction::start(), {.tolerance = 1e-6},
                                     [](const NonlinearStep& row) { return row.iteration < 3; });
  EXPECT_FALSE(backend->report().converged);
  EXPECT_EQ(backend->report().reason, "stopped by the observer");
  EXPECT_EQ(backend->report().iterations, 3);
  EXPECT_EQ(backend->report().history.size(), 4U);
  EXPECT_EQ(objective.steps, 3);
  EXPECT_EQ((U - Contraction::goal()).cwiseAbs().maxCoeff(), 1.0);
}

// Whether the run ends at the limit or converges, the observer has seen all rows of the history but the start.
TEST(LocalGlobal, ObserverSeesEveryIteration) {
  for (const NonlinearOptions options :
       {NonlinearOptions{.tolerance = 1e-6, .max_iterations = 4}, {.tolerance = 0.1}}) {
    Contraction objective;
    const auto backend = local_global();
    std::vector<NonlinearStep> seen;
    backend->minimize(objective, Contraction::start(), options, [&](const NonlinearStep& row) {
      seen.push_back(row);
      return true;
    });
    const NonlinearReport& report = backend->report();
    ASSERT_EQ(static_cast<int>(seen.size()), report.iterations) << report.reason;
    for (int k = 0; k < report.iterations; ++k) {
      EXPECT_EQ(seen[k].iteration, k + 1);
      EXPECT_EQ(seen[k].step, report.history[k + 1].step);
      EXPECT_EQ(seen[k].energy.total, report.history[k + 1].energy.total);
    }
  }
}

TEST(LocalGlobal, StepThatIsNotFiniteIsAnError) {
  for (const double broken : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Contraction objective;
    objective.breaks_at = 3;
    objective.broken_value = broken;
    const auto backend = local_global();
    try {
      backend->minimize(objective, Contraction::start(), {});
      ADD_FAILURE() << "no error";
    } catch (const SolverError& error) {
      EXPECT_THAT(error.what(), HasSubstr("'local_global'"));
      EXPECT_THAT(error.what(), HasSubstr("iteration 3"));
    }
    EXPECT_FALSE(backend->report().converged);
    EXPECT_EQ(backend->report().iterations, 2);
    EXPECT_EQ(backend->report().history.size(), 3U);
  }
}

TEST(LocalGlobal, SecondRunStartsAfresh) {
  Contraction objective;
  const auto backend = local_global();
  backend->minimize(objective, Contraction::start(), {.tolerance = 0.25});
  backend->minimize(objective, Contraction::start(), {.tolerance = 1e-9, .max_iterations = 2});
  EXPECT_FALSE(backend->report().converged);
  EXPECT_EQ(backend->report().iterations, 2);
  EXPECT_EQ(backend->report().history.size(), 3U);
  EXPECT_THAT(backend->report().reason, HasSubstr("iteration limit"));
}

}  // namespace
}  // namespace variform
