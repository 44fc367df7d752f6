// SPDX-License-Identifier: BSD-3-Clause
#ifdef VARIFORM_WITH_SUNDIALS
#include "integrators/ode/sundials_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "framework/base/error.h"

namespace variform {

namespace {

// The norm of vectors is a plain function of two vectors.
thread_local int norm_components = 1;

class NormScope {
 public:
  explicit NormScope(int components) : before_(norm_components) { norm_components = components; }
  ~NormScope() { norm_components = before_; }
  NormScope(const NormScope&) = delete;
  NormScope& operator=(const NormScope&) = delete;

 private:
  int before_;
};

// Largest weighted length of a point.
double largest_point(N_Vector x, N_Vector weights) {
  const double* values = N_VGetArrayPointer(x);
  const double* weight = N_VGetArrayPointer(weights);
  const sunindextype size = N_VGetLength(x);
  double largest = 0.0;
  for (sunindextype i = 0; i < size;) {
    double squared = 0.0;
    for (int k = 0; k < norm_components; ++k, ++i) squared += (values[i] * weight[i]) * (values[i] * weight[i]);
    if (!(squared <= largest)) largest = squared;  // keeps NaN
  }
  return std::sqrt(largest);
}

Eigen::Map<Vector> map(N_Vector x) { return {N_VGetArrayPointer(x), static_cast<Eigen::Index>(N_VGetLength(x))}; }

}  // namespace

SundialsBackend::SundialsBackend(std::string name) : OdeBackend(std::move(name)) {
  SUNContext context = nullptr;
  if (SUNContext_Create(nullptr, &context) != 0) throw SolverError("SUNDIALS: no context");
  context_.reset(context);
}

void SundialsBackend::prepare() {
  work_.reset();
  state_.reset(N_VNew_Serial(size(), context()));
  if (state_ == nullptr) throw SolverError("SUNDIALS: out of memory");
  state_->ops->nvwrmsnorm = largest_point;  // clones inherit it
  work_.reset(N_VClone(state_.get()));
  y_.resize(size());
  dy_.resize(size());
}

void SundialsBackend::check(int flag, const char* call) const {
  if (flag < 0) {
    throw SolverError(fmt::format("ODE backend '{}': {} failed: {}", report().backend, call, name_of(flag)));
  }
}

int SundialsBackend::right_hand_side(double t, N_Vector y, N_Vector dy, void* self) {
  SundialsBackend& backend = *static_cast<SundialsBackend*>(self);
  if (backend.error_) return -1;
  try {
    backend.y_ = map(y);
    backend.evaluate(t, backend.y_, backend.dy_);
    map(dy) = backend.dy_;
    return 0;
  } catch (const StepRefused& refused) {
    ++backend.refusals_;
    backend.refused_time_ = t;
    backend.refusal_ = refused.what();
    return 1;
  } catch (...) {
    backend.error_ = std::current_exception();
    return -1;
  }
}

void SundialsBackend::start(Point& at) {
  const NormScope scope(point_size());
  error_ = {};
  failures_ = 0;
  map(state_.get()) = at.state;
  create(at.time, state_.get());
  first_ = true;
}

OdeBackend::Attempt SundialsBackend::attempt(const Point& from, Point& to) {
  const NormScope scope(point_size());
  refusals_ = 0;
  check(set_stop_time(to.time), "the stop time");
  if (first_) check(set_first_step(to.time - from.time), "the first step");
  first_ = false;
  double t = from.time;
  const int flag = one_step(to.time, state_.get(), &t);
  if (error_) std::rethrow_exception(error_);
  long failures = 0;
  check(error_test_failures(&failures), "a count");
  report_.rejected += static_cast<int>(failures - failures_);
  failures_ = failures;

  if (flag < 0 && refusals_ > 0) {
    report_.refused += refusals_ - 1;  // the last is counted by the loop
    to.time = std::clamp(refused_time_, from.time, to.time);
    throw StepRefused(refusal_);
  }
  report_.refused += refusals_;
  if (flag < 0 && meaning(flag) == End::broken) check(flag, "a step");
  Attempt result;
  if (local_errors(work_.get()) >= 0) result.error = size_of(N_VGetArrayPointer(work_.get()));
  if (flag < 0) {
    report_.rejected -= failures > 0 ? 1 : 0;
    result.accepted = false;
    result.next = 0.0;
    return result;
  }
  to.time = t;
  to.state = map(state_.get());
  return result;
}

void SundialsBackend::interpolate(double t, const Point&, const Point&, Vector& y) {
  const NormScope scope(point_size());
  check(derivative(t, work_.get()), "dense output");
  y = map(work_.get());
}

}  // namespace variform
#endif
