// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "framework/form/free_variables.h"
#include "framework/form/linearized_problem.h"
#include "framework/form/newton_model.h"
#include "framework/form/problem.h"
#include "framework/solver/nonlinear_backend.h"

namespace variform {

/// A problem whose targets depend on the state, as nonlinear backends see it.
class ProblemObjective final : public Objective {
 public:
  ProblemObjective(Problem& problem, LinearBackend& backend) : problem_(problem), backend_(backend) {}

  EnergyValue value(const Matrix& U) override;

  /// The values at free vertices, see FreeVariables.
  Eigen::VectorXd variables(const Matrix& U) override;
  Matrix state(const Eigen::VectorXd& y) override;
  /// With the part of the targets that follows the state. These two need an energy whose targets are a function of the
  /// cells' values (TargetEnergy), and a state that satisfies the hard constraints: UsageError otherwise.
  Eigen::VectorXd gradient(const Matrix& U) override;
  LeastSquares least_squares(const Matrix& U) override;

  Matrix local_global_step(const Matrix& U) override;
  Direction gauss_newton(const Matrix& U, double damping) override;
  Direction newton(const Matrix& U, double damping) override;
  double longest_step(const Matrix& U, const Matrix& step) override;
  /// DataError with the number of inverted cells where the energy is infinite.
  void check_start(const Matrix& U) override;
  Matrix coupled_step(const Matrix& U) override;
  EnergyValue value_at_targets(const Matrix& U) override { return problem_.value(U); }
  double length_scale() const override { return problem_.domain().diameter(); }
  /// ||c||^2 in the plain norm: the energy of the state 0.
  double energy_scale() const override;
  /// Without regularization, where both half steps minimize the same.
  bool alternation_descends() const override { return problem_.beta() == 0.0; }

  /// Sites that kept their target, summed over the states that value() was asked for and the coupled steps.
  Index undefined_targets() const { return undefined_targets_; }

 private:
  FreeVariables& free_variables();
  LinearizedProblem& linearized_at(const Matrix& U);  // targets are those of U then
  double soft_weight(const Constraints::Value& soft) const;

  Problem& problem_;
  LinearBackend& backend_;
  std::unique_ptr<FreeVariables> free_variables_;  // made when first asked for
  std::unique_ptr<LinearizedProblem> linearized_;  // likewise
  std::unique_ptr<NewtonModel> newton_;            // likewise
  Index undefined_targets_ = 0;
};

}  // namespace variform
