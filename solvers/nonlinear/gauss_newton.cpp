// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

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
  bool minimizes_objective() const override { return true; }

  Matrix step(Objective& objective, const Matrix& U) override {
    const double energy = last().energy.objective();
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const Direction direction = objective.gauss_newton(U, damping_);
      if (!direction.step.allFinite()) return direction.step;  // minimize() says so
      // What a full step can gain at most is below what rounding leaves of the energy. Damping makes every step small,
      // so that only an undamped one tells.
      if (-direction.slope <= rate_ * energy || direction.slope == 0.0) {
        const double slope = damping_ > least_ ? objective.gauss_newton(U, least_).slope : direction.slope;
        const bool converged = -slope <= rate_ * energy || slope == 0.0;
        stop(converged, fmt::format("predicted decrease {:.3g} {} {:.3g} of the energy {:.6g}{}", -0.5 * slope,
                                    converged ? "at most" : "above", 0.5 * rate_, energy,
                                    converged ? "" : ", but no step gets there"));
        return U;
      }
      const double whole = direction.step.size() > 0 ? direction.step.cwiseAbs().maxCoeff() : 0.0;
      if (damping_ <= least_ && whole <= kRounding * objective.length_scale()) {
        stop(true, fmt::format("step {:.3g} is rounding", whole / objective.length_scale()));
        return U;
      }
      double length = 1.0;
      for (int halving = 0; halving < kHalvings; ++halving, length *= 0.5) {
        Matrix next = U + length * direction.step;
        const double trial = objective.value(next).objective();
        if (trial <= energy + 1e-4 * length * direction.slope) {
          if (length < 1.0 || damping_ > least_) {
            part_of(damping_ > least_ ? std::numeric_limits<double>::infinity() : whole);
          }
          if (length < 1.0 && energy - trial <= kStall * energy) {
            stop(false, fmt::format("line search stalls at energy {:.6g}", energy));
          }
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
  static constexpr double kRounding = 1e-13;  // of a step, by the length scale
  static constexpr double kStall = 1e-15;     // of the energy: what is left of a step that the line search cut short
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
