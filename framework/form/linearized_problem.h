// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/form/quadratic_model.h"

namespace variform {

/// Gauss-Newton model of the regularized energy ||r(u)||^2_W with r_t(u) = vec(E_t u_t - c(Y_t)) for an energy whose
/// targets are a function of the values: J_t = (I - dc/dY) (I (x) E_t), all coordinates coupled (methods: smoothed
/// energies, sec. 4.3). The same assembly and elimination as for the problem itself, on another form; pattern and
/// symbolic analysis once.
class LinearizedProblem : private QuadraticModel {
 public:
  /// The problem must outlive this and keep its beta and positions. Throws UsageError unless its energy is a
  /// TargetEnergy.
  explicit LinearizedProblem(Problem& problem);

  /// See Objective::gauss_newton. The problem's targets must be those of U. Throws UsageError when U does not satisfy
  /// the hard constraints, SolverError as LinearBackend does.
  Direction direction(const Matrix& U, double damping, LinearBackend& backend);

  /// Derivative of ||r(u)||^2_W by U: 2 J'W r, |V| x d. The problem's targets must be those of U.
  Matrix gradient(const Matrix& U) const;

  /// S J (rows x (|V| d), coordinates vertex by vertex) and S r at U, with S'S = W. The problem's targets must be those
  /// of U.
  LeastSquares least_squares(const Matrix& U);

 private:
  void declare();
  void linearize(const Matrix& U);
};

}  // namespace variform
