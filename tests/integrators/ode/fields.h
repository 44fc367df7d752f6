// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "framework/solver/ode_backend.h"

namespace variform::testing {

/// A field made of functions; counts what it is asked.
class TestField : public OdeField {
 public:
  using Velocity = std::function<void(double t, const Vector& y, Vector& dy)>;

  TestField(Index size, int point_size, Velocity velocity)
      : size_(size), point_size_(point_size), velocity_(std::move(velocity)) {}

  Index size() const override { return size_; }
  int point_size() const override { return point_size_; }
  double length_scale() const override { return length; }
  void velocity(double t, const Vector& y, Vector& dy) override {
    ++evaluations;
    velocity_(t, y, dy);
  }
  std::string refusal(double t, const Vector& y) override { return refuses ? refuses(t, y) : std::string(); }
  double project(double t, Vector& y) override { return projects ? projects(t, y) : 0.0; }
  std::vector<double> breaks(double, double) const override { return break_times; }

  std::int64_t evaluations = 0;
  double length = 1.0;
  std::vector<double> break_times = {};
  std::function<std::string(double, const Vector&)> refuses = {};
  std::function<double(double, Vector&)> projects = {};

 private:
  Index size_;
  int point_size_;
  Velocity velocity_;
};

/// Points of the plane on spirals to the unit circle, at a speed w(t): in polar coordinates r' = w (r - r^3) and
/// angle' = 2 w, so that r^2 = 1 / (1 + (1 / r0^2 - 1) exp(-2 W)) and the angle grows by 2 W, W being the integral of
/// w.
class Spirals {
 public:
  /// w = 1 + cos(3 t) / 2.
  Spirals() = default;
  /// Any w, with its integral from 0.
  Spirals(std::function<double(double)> w, std::function<double(double)> integral)
      : w_(std::move(w)), integral_(std::move(integral)) {}

  static Vector start() {
    Vector y(6);
    y << 0.5, 0.0, 0.0, 1.5, -0.3, -0.2;
    return y;
  }

  TestField field() const {
    return {6, 2, [w = w_](double t, const Vector& y, Vector& dy) {
              const double speed = w(t);
              for (Index i = 0; i < y.size(); i += 2) {
                const double grow = 1.0 - y[i] * y[i] - y[i + 1] * y[i + 1];
                dy[i] = speed * (grow * y[i] - 2.0 * y[i + 1]);
                dy[i + 1] = speed * (grow * y[i + 1] + 2.0 * y[i]);
              }
            }};
  }

  /// From start() at time 0.
  Vector exact(double t) const {
    const double W = integral_(t);
    Vector y = start();
    for (Index i = 0; i < y.size(); i += 2) {
      const double r0 = std::hypot(y[i], y[i + 1]);
      const double r = 1.0 / std::sqrt(1.0 + (1.0 / (r0 * r0) - 1.0) * std::exp(-2.0 * W));
      const double angle = std::atan2(y[i + 1], y[i]) + 2.0 * W;
      y[i] = r * std::cos(angle);
      y[i + 1] = r * std::sin(angle);
    }
    return y;
  }

 private:
  std::function<double(double)> w_ = [](double t) { return 1.0 + 0.5 * std::cos(3.0 * t); };
  std::function<double(double)> integral_ = [](double t) { return t + std::sin(3.0 * t) / 6.0; };
};

}  // namespace variform::testing
