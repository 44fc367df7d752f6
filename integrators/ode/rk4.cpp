// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/ode_backends.h"
#include "integrators/ode/rk4_step.h"

namespace variform {

namespace {

class Rk4 final : public OdeBackend {
 public:
  Rk4() : OdeBackend("rk4") {}
  int order() const override { return 4; }

 protected:
  bool controls_step() const override { return false; }

  void prepare() override { step_.resize(size()); }

  Attempt attempt(const Point& from, Point& to) override {
    step_(from.time, from.state, from.velocity, to.time, to.state, to.velocity,
          [this](double t, const Vector& y, Vector& dy) { evaluate(t, y, dy); });
    return {.error = size_of(step_.error().data())};
  }

 private:
  Rk4Step step_;
};

}  // namespace

OdeBackendEntry describe_rk4() {
  OdeBackendEntry entry;
  entry.name = "rk4";
  entry.doc = "classical Runge-Kutta method, order 4, fixed steps; 4 evaluations per step";
  entry.make = [](const Parameters&) { return std::make_unique<Rk4>(); };
  return entry;
}

}  // namespace variform
