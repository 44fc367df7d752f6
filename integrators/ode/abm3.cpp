// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>

#include "framework/base/error.h"
#include "integrators/ode/ode_backends.h"
#include "integrators/ode/rk4_step.h"

namespace variform {

namespace {

// Adams-Bashforth-Moulton method of order 3 as PECE with uneven steps (methods: continuous deformation, 3.6; smoothed
// energies, 5.2). f is interpolated through its values at the last three times (predictor), or at the last two and the
// end of the step (corrector), in divided differences.
class Abm3 final : public OdeBackend {
 public:
  explicit Abm3(const Parameters& parameters) : OdeBackend("abm3"), control_(parameters.boolean("control")) {}
  int order() const override { return 3; }

 protected:
  bool controls_step() const override { return control_; }

  void prepare() override {
    start_.resize(size());
    for (Past& past : past_) past.velocity.resize(size());
    for (Vector* vector : {&predicted_, &first_, &second_}) vector->resize(size());
    known_ = 0;
  }

  void start(Point& at) override {
    known_ = 0;
    OdeBackend::start(at);
  }

  Attempt attempt(const Point& from, Point& to) override {
    const double h = to.time - from.time;
    const double error = known_ < 2 ? runge_kutta(from, to) : multistep(from, to);
    Attempt result{.error = error};
    if (control_) {
      result.accepted = error <= tolerance();
      result.next = next_size(h, error, 4);
      if (!result.accepted) return result;
    }
    if (known_ == 2) evaluate(to.time, to.state, to.velocity);
    return result;
  }

  void accepted(const Point& from) override {
    std::swap(past_[0], past_[1]);
    past_[0].time = from.time;
    past_[0].velocity = from.velocity;
    known_ = std::min(known_ + 1, 2);
  }

  void save(std::vector<Vector>& memory) const override {
    memory.emplace_back(Eigen::Vector3d(known_, past_[0].time, past_[1].time));
    for (int i = 0; i < known_; ++i) memory.push_back(past_[static_cast<std::size_t>(i)].velocity);
  }

  void load(const std::vector<Vector>& memory, std::size_t at) override {
    const auto broken = [] { return UsageError("ODE integration: the checkpoint is not one of 'abm3'"); };
    if (memory.size() <= at || memory[at].size() != 3) throw broken();
    const Vector& head = memory[at];
    known_ = static_cast<int>(head[0]);
    if (known_ < 0 || known_ > 2 || memory.size() != at + 1 + static_cast<std::size_t>(known_)) throw broken();
    for (std::size_t i = 0; i < static_cast<std::size_t>(known_); ++i) {
      if (memory[at + 1 + i].size() != size()) throw broken();
      past_[i] = {head[static_cast<Index>(i) + 1], memory[at + 1 + i]};
    }
  }

 private:
  struct Past {
    double time = 0.0;
    Vector velocity = {};
  };

  double runge_kutta(const Point& from, Point& to) {
    start_(from.time, from.state, from.velocity, to.time, to.state, to.velocity,
           [this](double t, const Vector& y, Vector& dy) { evaluate(t, y, dy); });
    return size_of(start_.error().data());
  }

  double multistep(const Point& from, Point& to) {
    const double h = to.time - from.time;
    const double h1 = from.time - past_[0].time;
    const double h2 = past_[0].time - past_[1].time;
    // f[n, n-1] and f[n, n-1, n-2]
    first_ = (from.velocity - past_[0].velocity) / h1;
    second_ = (first_ - (past_[0].velocity - past_[1].velocity) / h2) / (h1 + h2);
    predicted_ =
        from.state + h * from.velocity + (h * h / 2.0) * first_ + (h * h * h / 3.0 + h1 * h * h / 2.0) * second_;
    evaluate(to.time, predicted_, to.velocity);
    // f[n+1, n, n-1], with f[n+1, n] in the place of f[n, n-1]
    second_ = first_;
    first_ = (to.velocity - from.velocity) / h;
    second_ = (first_ - second_) / (h + h1);
    to.state = from.state + h * from.velocity + (h * h / 2.0) * first_ - (h * h * h / 6.0) * second_;
    // Milne: both formulas have a known multiple of f''' as error.
    const double corrector = h * h * h * (h + 2.0 * h1) / 12.0;
    const double predictor = h * h * h * h / 4.0 + (2.0 * h1 + h2) * h * h * h / 3.0 + h1 * (h1 + h2) * h * h / 2.0;
    predicted_ = (corrector / (predictor + corrector)) * (to.state - predicted_);
    return size_of(predicted_.data());
  }

  bool control_;
  Rk4Step start_;
  std::array<Past, 2> past_;  // the latest first
  int known_ = 0;
  Vector predicted_, first_, second_;
};

}  // namespace

OdeBackendEntry describe_abm3() {
  OdeBackendEntry entry;
  entry.name = "abm3";
  entry.doc =
      "Adams-Bashforth-Moulton method, order 3, PECE, started by Runge-Kutta steps; 2 evaluations per step "
      "(Martinez Esturo 2013, sec. 3.5)";
  entry.parameters = {
      {.name = "control", .value = true, .doc = "steps follow the tolerance; else all have the first size"}};
  entry.make = [](const Parameters& p) { return std::make_unique<Abm3>(p); };
  return entry;
}

}  // namespace variform
