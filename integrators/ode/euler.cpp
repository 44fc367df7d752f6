// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/ode_backends.h"

namespace variform {

namespace {

class Euler final : public OdeBackend {
 public:
  Euler() : OdeBackend("euler") {}
  int order() const override { return 1; }

 protected:
  bool controls_step() const override { return false; }

  Attempt attempt(const Point& from, Point& to) override {
    to.state = from.state + (to.time - from.time) * from.velocity;
    evaluate(to.time, to.state, to.velocity);
    return {};
  }
};

}  // namespace

OdeBackendEntry describe_euler() {
  OdeBackendEntry entry;
  entry.name = "euler";
  entry.doc = "explicit Euler method, order 1, fixed steps; 1 evaluation per step";
  entry.make = [](const Parameters&) { return std::make_unique<Euler>(); };
  return entry;
}

}  // namespace variform
