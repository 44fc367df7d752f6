// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/problem_objective.h"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "framework/base/error.h"

namespace variform {

EnergyValue ProblemObjective::value(const Matrix& U) {
  if (!problem_.constraints().soft().empty()) problem_.reduced_matrix();  // fills in the default weight
  undefined_targets_ += problem_.refresh_target(U);
  return problem_.value(U, false);
}

FreeVariables& ProblemObjective::free_variables() {
  if (!free_variables_) free_variables_ = std::make_unique<FreeVariables>(problem_.constraints());
  return *free_variables_;
}

LinearizedProblem& ProblemObjective::linearized_at(const Matrix& U) {
  problem_.refresh_target(U);
  if (!linearized_) linearized_ = std::make_unique<LinearizedProblem>(problem_);
  return *linearized_;
}

double ProblemObjective::soft_weight(const Constraints::Value& soft) const {
  if (soft.weight > 0.0) return soft.weight;
  problem_.reduced_matrix();  // fills in the default weight
  return problem_.default_soft_weight();
}

Eigen::VectorXd ProblemObjective::variables(const Matrix& U) {
  return free_variables().of(U, 1e-9 * problem_.domain().diameter());
}

Matrix ProblemObjective::state(const Eigen::VectorXd& y) { return free_variables().state(y); }

Eigen::VectorXd ProblemObjective::gradient(const Matrix& U) {
  variables(U);  // says so when U violates a constraint
  Matrix G = linearized_at(U).gradient(U);
  for (const auto& soft : problem_.constraints().soft()) {
    G.row(soft.vertex) += 2.0 * soft_weight(soft) * (U.row(soft.vertex) - soft.value);
  }
  return free_variables().restricted(G);
}

LeastSquares ProblemObjective::least_squares(const Matrix& U) {
  variables(U);
  LeastSquares model = linearized_at(U).least_squares(U);
  const auto& constraints = problem_.constraints();
  if (const auto& soft = constraints.soft(); !soft.empty()) {
    // Rows sqrt(weight) (u - value).
    const int d = constraints.dimension();
    const auto first = static_cast<Index>(model.residual.size());
    const Index rows = first + static_cast<Index>(soft.size()) * d;
    model.residual.conservativeResize(rows);
    std::vector<Eigen::Triplet<double, Index>> triplets;
    for (Index j = 0; j < model.jacobian.cols(); ++j) {
      for (SparseMatrix::InnerIterator it(model.jacobian, j); it; ++it) {
        triplets.emplace_back(static_cast<Index>(it.row()), j, it.value());
      }
    }
    Index row = first;
    for (const auto& value : soft) {
      const double root = std::sqrt(soft_weight(value));
      for (int k = 0; k < d; ++k, ++row) {
        triplets.emplace_back(row, value.vertex * d + k, root);
        model.residual[row] = root * (U(value.vertex, k) - value.value[k]);
      }
    }
    model.jacobian.resize(rows, model.jacobian.cols());
    model.jacobian.setFromTriplets(triplets.begin(), triplets.end());
  }
  model.jacobian = free_variables().restricted(model.jacobian);
  return model;
}

double ProblemObjective::energy_scale() const {
  const Term& term = problem_.terms().front();
  const Form& form = term.form;
  return term.norm->plain_squared(
      Eigen::Map<const Matrix>(form.target_data(0), form.site_count(), form.residuals() * form.columns()));
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
  return linearized_at(U).direction(U, damping, backend_);
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
