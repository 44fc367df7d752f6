// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/base/types.h"

namespace variform {

/// The classical Runge-Kutta step of order 4, with an estimate of its error for nothing: the velocity at its end, which
/// the next step begins with, in place of the last stage gives a formula of order 3.
class Rk4Step {
 public:
  void resize(Index size) {
    stage_.resize(size);
    for (Vector* slope : {&second_, &third_, &fourth_}) slope->resize(size);
  }

  /// From state y with velocity f at time t to the end t1, where the velocity f1 is evaluated, too.
  /// evaluate(t, y, dy) gives velocities.
  template <class Evaluate>
  void operator()(double t, const Vector& y, const Vector& f, double t1, Vector& y1, Vector& f1, Evaluate&& evaluate) {
    const double h = t1 - t;
    stage_ = y + (0.5 * h) * f;
    evaluate(t + 0.5 * h, stage_, second_);
    stage_ = y + (0.5 * h) * second_;
    evaluate(t + 0.5 * h, stage_, third_);
    stage_ = y + h * third_;
    evaluate(t1, stage_, fourth_);
    y1 = y + (h / 6.0) * (f + 2.0 * second_ + 2.0 * third_ + fourth_);
    evaluate(t1, y1, f1);
    stage_ = (h / 6.0) * (f1 - fourth_);
  }

  /// Difference of the formulas of order 4 and 3 in the last step: O(h^4).
  const Vector& error() const { return stage_; }

 private:
  Vector stage_, second_, third_, fourth_;
};

}  // namespace variform
