// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/line_search.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace variform {
namespace {

constexpr double kRounding = 1e-13;  // of a step, by the length scale
constexpr double kStall = 1e-15;     // of the energy: what is left of a step that the line search cut short
constexpr double kOfBarrier = 0.9;   // longest step tried, by the one that reaches a barrier
constexpr int kHalvings = 30;
constexpr int kAttempts = 5;

}  // namespace

std::vector<Parameter> LineSearchBackend::parameters() {
  return {
      {.name = "damping", .value = 1e-9, .doc = "added to the diagonal, in units of its mean", .min = 0.0, .max = 1.0},
      {.name = "decrease",
       .value = 1e-12,
       .doc = "converged when a step promises less than this share of the energy",
       .min = 0.0,
       .max = 1.0}};
}

LineSearchBackend::LineSearchBackend(std::string name, const Parameters& p)
    : NonlinearBackend(std::move(name)), least_(p.number("damping")), rate_(p.number("decrease")) {}

Matrix LineSearchBackend::step(Objective& objective, const Matrix& U) {
  const double energy = last().energy.objective();
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Direction model = direction(objective, U, damping_);
    if (!model.step.allFinite()) return model.step;  // minimize() says so
    // What a full step can gain at most is below what rounding leaves of the energy. Damping makes every step small,
    // so that only an undamped one tells.
    if (-model.slope <= rate_ * energy || model.slope == 0.0) {
      const double slope = damping_ > least_ ? direction(objective, U, least_).slope : model.slope;
      const bool converged = -slope <= rate_ * energy || slope == 0.0;
      stop(converged, fmt::format("predicted decrease {:.3g} {} {:.3g} of the energy {:.6g}{}", -0.5 * slope,
                                  converged ? "at most" : "above", 0.5 * rate_, energy,
                                  converged ? "" : ", but no step gets there"));
      return U;
    }
    const double whole = model.step.size() > 0 ? model.step.cwiseAbs().maxCoeff() : 0.0;
    if (damping_ <= least_ && whole <= kRounding * objective.length_scale()) {
      stop(true, fmt::format("step {:.3g} is rounding", whole / objective.length_scale()));
      return U;
    }
    double length = std::min(1.0, kOfBarrier * objective.longest_step(U, model.step));
    if (!(length > 0.0)) break;  // at the barrier, to rounding
    for (int halving = 0; halving < kHalvings; ++halving, length *= 0.5) {
      Matrix next = U + length * model.step;
      const double trial = objective.value(next).objective();
      if (trial <= energy + 1e-4 * length * model.slope) {
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

}  // namespace variform
