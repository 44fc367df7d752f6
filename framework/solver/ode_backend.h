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

  /// Times inside (t0, t1), ascending, where f is not smooth in t: methods start anew there.
  virtual std::vector<double> breaks(double /*t0*/, double /*t1*/) const { return {}; }
};

struct OdeOptions {
  double tolerance = 1e-4;      ///< largest error of a step at any point, by length_scale (methods with step control)
  double first_step = 0.02;     ///< first step by t1 - t0; the step of methods without control
  double smallest_step = 1e-6;  ///< by t1 - t0: shorter ones end the integration
  int max_steps = 100000;
  std::vector<double> outputs = {};  ///< ascending times in [t0, t1] at which states are asked for
};

/// One accepted step.
struct OdeStep {
  int number = 0;    ///< from 1
  double time = 0;   ///< at its end
  double size = 0;   ///< time that it took
  double error = std::numeric_limits<double>::quiet_NaN();  ///< estimate by length_scale, where the method has one
  double drift = 0;  ///< see OdeField, at its end, by length_scale
  std::int64_t evaluations = 0;  ///< of the field, so far
};

struct OdeReport {
  std::string backend;
  bool completed = false;  ///< the end of the interval was reached
  std::string reason;      ///< "end of the interval", or why not, with numbers
  double time = 0.0;       ///< reached
  std::string event;       ///< what OdeField refused at that time: "cell 17 inverts"; empty: nothing
  int steps = 0;           ///< accepted
  int rejected = 0;        ///< for their error
  int refused = 0;         ///< by the field
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
  std::function<bool(const OdeStep&, const Vector& y)> step = {};    ///< y projected
  std::function<bool(double t, const Vector& y)> output = {};        ///< at OdeOptions::outputs; y projected
  std::function<void(const OdeCheckpoint&)> checkpoint = {};         ///< every checkpoint_steps accepted steps
  int checkpoint_steps = 10;
};

/// Integrates an OdeField from t0 to t1. The loop is the same for all methods: pieces between breaks, the end of every
/// step checked and projected, states at requested times, refusals answered by shorter steps; a refusal that persists
/// down to the smallest step is an event, which ends the integration with the last good state. Methods implement one
/// step.
///
/// A run that goes on from a checkpoint gives the same numbers as one that was never interrupted: methods save their
/// history, or start anew at every checkpoint, interrupted or not.
///
/// Names: euler, rk4, abm3, odeint.dopri5, cvode.adams, cvode.bdf, arkode.erk; see integrators/ode/ode_backends.h.
class OdeBackend {
 public:
  virtual ~OdeBackend() = default;

  /// Returns the last state, projected: at t1 if report().completed, else where it ended. Throws UsageError for times
  /// and options that make no sense, SolverError when the field fails or values are not finite.
  Vector integrate(OdeField& field, const Vector& y0, double t0, double t1, const OdeOptions& options,
                   const OdeObserver& observer = {});
  /// Goes on from a checkpoint of an integration with the same field, interval and options.
  Vector resume(OdeField& field, const OdeCheckpoint& from, double t0, double t1, const OdeOptions& options,
                const OdeObserver& observer = {});

  const OdeReport& report() const { return report_; }

  /// Order of the global error by the step.
  virtual int order() const = 0;

 protected:
  explicit OdeBackend(std::string name) { report_.backend = std::move(name); }

  OdeReport report_;
};

}  // namespace variform
