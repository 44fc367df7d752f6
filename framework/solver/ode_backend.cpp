// SPDX-License-Identifier: BSD-3-Clause
#include "framework/solver/ode_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "framework/base/error.h"

namespace variform {

namespace {

// Step control (methods: continuous deformation, 3.6).
constexpr double kSafety = 0.9;
constexpr double kShrink = 0.3;
constexpr double kGrowth = 2.0;

void require(bool condition, const std::string& message) {
  if (!condition) throw UsageError("ODE integration: " + message);
}

bool ascending_within(const std::vector<double>& times, double t0, double t1) {
  return std::is_sorted(times.begin(), times.end()) &&
         std::all_of(times.begin(), times.end(), [&](double t) { return t >= t0 && t <= t1; });
}

}  // namespace

Vector OdeBackend::integrate(OdeField& field, const Vector& y0, double t0, double t1, const OdeOptions& options,
                             const OdeObserver& observer) {
  OdeCheckpoint start;
  start.time = t0;
  start.state = y0;
  start.step = options.first_step * (t1 - t0);
  start.report.backend = report_.backend;
  return run(field, start, t0, t1, options, observer);
}

Vector OdeBackend::resume(OdeField& field, const OdeCheckpoint& from, double t0, double t1, const OdeOptions& options,
                          const OdeObserver& observer) {
  require(from.report.backend == report_.backend,
          fmt::format("a checkpoint of '{}' cannot go on with '{}'", from.report.backend, report_.backend));
  return run(field, from, t0, t1, options, observer);
}

void OdeBackend::check(const OdeCheckpoint& from, double t0, double t1) const {
  require(std::isfinite(t0) && std::isfinite(t1) && t0 < t1, fmt::format("times {} to {} are no interval", t0, t1));
  const OdeOptions& o = options_;
  require(std::isfinite(o.tolerance) && o.tolerance > 0.0, fmt::format("tolerance {} must be positive", o.tolerance));
  require(o.first_step > 0.0 && o.first_step <= 1.0,
          fmt::format("first step {} must be above 0 and at most 1", o.first_step));
  require(o.smallest_step > 0.0 && o.smallest_step <= o.first_step,
          fmt::format("smallest step {} must be above 0 and at most the first step {}", o.smallest_step, o.first_step));
  require(o.smallest_step * interval_ >
              64.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(t0), std::abs(t1)),
          fmt::format("smallest step {} is lost in the rounding of times", o.smallest_step));
  require(o.max_steps > 0, fmt::format("at most {} steps make no integration", o.max_steps));
  require(ascending_within(o.outputs, t0, t1), fmt::format("times of outputs must ascend within {} and {}", t0, t1));
  require(observer_.checkpoint_steps > 0,
          fmt::format("checkpoints every {} steps make no sense", observer_.checkpoint_steps));
  require(field_->point_size() > 0 && field_->size() % field_->point_size() == 0,
          fmt::format("{} numbers are no points of {} components", field_->size(), field_->point_size()));
  require(std::isfinite(length_) && length_ > 0.0, fmt::format("length scale {} must be positive", length_));
  require(from.state.size() == field_->size(),
          fmt::format("the state has {} numbers, the field {}", from.state.size(), field_->size()));
  require(from.time >= t0 && from.time <= t1,
          fmt::format("a checkpoint at time {} is outside {} to {}", from.time, t0, t1));
  require(std::isfinite(from.step) && from.step > 0.0 && from.outputs <= o.outputs.size(),
          "the checkpoint is not one of this integration");
  if (!from.state.allFinite()) {
    throw SolverError(fmt::format("ODE backend '{}': the state at time {} is not finite", report_.backend, from.time));
  }
}

