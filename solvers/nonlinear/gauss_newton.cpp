// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Gauss-Newton with backtracking on the true regularized energy (methods: smoothed energies, sec. 4.3). One numeric
// factorization per iteration on a fixed pattern. The energy decreases in every iteration, whatever beta is. The
// damping keeps directions apart that the linearization does not see; it grows after a failed line search and shrinks
// again.
class GaussNewton final : public NonlinearBackend {
 public:
  GaussNewton(double damping, double decrease) : NonlinearBackend("gauss_newton"), least_(damping), rate_(decrease) {}

 protected:
  void start() override { damping_ = least_; }

  Matrix step(Objective& objective, const Matrix& U) override {
    const double energy = last().energy.objective();
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const Direction direction = objective.gauss_newton(U, damping_);
      if (!direction.step.allFinite()) return direction.step;  // minimize() says so
      // What a full step can gain at most is below what rounding leaves of the energy.
      if (-direction.slope <= rate_ * energy || direction.slope == 0.0) {
        stop(true, fmt::format("predicted decrease {:.3g} at most {:.3g} of the energy {:.6g}", -0.5 * direction.slope,
                               0.5 * rate_, energy));
        return U;
      }
      double length = 1.0;
      for (int halving = 0; halving < kHalvings; ++halving, length *= 0.5) {
        Matrix next = U + length * direction.step;
        const double trial = objective.value(next).objective();
        if (trial <= energy + 1e-4 * length * direction.slope) {
          if (attempt == 0 && length == 1.0) damping_ = std::max(least_, 0.1 * damping_);
          return next;
        }
      }
      damping_ = std::max(1e3 * damping_, 1e-8);
    }
    stop(false, fmt::format("line search failed at energy {:.6g}", energy));
    return U;
  }

 private:
  static constexpr int kHalvings = 30;
  static constexpr int kAttempts = 5;
  double least_;
  double rate_;
  double damping_ = 0.0;
};

}  // namespace

NonlinearBackendEntry describe_gauss_newton() {
  return {
      .name = "gauss_newton",
      .doc = "minimizes the regularized energy itself: linearized residual, line search, a factorization per iteration",
      .parameters =
          {{.name = "damping", .value = 1e-9, .doc = "added to the diagonal, in units of its mean", .min = 0.0},
           {.name = "decrease",
            .value = 1e-12,
            .doc = "converged when a step promises less than this share of the energy",
            .min = 0.0,
            .max = 1.0}},
      .make = [](const Parameters& p) {
        return std::make_unique<GaussNewton>(p.number("damping"), p.number("decrease"));
      }};
}

}  // namespace variform
