// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/problem_objective.h"

#include <fmt/format.h>

#include "framework/base/error.h"

namespace variform {

EnergyValue ProblemObjective::value(const Matrix& U) {
  if (!problem_.constraints().soft().empty()) problem_.reduced_matrix();  // fills in the default weight
  undefined_targets_ += problem_.refresh_target(U);
  return problem_.value(U);
}

Matrix ProblemObjective::local_global_step(const Matrix& U) {
  const Energy& energy = problem_.energy();
  if (dynamic_cast<const TargetEnergy*>(&energy) != nullptr &&
      dynamic_cast<const ProjectedEnergy*>(&energy) == nullptr) {
    throw UsageError(
        "the targets of this energy are no projections: alternating with them does not minimize it; take newton or "
        "gauss_newton");
  }
  problem_.refresh_target(U);
  return problem_.solve(backend_);
}

Direction ProblemObjective::gauss_newton(const Matrix& U, double damping) {
  problem_.refresh_target(U);
  if (!linearized_) linearized_ = std::make_unique<LinearizedProblem>(problem_);
  return linearized_->direction(U, damping, backend_);
}

Direction ProblemObjective::newton(const Matrix& U, double damping) {
  problem_.refresh_target(U);
  if (!newton_) newton_ = std::make_unique<NewtonModel>(problem_);
  return newton_->direction(U, damping, backend_);
}

double ProblemObjective::longest_step(const Matrix& U, const Matrix& step) {
  return variform::longest_step(problem_, U, step);
}

void ProblemObjective::check_start(const Matrix& U) {
  if (!problem_.traits().barrier) return;
  const Index inverted = problem_.refresh_target(U);
  if (inverted == 0) return;
  throw DataError(fmt::format(
      "this energy is infinite where cells are inverted or degenerate, and {} of {} are at the start; start "
      "without: from a Tutte map, or from a regularized solution of another energy",
      inverted, problem_.domain().cell_count()));
}

Matrix ProblemObjective::coupled_step(const Matrix& U) {
  undefined_targets_ += problem_.couple_targets(U);
  return problem_.solve(backend_);
}

}  // namespace variform