Vector OdeBackend::run(OdeField& field, const OdeCheckpoint& from, double t0, double t1, const OdeOptions& options,
                       const OdeObserver& observer) {
  constexpr std::size_t kRows = 1024;  // of the history, before it allocates
  watch_ = {};
  field_ = &field;
  options_ = options;
  observer_ = observer;
  length_ = field.length_scale();
  interval_ = t1 - t0;
  check(from, t0, t1);
  // Some units in the last place, so that times computed from these do not round back to the ends.
  inside_ = 16.0 * std::numeric_limits<double>::epsilon() * std::max(std::abs(t0), std::abs(t1));
  pieces_ = field.breaks(t0, t1);
  require(ascending_within(pieces_, t0, t1), fmt::format("breaks of the field must ascend within {} and {}", t0, t1));
  std::erase_if(pieces_, [&](double t) { return t <= t0 || t >= t1; });
  pieces_.erase(std::unique(pieces_.begin(), pieces_.end()), pieces_.end());
  pieces_.push_back(t1);
  piece_ = static_cast<std::size_t>(std::upper_bound(pieces_.begin(), std::prev(pieces_.end()), from.time) -
                                    pieces_.begin());
  begin_ = piece_ == 0 ? t0 : pieces_[piece_ - 1];

  report_ = from.report;
  seconds_ = report_.seconds;
  report_.completed = false;
  report_.reason.clear();
  report_.event.clear();
  report_.history.reserve(report_.history.size() + kRows);
  report_.time = from.time;
  step_ = from.step;
  outputs_ = from.outputs;
  ended_ = false;
  for (Point* point : {&previous_, &current_, &trial_}) {
    point->state.setZero(field.size());
    point->velocity.setZero(field.size());
  }
  output_.resize(field.size());
  current_.time = from.time;
  current_.state = from.state;
  prepare();
  anew_ = from.memory.empty();
  if (!anew_) {
    require(from.memory.front().size() == field.size(), "the checkpoint is not one of this integration");
    current_.velocity = from.memory.front();
    load(from.memory, 1);
  }
  show(current_);
  if (report_.steps == 0) {
    if (std::string refusal = field.refusal(t0, shown_); !refusal.empty()) {
      ++report_.refused;
      happen(std::move(refusal));
    } else if (!give_outputs()) {
      end(false, "stopped by the observer");
    }
  }
  while (!ended_) {
    if (current_.time >= t1) {
      end(true, "end of the interval");
    } else if (report_.steps >= options_.max_steps) {
      end(false, fmt::format("step limit {} at time {:.6g} of {:.6g}", options_.max_steps, current_.time, t1));
    } else if (!step() && !ended_) {
      end(false, "stopped by the observer");
    }
  }
  show(current_);  // a refused trial was shown last
  report_.seconds = seconds_ + watch_.seconds();
  observer_ = {};
  return shown_;
}

// Whether the method could begin at the current state.
bool OdeBackend::begin() {
  try {
    start(current_);
  } catch (const StepRefused& refusal) {
    ++report_.refused;
    happen(refusal.what());
    return false;
  }
  anew_ = false;
  return true;
}

bool OdeBackend::step() {
  if (anew_ && !begin()) return false;
  for (bool after_refusal = false;;) {
    // The rest of the piece in equal steps: none is much shorter than the others.
    const double rest = limit() - current_.time;
    const double count = std::max(1.0, std::ceil(rest / step_ * (1.0 - 1e-9)));
    trial_.time = count == 1.0 ? limit() : current_.time + rest / count;
    Attempt trial;
    std::string refusal;
    double drift = 0.0;
    try {
      trial = attempt(current_, trial_);
      if (!trial_.state.allFinite()) {
        throw SolverError(
            fmt::format("ODE backend '{}': the state at time {:.6g} is not finite", report_.backend, trial_.time));
      }
      if (trial.accepted) {
        drift = show(trial_);
        refusal = field_->refusal(trial_.time, shown_);
        if (refusal.empty()) return take(trial, drift, after_refusal);
      }
    } catch (const StepRefused& refused) {
      trial.accepted = true;
      refusal = refused.what();
    }
    if (trial.accepted) {
      ++report_.refused;
      step_ = 0.5 * (trial_.time - current_.time);
      if (step_ < smallest_step()) {
        happen(std::move(refusal));
        return false;
      }
      after_refusal = true;
      if (!keeps_history()) {
        ++report_.restarts;
        if (!begin()) return false;
      }
    } else {
      ++report_.rejected;
      step_ = trial.next;
      if (!(step_ >= smallest_step())) {
        end(false,
            fmt::format("the tolerance {:.3g} needs steps below the smallest {:.3g} at time {:.6g} (error {:.3g})",
                        options_.tolerance, smallest_step(), current_.time, trial.error));
        return false;
      }
    }
  }
}

