// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/types.h"

namespace variform {

/// Value of a regularized energy at a state: total = (1-beta) plain + beta variation for the W_n norm.
struct EnergyValue {
  double total = 0.0;      ///< E = ||r||^2_W
  double plain = 0.0;      ///< E_P, the energy without regularization
  double variation = 0.0;  ///< E_R, what beta weighs; NaN in histories with beta = 0, which do not need it
  double penalty = 0.0;    ///< of soft constraints, sum of weight |u - value|^2

  /// What is minimized.
  double objective() const { return total + penalty; }
};

/// Where a linearization of the residual sends a state.
struct Direction {
  Matrix step;         ///< |V| x d, zero at hard constraints
  double slope = 0.0;  ///< derivative of the objective along the step
};

/// The objective near a state as a sum of squares: objective() = |residual|^2, and |residual + jacobian dy|^2 is its
/// Gauss-Newton model in the variables.
struct LeastSquares {
  SparseMatrix jacobian;     ///< rows x variables, all entries, compressed
  Eigen::VectorXd residual;  ///< rows
};

/// What a nonlinear backend minimizes over U (|V| x d). Backends ask for what they need; an objective that does not
/// offer it throws UsageError.
///
/// Hard constraints leave a state fewer degrees of freedom than it has coordinates: its variables y, a vector, with
/// U = state(y). Backends of our own step in U and keep the constraints; those that wrap a library minimize over y.
class Objective {
 public:
  virtual ~Objective() = default;

  /// Infinite total beyond a barrier; backends never step there.
  virtual EnergyValue value(const Matrix& U) = 0;

  /// The variables of a state that satisfies the hard constraints, and the state of given variables.
  virtual Eigen::VectorXd variables(const Matrix& U);
  virtual Matrix state(const Eigen::VectorXd& y);
  /// Derivative of the objective by the variables at U.
  virtual Eigen::VectorXd gradient(const Matrix& U);
  /// The objective as a sum of squares at U: the stacked S r and S J of the norm, soft constraints as further rows.
  virtual LeastSquares least_squares(const Matrix& U);

  /// One alternation from U: targets c(U), then the exact minimizer for these targets (constraints satisfied).
  virtual Matrix local_global_step(const Matrix& U) = 0;

  /// Gauss-Newton direction at U, which satisfies the hard constraints: minimizes ||J d + r||^2_W + damping |d|^2, with
  /// J = dr/du there and damping in units of the mean diagonal entry of J'WJ.
  virtual Direction gauss_newton(const Matrix& U, double damping);

  /// Newton direction at U, which satisfies the hard constraints: minimizes the quadratic model of the objective whose
  /// Hessian is made positive semi-definite cell by cell, with damping in units of its mean diagonal entry.
  virtual Direction newton(const Matrix& U, double damping);

  /// Largest multiple of a step from U (finite value) that stays on this side of a barrier; infinite without one.
  virtual double longest_step(const Matrix& U, const Matrix& step);

  /// Alternation on one functional of states and targets, E(U, c) = ||E U - c||^2_W: one sweep over the targets, each
  /// exactly minimal with all others held, then the minimizer over U. Starts from the targets that are current.
  virtual Matrix coupled_step(const Matrix& U);
  /// E(U, c) for the current targets, while value() takes those that belong to U.
  virtual EnergyValue value_at_targets(const Matrix& U);

  /// Length that step sizes are measured in, the diameter of the domain.
  virtual double length_scale() const = 0;
};

struct NonlinearOptions {
  double tolerance = 1e-6;  ///< stop when no coordinate moves more than this times the length scale, by a whole step
  int max_iterations = 500;
};

/// One row of the convergence history; row 0 is the start.
struct NonlinearStep {
  int iteration = 0;
  EnergyValue energy;
  double step = 0.0;     ///< largest change of a coordinate, relative to the length scale
  double seconds = 0.0;  ///< since the start
};

struct NonlinearReport {
  std::string backend;
  bool converged = false;
  std::string reason;  ///< the stopping rule that held, with its numbers
  int iterations = 0;
  double seconds = 0.0;
  std::vector<NonlinearStep> history;
};

/// Minimizes an objective. Stops by its stopping rule or at the iteration limit, and says which: a run that hit the
/// limit is never reported as converged.
class NonlinearBackend {
 public:
  virtual ~NonlinearBackend() = default;

  /// Called after every iteration; returning false stops with reason "stopped by the observer".
  using Observer = std::function<bool(const NonlinearStep&)>;

  /// Minimizes from U0; returns the last state. Throws SolverError when a linear solve fails or values are not finite.
  Matrix minimize(Objective& objective, const Matrix& U0, const NonlinearOptions& options,
                  const Observer& observer = {});

  const NonlinearReport& report() const { return report_; }

 protected:
  explicit NonlinearBackend(std::string name) { report_.backend = std::move(name); }

  /// Next state. Whether to stop there is decided by minimize(), by the same rules for all backends; a step that knows
  /// the run to be over says so by stop().
  virtual Matrix step(Objective& objective, const Matrix& U) = 0;

  /// The value that goes into the history.
  virtual EnergyValue value(Objective& objective, const Matrix& U) { return objective.value(U); }

  /// Called before the first step.
  virtual void start() {}

  /// Ends the run after this step: whether that counts as convergence, and the rule with its numbers.
  void stop(bool converged, std::string reason);

  /// Says that this step is a part only of one with this largest change of a coordinate (line search, damping): that
  /// the part is small is no sign of convergence.
  void part_of(double whole) { whole_ = whole; }

  /// The last row of the history: the state that step() starts from.
  const NonlinearStep& last() const { return report_.history.back(); }

 private:
  bool stopped_ = false;
  double whole_ = 0.0;
  NonlinearReport report_;
};

}  // namespace variform
