// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "framework/base/stopwatch.h"
#include "framework/base/types.h"

namespace variform {

/// Thrown by OdeField::velocity at a state that has no velocity (a cell is inverted there): the step is too long.
class StepRefused : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What an ODE backend integrates: y' = f(t, y) for y of size() numbers, points of point_size() consecutive components
/// (the vertices of a shape).
///
/// Some components may have a trajectory in closed form (handles on a path). project() puts them there, and velocity()
/// must not look at them in y, but take the trajectory at t: backends then integrate these components for nothing but
/// the drift, the distance between what they integrated and the trajectory, and every state that leaves a backend is
/// projected.
class OdeField {
 public:
  virtual ~OdeField() = default;

  virtual Index size() const = 0;
  virtual int point_size() const { return 1; }
  /// Length that errors are measured in.
  virtual double length_scale() const { return 1.0; }

  /// f(t, y) into dy, which has the size of y. Throws StepRefused, or Error for what no shorter step can mend.
  virtual void velocity(double t, const Vector& y, Vector& dy) = 0;

  /// Why a state y (projected) at the end of a step cannot be: "cell 17 inverts". Empty if it can.
  virtual std::string refusal(double /*t*/, const Vector& /*y*/) { return {}; }

  /// Moves the components with a known trajectory there; returns the largest distance that a point moved.
  virtual double project(double /*t*/, Vector& /*y*/) { return 0.0; }

  /// Times inside (t0, t1), ascending, where f is not smooth in t: methods start anew there. Velocities are asked for
  /// at times strictly inside the pieces only (at their ends within rounding), so that it does not matter which of its
  /// two values f takes at a break.
  virtual std::vector<double> breaks(double /*t0*/, double /*t1*/) const { return {}; }
};

struct OdeOptions {
  double tolerance = 1e-4;      ///< largest error of a step at any point, by length_scale (methods with step control)
  double first_step = 0.02;     ///< longest first step, also after breaks, by t1 - t0; the step without control
  double smallest_step = 1e-6;  ///< by t1 - t0: shorter ones end the integration
  int max_steps = 100000;
  std::vector<double> outputs = {};  ///< ascending times in [t0, t1] at which states are asked for
};

/// One accepted step.
struct OdeStep {
  int number = 0;                                           ///< from 1
  double time = 0;                                          ///< at its end
  double size = 0;                                          ///< time that it took
  double error = std::numeric_limits<double>::quiet_NaN();  ///< estimate by length_scale, where the method has one
  double drift = 0;                                         ///< see OdeField, at its end, by length_scale
  std::int64_t evaluations = 0;                             ///< of the field, so far
};

struct OdeReport {
  std::string backend;
  bool completed = false;  ///< the end of the interval was reached
  std::string reason;      ///< "end of the interval", or why not, with numbers
  double time = 0.0;       ///< reached
  std::string event;       ///< what OdeField refused at that time: "cell 17 inverts"; empty: nothing
  int steps = 0;           ///< accepted
  int rejected = 0;        ///< for their error
  int refused = 0;         ///< by the field: refused velocities and ends of steps
  int restarts = 0;        ///< at breaks, after refusals, at checkpoints of methods that cannot save their history
  std::int64_t evaluations = 0;
  double drift = 0.0;  ///< largest so far, by length_scale
  double seconds = 0.0;
  std::vector<OdeStep> history;
};

/// An integration at the end of a step: all that is needed to go on.
struct OdeCheckpoint {
  double time = 0.0;
  Vector state = {};           ///< as integrated, not projected
  double step = 0.0;           ///< next size
  std::vector<Vector> memory;  ///< of the method: earlier times and velocities, in its own layout
  std::size_t outputs = 0;     ///< how many of OdeOptions::outputs are done
  OdeReport report = {};
};

/// What an integration tells while it runs; all optional. Returning false stops it ("stopped by the observer").
struct OdeObserver {
  std::function<bool(const OdeStep&, const Vector& y)> step = {};  ///< y projected
  std::function<bool(double t, const Vector& y)> output = {};      ///< at OdeOptions::outputs; y projected
  std::function<void(const OdeCheckpoint&)> checkpoint = {};       ///< every checkpoint_steps accepted steps
  int checkpoint_steps = 10;                                       ///< means nothing without `checkpoint`
};

/// Integrates an OdeField from t0 to t1 > t0. The loop is the same for all methods: pieces between breaks, each divided
/// so that steps end exactly at its end; the end of every step checked and projected; states at requested times;
/// refusals answered by steps of half the length. A refusal that persists below the smallest step is an event, which
/// ends the integration with the last good state; so do steps that would have to be shorter still for the tolerance,
/// and too many steps, without an event. Methods implement one step.
///
/// A run that goes on from a checkpoint gives the same numbers as one that was never interrupted: methods save their
/// history, or start anew at every checkpoint, interrupted or not. For the latter (SUNDIALS) the numbers depend on
/// OdeObserver::checkpoint_steps where there is an OdeObserver::checkpoint.
///
/// Names: euler, rk4, abm3, odeint.dopri5, cvode.adams, cvode.bdf, arkode.erk; see integrators/ode/ode_backends.h.
class OdeBackend {
 public:
  virtual ~OdeBackend() = default;

