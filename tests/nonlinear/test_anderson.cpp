// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>

#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/nonlinear/arap_problems.h"

namespace variform {
namespace {

using testing::ArapProblem;

std::unique_ptr<NonlinearBackend> local_global(std::int64_t window) {
  Parameters parameters(nonlinear_backends().find("local_global").parameters);
  parameters.set("anderson", window);
  return make_nonlinear_backend("local_global", parameters);
}

struct Outcome {
  Matrix U;
  NonlinearReport report;
};

Outcome alternate(const ArapProblem& of, double beta, NonlinearBackend& backend) {
  Problem problem(*of.domain, *of.energy, {.beta = beta}, of.constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  Outcome result;
  result.U = backend.minimize(objective, of.start, {.tolerance = 1e-10, .max_iterations = 20000});
  result.report = backend.report();
  return result;
}

TEST(Anderson, ReachesTheFixedPointOfThePlainAlternationInFewerIterations) {
  for (const ArapProblem& of : testing::arap_problems()) {
    for (const double beta : {0.0, 0.3}) {
      SCOPED_TRACE(of.name + ", beta " + std::to_string(beta));
      const Outcome plain = alternate(of, beta, *local_global(0));
      ASSERT_TRUE(plain.report.converged) << plain.report.reason;
      for (const int window : {1, 5}) {
        const Outcome fast = alternate(of, beta, *local_global(window));
        ASSERT_TRUE(fast.report.converged) << fast.report.reason;
        // The plain alternation stops early by its rate, which is close to 1 on the surface.
        EXPECT_LT((fast.U - plain.U).cwiseAbs().maxCoeff(), 2e-7 * of.domain->diameter());
        EXPECT_LT(fast.report.iterations, (window == 5 ? 0.5 : 0.8) * plain.report.iterations);
      }
    }
  }
}

// What the alternation promises without regularization is kept.
TEST(Anderson, EnergyNeverRisesWithoutRegularization) {
  for (const ArapProblem& of : testing::arap_problems()) {
    const Outcome fast = alternate(of, 0.0, *local_global(5));
    const auto& history = fast.report.history;
    for (std::size_t i = 1; i < history.size(); ++i) {
      const double before = history[i - 1].energy.objective();
      EXPECT_LE(history[i].energy.objective(), before * (1.0 + 1e-13)) << of.name << " " << i;
    }
  }
}

TEST(Anderson, WindowOfZeroIsThePlainAlternation) {
  const ArapProblem of = testing::arap_problems()[0];
  const Outcome plain = alternate(of, 0.3, *make_nonlinear_backend("local_global"));
  const Outcome zero = alternate(of, 0.3, *local_global(0));
  EXPECT_EQ(plain.U, zero.U);
  EXPECT_EQ(plain.report.iterations, zero.report.iterations);

  // Step by step by hand, to the last bit.
  Problem problem(*of.domain, *of.energy, {.beta = 0.3}, of.constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  Matrix U = of.start;
  for (int i = 0; i < plain.report.iterations; ++i) U = objective.local_global_step(U);
  EXPECT_EQ(plain.U, U);
}

// A map whose images oscillate about the fixed point 0: extrapolation from the last two is exact, but what it leads to
// beyond |u| > 1 is worse. Fallbacks must not end the run, and the fixed point is reached all the same.
class Oscillation final : public Objective {
 public:
  EnergyValue value(const Matrix& U) override { return {.total = U.squaredNorm()}; }
  Matrix local_global_step(const Matrix& U) override {
    return U.unaryExpr([](double u) { return -0.9 * u + 0.4 * std::sin(3.0 * u); });
  }
  double length_scale() const override { return 1.0; }
};

TEST(Anderson, FallsBackToPlainStepsWhereExtrapolationLeadsAway) {
  Oscillation objective;
  const Matrix start{{1.3, -0.7}, {0.9, 2.0}};
  for (const int window : {1, 3, 8}) {
    const auto backend = local_global(window);
    const Matrix U = backend->minimize(objective, start, {.tolerance = 1e-12, .max_iterations = 2000});
    EXPECT_TRUE(backend->report().converged) << backend->report().reason;
    EXPECT_LT((objective.local_global_step(U) - U).cwiseAbs().maxCoeff(), 1e-11);
  }
}

TEST(Anderson, SecondRunForgetsTheFirst) {
  const ArapProblem of = testing::arap_problems()[0];
  const auto backend = local_global(5);
  const Outcome first = alternate(of, 0.3, *backend);
  const Outcome second = alternate(of, 0.3, *backend);
  EXPECT_EQ(first.U, second.U);
  EXPECT_EQ(first.report.iterations, second.report.iterations);
}

}  // namespace
}  // namespace variform
