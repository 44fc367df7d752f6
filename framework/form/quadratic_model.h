// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "framework/form/assembly.h"
#include "framework/form/constraints.h"
#include "framework/form/energy.h"
#include "framework/solver/linear_backend.h"
#include "framework/solver/nonlinear_backend.h"

namespace variform {

class Problem;
struct ProblemTimes;

/// What the models of a problem about a state share: a semi-definite half Hessian K = sum E' W E over terms with all
/// coordinates coupled, the constraints for a step, and the minimizer of d'Kd - 2 b'd + damping |d|^2. The same
/// assembly and elimination as for the problem itself; pattern and symbolic analysis once.
class QuadraticModel {
 protected:
  /// The problem must outlive this and keep its beta and positions. Throws UsageError, beginning with the name of the
  /// model, unless its energy is a TargetEnergy.
  QuadraticModel(Problem& problem, const char* name);
  ~QuadraticModel();

  const TargetEnergy& energy() const { return *energy_; }
  ProblemTimes& times() const;

  /// All but the first of the problem's terms: they do not depend on the state and keep their operator.
  void add_linear_terms(std::vector<Term> declared);

  /// The constraints that a step from U has to satisfy: zero at the hard ones. Throws UsageError when U does not
  /// satisfy these.
  Constraints constraints_at(const Matrix& U);
  /// Values of K from the terms.
  void refill(const Constraints& constraints);
  /// Minimizes the model; b: unknown_count x 1, minus half the gradient of the objective without soft constraints.
  /// damping in units of the mean diagonal entry of K. Throws SolverError as LinearBackend does.
  Direction minimizer(const Constraints& constraints, const Matrix& b, double damping, LinearBackend& backend);

  /// The sites of a form with `residuals` components each and all coordinates of a node in one system.
  static Form coupled_form(const Form& form, int residuals);
  /// (I (x) E_s) with the columns of u coupled: rows are vec(r_s), columns the d values of one node after the other.
  static void couple_block(const Form& form, Index s, Eigen::Ref<Eigen::MatrixXd> block);

  Problem& problem_;
  std::vector<Term> terms_;
  std::unique_ptr<Assembly> assembly_;
  std::unique_ptr<Reduction> reduction_;

 private:
  const char* name_;
  const TargetEnergy* energy_;
  SparseMatrix damped_;
};

}  // namespace variform