  /// Returns the last state, projected: at t1 if report().completed, else where it ended. Throws UsageError for times
  /// and options that make no sense, SolverError when values are not finite; what the field throws passes through.
  Vector integrate(OdeField& field, const Vector& y0, double t0, double t1, const OdeOptions& options,
                   const OdeObserver& observer = {});
  /// Goes on from a checkpoint of an integration with the same field, interval and options.
  Vector resume(OdeField& field, const OdeCheckpoint& from, double t0, double t1, const OdeOptions& options,
                const OdeObserver& observer = {});

  const OdeReport& report() const { return report_; }

  /// Order of the global error by the step; the largest one of methods that change it.
  virtual int order() const = 0;

 protected:
  explicit OdeBackend(std::string name) { report_.backend = std::move(name); }

  struct Point {
    double time = 0.0;
    Vector state = {};     ///< as integrated
    Vector velocity = {};  ///< there; methods that have no use for it leave it alone
  };
  /// What a method says of a step that it tried.
  struct Attempt {
    bool accepted = true;                                     ///< false: the error is too large
    double error = std::numeric_limits<double>::quiet_NaN();  ///< by length_scale
    double next = std::numeric_limits<double>::infinity();    ///< size to go on with, or to try instead
  };

  /// Allocates what the method needs. Once per integration, before all others.
  virtual void prepare() {}
  /// Begins anew at a state, without history, and sets its velocity. When that is refused, no shorter step can help: it
  /// is an event.
  virtual void start(Point& at) { evaluate(at.time, at.state, at.velocity); }
  /// Tries one step to to.time, and sets state and velocity there, so that a step whose end has no velocity is refused.
  /// The time may be set to an earlier one. Allocates nothing. When StepRefused leaves it, to.time is the time of the
  /// step that was refused.
  virtual Attempt attempt(const Point& from, Point& to) = 0;
  /// The step was taken: the place to keep history. Points are as attempt() got them.
  virtual void accepted(const Point& /*from*/) {}
  /// State at a time within the last step; by default the cubic that fits states and velocities at its ends.
  virtual void interpolate(double t, const Point& from, const Point& to, Vector& y);
  /// Whether steps follow the error; else they all have the first size, or less.
  virtual bool controls_step() const { return true; }

  /// Whether save() and load() carry all that the next step depends on, beside state and velocity. Methods that cannot
  /// start anew at checkpoints and after refused steps.
  virtual bool keeps_history() const { return true; }
  virtual void save(std::vector<Vector>& /*memory*/) const {}
  /// What save() appended begins at `at`. Throws UsageError for what it cannot be.
  virtual void load(const std::vector<Vector>& /*memory*/, std::size_t /*at*/) {}

  /// f(t, y), counted, its values checked.
  void evaluate(double t, const Vector& y, Vector& dy);
  /// Largest length of a point of a vector, by length_scale: the norm of all errors.
  double size_of(const double* values) const;
  /// Step to go on with after one of this size and error, by the order q of the error estimate (its power of the step):
  /// size clamp(0.9 (tolerance / error)^(1/q), 0.3, 2).
  double next_size(double size, double error, int q) const;
  Index size() const { return field_->size(); }
  int point_size() const { return field_->point_size(); }
  /// Error that a step may have at any point, by length_scale.
  double tolerance() const { return options_.tolerance; }
  double length_scale() const { return length_; }
  /// As a time.
  double smallest_step() const { return options_.smallest_step * interval_; }
  /// End of the current piece: no step goes beyond.
  double limit() const { return pieces_[piece_]; }

  OdeReport report_;

 private:
  Vector run(OdeField& field, const OdeCheckpoint& from, double t0, double t1, const OdeOptions& options,
             const OdeObserver& observer);
  void check(const OdeCheckpoint& from, double t0, double t1) const;
  // These return whether to go on.
  bool step();
  bool take(const Attempt& attempt, double drift, bool after_refusal);
  bool give_outputs();
  void give_checkpoint();
  double show(const Point& point);
  bool begin();
  void end(bool completed, std::string reason);
  void happen(std::string event);

  OdeField* field_ = nullptr;
  OdeOptions options_;
  OdeObserver observer_;
  double length_ = 1.0;
  double interval_ = 1.0;
  double inside_ = 0.0;         // distance that evaluations keep from the ends of a piece
  std::vector<double> pieces_;  // their ends
  std::size_t piece_ = 0;
  double begin_ = 0.0;  // of the piece
  Point previous_, current_, trial_;
  Vector shown_;   // current state or that of a trial, projected
  Vector output_;  // within the last step, projected
  Stopwatch watch_;
  double seconds_ = 0.0;  // before this run
  double step_ = 0.0;
  bool anew_ = true;  // the next step begins without history
  bool ended_ = false;
  std::size_t outputs_ = 0;
};

}  // namespace variform
