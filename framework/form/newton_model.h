// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/form/quadratic_model.h"

namespace variform {

/// Newton model of the regularized energy (1 - beta) sum A_t |r_t|^2 + beta (variation of r), r_t = Y_t - c(Y_t). The
/// Hessian of each cell's own summand, positive semi-definite by TargetEnergy::curvature_root, and the Gauss-Newton
/// matrix of the variation, which lacks the second derivatives of c and is semi-definite as it is. At beta = 0 this is
/// Newton's method with the Hessian projected cell by cell (Teran et al. 2005), which converges quadratically to minima
/// where no cell has a negative curvature; for beta > 0 a quasi-Newton model. The gradient is exact in both cases.
///
/// With half the Hessian of a cell as R'R its blocks R (I (x) E) are a form like any other: norm, assembly (values
/// refilled in place, same bits on any number of threads) and elimination are those of the problem.
class NewtonModel : private QuadraticModel {
 public:
  /// The problem must outlive this and keep its beta and positions. Throws UsageError unless its energy is a
  /// TargetEnergy.
  explicit NewtonModel(Problem& problem);

  /// Derivative of the objective at U by its coordinates (|V| x d), soft constraints included, as if vertices with hard
  /// ones were free. The problem's targets must be those of U, which satisfies the hard constraints.
  Matrix gradient(const Matrix& U);

  /// Values of half the Hessian at U, constraints eliminated, refilled in place: the matrix that is factorized but for
  /// damping (lower triangle; multiplier rows for linear equalities). Throws as direction().
  const SparseMatrix& matrix(const Matrix& U);

  /// See Objective::newton. The problem's targets must be those of U. Throws UsageError when U does not satisfy the
  /// hard constraints, SolverError as LinearBackend does.
  Direction direction(const Matrix& U, double damping, LinearBackend& backend);

 private:
  Matrix half_gradient(const Matrix& U);
  void refresh_curvature(const Matrix& U);

  bool regularized_ = false;  // terms_[1] is the variation
  Matrix weighted_;           // W r
  Matrix forces_;             // of every cell on its nodes
};

/// Largest s such that the targets of all cells are defined at U + s' step for s' in [0, s); infinite for energies
/// without a barrier. The problem's energy must be a TargetEnergy.
double longest_step(const Problem& problem, const Matrix& U, const Matrix& step);

}  // namespace variform
