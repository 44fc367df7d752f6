// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/problem_objective.h"

namespace variform {

EnergyValue ProblemObjective::value(const Matrix& U) {
  if (!problem_.constraints().soft().empty()) problem_.reduced_matrix();  // fills in the default weight
  undefined_targets_ += problem_.refresh_target(U);
  return problem_.value(U, false);
}

Matrix ProblemObjective::local_global_step(const Matrix& U) {
  problem_.refresh_target(U);
  return problem_.solve(backend_);
}

Direction ProblemObjective::gauss_newton(const Matrix& U, double damping) {
  problem_.refresh_target(U);
  if (!linearized_) linearized_ = std::make_unique<LinearizedProblem>(problem_);
  return linearized_->direction(U, damping, backend_);
}

Matrix ProblemObjective::coupled_step(const Matrix& U) {
  undefined_targets_ += problem_.couple_targets(U);
  return problem_.solve(backend_);
}

}  // namespace variform
