// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/base/error.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// x - log x, minimal at 1, infinite for x <= 0, with the exact Newton direction; from x > 2 that leads beyond
// the barrier.
class Logarithm final : public Objective {
 public:
  EnergyValue value(const Matrix& U) override {
    const double x = U(0, 0);
    least = std::min(least, x);
    return {.total = x > 0.0 ? x - std::log(x) : std::numeric_limits<double>::infinity()};
  }
  void check_start(const Matrix& U) override {
    if (!(U(0, 0) > 0.0)) throw DataError("beyond the barrier");
  }
  Eigen::VectorXd gradient(const Matrix& U) override { return Eigen::VectorXd::Constant(1, 1.0 - 1.0 / U(0, 0)); }
  Matrix local_global_step(const Matrix& U) override { return U; }
  Direction gauss_newton(const Matrix& U, double damping) override { return newton(U, damping); }
  Direction newton(const Matrix& U, double) override {
    const double x = U(0, 0);
    const double gradient = 1.0 - 1.0 / x;
    Direction direction;
    direction.step = Matrix{{-gradient * x * x}};
    direction.slope = gradient * direction.step(0, 0);
    return direction;
  }
  double longest_step(const Matrix& U, const Matrix& step) override {
    return step(0, 0) < 0.0 ? -U(0, 0) / step(0, 0) : std::numeric_limits<double>::infinity();
  }
  double length_scale() const override { return 1.0; }

  double least = std::numeric_limits<double>::infinity();  // x that a value was asked for
};

TEST(LineSearch, NeverLooksBeyondABarrier) {
  for (const std::string name : {"newton", "gauss_newton"}) {
    for (const double x : {50.0, 2.5, 0.01}) {
      Logarithm objective;
      const auto backend = make_nonlinear_backend(name);
      const Matrix U = backend->minimize(objective, Matrix{{x}}, {.tolerance = 1e-9, .gradient_tolerance = 0.0});
      EXPECT_TRUE(backend->report().converged) << backend->report().reason;
      EXPECT_NEAR(U(0, 0), 1.0, 1e-6);
      EXPECT_GT(objective.least, 0.0);
    }
  }
}

TEST(LineSearch, StepsThatABarrierCutShortAreNoConvergence) {
  Logarithm objective;
  const auto backend = make_nonlinear_backend("newton");
  backend->minimize(objective, Matrix{{50.0}}, {.tolerance = 100.0, .gradient_tolerance = 0.0});
  // The first step would go 50 * 49 to the left: the barrier leaves 45.
  EXPECT_GT(backend->report().iterations, 1);
}

TEST(LineSearch, StartsBeyondABarrierAreRefusedByTheObjective) {
  for (const std::string& name : nonlinear_backends().names()) {
    Logarithm objective;
    EXPECT_THROW(make_nonlinear_backend(name)->minimize(objective, Matrix{{-1.0}}, {}), DataError) << name;
  }
}

TEST(Newton, ObjectivesWithoutAHessianAreRefused) {
  class Plain final : public Objective {
   public:
    EnergyValue value(const Matrix&) override { return {.total = 1.0}; }
    Matrix local_global_step(const Matrix& U) override { return U; }
    double length_scale() const override { return 1.0; }
  };
  Plain objective;
  EXPECT_THROW(make_nonlinear_backend("newton")->minimize(objective, Matrix{{1.0}}, {}), UsageError);
  for (const char* name : {"newton", "gauss_newton"}) {
    Parameters parameters(nonlinear_backends().find(name).parameters);
    parameters.set("damping", 1.0);
    EXPECT_THROW(parameters.set("damping", 1.01), UsageError) << name;
  }
}

// With x = 1 + e the next error of a full step is -e^2 exactly: order two.
TEST(Newton, TakesFullStepsNearTheMinimum) {
  Logarithm objective;
  const auto backend = make_nonlinear_backend("newton");
  backend->minimize(objective, Matrix{{0.5}}, {.tolerance = 1e-12, .gradient_tolerance = 0.0});
  const auto& history = backend->report().history;
  ASSERT_GT(history.size(), 5U);
  double error = -0.5;
  // The last steps promise less than what rounding leaves of the energy.
  for (std::size_t i = 1; i < history.size() && std::abs(error) > 1e-5; ++i) {
    EXPECT_NEAR(history[i].step, std::abs(error + error * error), 1e-14) << i;
    error = -error * error;
  }
}

}  // namespace
}  // namespace variform
