// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "framework/solver/nonlinear_backend.h"

namespace variform {

/// An objective as libraries see it: a function f(x) = E / E_0 of the variables x = y / L, so that absolute tolerances
/// and first steps inside a library mean the same for every problem. L is the length scale, E_0 the value at the start.
class ScaledObjective {
 public:
  /// Throws UsageError when the objective offers no variables, or U0 does not satisfy the hard constraints.
  ScaledObjective(Objective& objective, const Matrix& U0, const EnergyValue& energy);

  Objective& objective() const { return objective_; }
  const Eigen::VectorXd& start() const { return start_; }
  Eigen::Index size() const { return start_.size(); }
  double length() const { return length_; }
  /// E_0; 1 where the start has the value 0.
  double energy() const { return energy_; }

  Matrix state(const Eigen::VectorXd& x) const { return objective_.state(length_ * x); }
  double value(const EnergyValue& energy) const { return energy.objective() / energy_; }
  /// df/dx from dE/dy.
  Eigen::VectorXd gradient(const Eigen::VectorXd& by_variables) const { return (length_ / energy_) * by_variables; }

 private:
  Objective& objective_;
  double length_;
  double energy_;
  Eigen::VectorXd start_;
};

/// A backend that hands the variables to a library with a loop of its own. Only the gradient criterion applies, and the
/// iteration limit; the library's own criteria are off, as far as it lets them be. Where it ends nevertheless (a line
/// search in rounding, a threshold built in), it goes on from there, scaled anew, as long as that leads on; then the
/// run is not converged.
class LibraryBackend : public NonlinearBackend {
 protected:
  using NonlinearBackend::NonlinearBackend;

  bool minimizes_objective() const final { return true; }
  Matrix run(Objective& objective, const Matrix& U0) final;

  /// Minimizes, calling reached() or stayed() once per iteration and ending when these return false. Returns
  /// what the library says of its end. Must not throw through the library.
  virtual std::string optimize(const ScaledObjective& objective) = 0;

  /// An iteration that led to x, of finite value. What the objective throws goes through.
  bool reached(const ScaledObjective& objective, const Eigen::VectorXd& x);
  /// The same where value and derivative by the variables are known already.
  bool reached(const ScaledObjective& objective, const Eigen::VectorXd& x, const EnergyValue& energy,
               const Eigen::VectorXd& gradient);
  /// An iteration that led nowhere: a rejected step.
  bool stayed();

 private:
  Matrix state_;  // the last one reached
};

}  // namespace variform
