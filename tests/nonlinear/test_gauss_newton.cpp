// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>

#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

// 1 + |x| + y^2 with a model that sees x alone, and steps of the same size wherever it is: the line search ends in the
// kink at x = 0, where y is not minimal. Damping makes the steps as small as it is large.
class Kink final : public Objective {
 public:
  EnergyValue value(const Matrix& U) override { return {.total = 1.0 + std::abs(U(0, 0)) + U(0, 1) * U(0, 1)}; }
  Matrix local_global_step(const Matrix& U) override { return U; }
  Eigen::VectorXd gradient(const Matrix& U) override {
    return Eigen::Vector2d(U(0, 0) > 0.0 ? 1.0 : -1.0, 2.0 * U(0, 1));
  }
  Direction gauss_newton(const Matrix& U, double damping) override {
    const double size = 2.0 / (1.0 + damping);
    Direction direction;
    direction.step = Matrix{{U(0, 0) > 0.0 ? -size : size, 0.0}};
    direction.slope = -size;
    return direction;
  }
  double length_scale() const override { return 1.0; }
};

TEST(GaussNewtonBackend, ShortStepsOfALineSearchAreNoConvergence) {
  Kink objective;
  for (const double tolerance : {1e-3, 1e-6, 0.0}) {
    const auto backend = make_nonlinear_backend("gauss_newton");
    const Matrix U = backend->minimize(objective, Matrix{{0.3, 1.0}}, {.tolerance = tolerance, .max_iterations = 1000});
    EXPECT_FALSE(backend->report().converged) << backend->report().reason;
    EXPECT_THAT(backend->report().reason, HasSubstr("line search"));
    EXPECT_LT(std::abs(U(0, 0)), 1e-6);
  }
}

}  // namespace
}  // namespace variform
