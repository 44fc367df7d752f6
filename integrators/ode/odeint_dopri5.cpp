// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/ode_backends.h"

#ifdef VARIFORM_WITH_ODEINT
#include <boost/numeric/odeint/algebra/vector_space_algebra.hpp>
#include <boost/numeric/odeint/external/eigen/eigen_resize.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>
#endif

namespace variform {

#ifdef VARIFORM_WITH_ODEINT
namespace {

namespace odeint = boost::numeric::odeint;

// Odeint's stepper with the step control of the other methods: its own measures errors by component.
class Dopri5 final : public OdeBackend {
 public:
  explicit Dopri5(const Parameters& parameters)
      : OdeBackend("odeint.dopri5"), control_(parameters.boolean("control")) {}
  int order() const override { return 5; }

 protected:
  bool controls_step() const override { return control_; }

  void prepare() override {
    error_.resize(size());
    stepper_.adjust_size(error_);
  }

  Attempt attempt(const Point& from, Point& to) override {
    const double h = to.time - from.time;
    const auto field = [this](const Vector& y, Vector& dy, double t) { evaluate(t, y, dy); };
    stepper_.do_step(field, from.state, from.velocity, from.time, to.state, to.velocity, h, error_);
    Attempt result{.error = size_of(error_.data())};
    if (control_) {
      result.accepted = result.error <= tolerance();
      result.next = next_size(h, result.error, 5);
    }
    return result;
  }

  // Of order 4, from the stages of the last step.
  void interpolate(double t, const Point& from, const Point& to, Vector& y) override {
    stepper_.calc_state(t, y, from.state, from.velocity, from.time, to.state, to.velocity, to.time);
  }

 private:
  bool control_;
  Vector error_;
  odeint::runge_kutta_dopri5<Vector, double, Vector, double, odeint::vector_space_algebra> stepper_;
};

}  // namespace
#endif

OdeBackendEntry describe_odeint_dopri5() {
  OdeBackendEntry entry;
  entry.name = "odeint.dopri5";
  entry.doc = "Dormand-Prince method, order 5, of Boost.Odeint; 6 evaluations per step";
  entry.package = "libboost-dev";
  entry.option = "VARIFORM_ODEINT";
  entry.parameters = {
      {.name = "control", .value = true, .doc = "steps follow the tolerance; else all have the first size"}};
#ifdef VARIFORM_WITH_ODEINT
  entry.make = [](const Parameters& p) { return std::make_unique<Dopri5>(p); };
#endif
  return entry;
}

}  // namespace variform
