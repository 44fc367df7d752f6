// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/library_backend.h"

#include <fmt/format.h>

#include <limits>

namespace variform {

namespace {
constexpr double kNoCriterion = std::numeric_limits<double>::infinity();  // of steps
}  // namespace

ScaledObjective::ScaledObjective(Objective& objective, const Matrix& U0, const EnergyValue& energy)
    : objective_(objective),
      length_(objective.length_scale()),
      energy_(energy.objective() > 0.0 ? energy.objective() : 1.0),
      start_(objective.variables(U0) / length_) {}

Matrix LibraryBackend::run(Objective& objective, const Matrix& U0) {
  state_ = U0;
  std::string end;
  for (double before = std::numeric_limits<double>::infinity(); !over() && last().energy.objective() < before;) {
    before = last().energy.objective();
    end = optimize(ScaledObjective(objective, state_, last().energy));
  }
  if (!over()) {
    stop(false, fmt::format("the library gives up: {} (gradient {:.3g})", end, last().gradient));
  }
  return std::move(state_);
}

bool LibraryBackend::reached(const ScaledObjective& objective, const Eigen::VectorXd& x) {
  const Matrix U = objective.state(x);
  const EnergyValue energy = objective.objective().value(U);
  return reached(objective, x, energy, objective.objective().gradient(U));
}

bool LibraryBackend::reached(const ScaledObjective& objective, const Eigen::VectorXd& x, const EnergyValue& energy,
                             const Eigen::VectorXd& gradient) {
  Matrix U = objective.state(x);
  const double change = (U - state_).cwiseAbs().maxCoeff() / objective.length();
  state_ = std::move(U);
  return advance(energy, change, kNoCriterion, stationarity(objective.objective(), gradient, energy));
}

bool LibraryBackend::stayed() { return advance(last().energy, 0.0, kNoCriterion, last().gradient); }

}  // namespace variform