bool OdeBackend::take(const Attempt& attempt, double drift, bool after_refusal) {
  const double first = options_.first_step * interval_;
  const double size = trial_.time - current_.time;
  accepted(current_);
  std::swap(previous_, current_);
  std::swap(current_, trial_);
  double next = controls_step() ? std::min(attempt.next, interval_) : std::min(first, 2.0 * step_);
  if (after_refusal) {
    next = std::min(next, size);
  } else if (next >= kGrowth * size) {  // as far as the error tells; the step was cut to end with the piece
    next = std::max(next, step_);
  }
  step_ = next;
  ++report_.steps;
  report_.time = current_.time;
  report_.drift = std::max(report_.drift, drift);
  report_.history.push_back({report_.steps, current_.time, size, attempt.error, drift, report_.evaluations});
  bool go_on = give_outputs();
  if (observer_.step && !observer_.step(report_.history.back(), shown_)) go_on = false;
  if (current_.time >= limit() && piece_ + 1 < pieces_.size()) {
    begin_ = pieces_[piece_++];
    step_ = std::min(step_, first);
    anew_ = true;
    ++report_.restarts;
  }
  if (observer_.checkpoint && report_.steps % observer_.checkpoint_steps == 0) give_checkpoint();
  return go_on;
}

bool OdeBackend::give_outputs() {
  while (outputs_ < options_.outputs.size() && options_.outputs[outputs_] <= current_.time) {
    const double t = options_.outputs[outputs_++];
    if (!observer_.output) continue;
    if (t == current_.time) {
      output_ = shown_;
    } else {
      interpolate(t, previous_, current_, output_);
      field_->project(t, output_);
    }
    if (!observer_.output(t, output_)) return false;
  }
  return true;
}

void OdeBackend::give_checkpoint() {
  if (!anew_ && !keeps_history() && current_.time < pieces_.back()) {
    anew_ = true;
    step_ = report_.history.back().size;
    ++report_.restarts;
  }
  OdeCheckpoint checkpoint;
  checkpoint.time = current_.time;
  checkpoint.state = current_.state;
  checkpoint.step = step_;
  checkpoint.outputs = outputs_;
  checkpoint.report = report_;
  checkpoint.report.seconds = seconds_ + watch_.seconds();
  if (!anew_) {
    checkpoint.memory.push_back(current_.velocity);
    save(checkpoint.memory);
  }
  observer_.checkpoint(checkpoint);
}

double OdeBackend::show(const Point& point) {
  shown_ = point.state;
  return field_->project(point.time, shown_) / length_;
}

void OdeBackend::end(bool completed, std::string reason) {
  ended_ = true;
  report_.completed = completed;
  report_.reason = std::move(reason);
}

void OdeBackend::happen(std::string event) {
  end(false, fmt::format("{} (steps down to {:.3g} refused at time {:.6g})", event, smallest_step(), current_.time));
  report_.event = std::move(event);
}

void OdeBackend::evaluate(double t, const Vector& y, Vector& dy) {
  ++report_.evaluations;
  field_->velocity(std::max(begin_ + inside_, std::min(limit() - inside_, t)), y, dy);
  if (dy.size() != y.size() || !dy.allFinite()) {
    throw SolverError(fmt::format("ODE backend '{}': the velocity at time {:.6g} is not finite", report_.backend, t));
  }
}

double OdeBackend::size_of(const double* values) const {
  const int components = point_size();
  const Eigen::Map<const Eigen::MatrixXd> points(values, components, size() / components);
  return points.cols() == 0 ? 0.0 : std::sqrt(points.colwise().squaredNorm().maxCoeff()) / length_;
}

double OdeBackend::next_size(double size, double error, int q) const {
  if (error == 0.0) return kGrowth * size;
  return size * std::clamp(kSafety * std::pow(options_.tolerance / error, 1.0 / q), kShrink, kGrowth);
}

void OdeBackend::interpolate(double t, const Point& from, const Point& to, Vector& y) {
  const double h = to.time - from.time;
  const double s = (t - from.time) / h;
  const double r = 1.0 - s;
  y = (r * r * (1.0 + 2.0 * s)) * from.state + (s * s * (1.0 + 2.0 * r)) * to.state + (h * s * r * r) * from.velocity -
      (h * s * s * r) * to.velocity;
}

}  // namespace variform
