// SPDX-License-Identifier: BSD-3-Clause
#include "framework/solver/nonlinear_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/base/error.h"

namespace variform {

namespace {

[[noreturn]] void offers_none(const char* what) {
  throw UsageError(fmt::format("this objective offers no {}: choose another nonlinear backend", what));
}

}  // namespace

void Objective::check_start(const Matrix&) {}
Eigen::VectorXd Objective::variables(const Matrix&) { offers_none("variables"); }
Matrix Objective::state(const Eigen::VectorXd&) { offers_none("variables"); }
Eigen::VectorXd Objective::gradient(const Matrix&) { offers_none("gradient"); }
LeastSquares Objective::least_squares(const Matrix&) { offers_none("sum of squares"); }
Direction Objective::newton(const Matrix&, double) { offers_none("Hessian"); }
double Objective::longest_step(const Matrix&, const Matrix&) { return std::numeric_limits<double>::infinity(); }

double stationarity(const Objective& objective, const Eigen::VectorXd& gradient, const EnergyValue& energy) {
  constexpr double kZero = 1e-6;
  const double size = gradient.lpNorm<1>() * objective.length_scale();
  if (size == 0.0) return 0.0;
  return size / std::max(energy.objective(), kZero * objective.energy_scale());
}

Direction Objective::gauss_newton(const Matrix&, double) {
  throw UsageError("this objective has no linearized residual for Gauss-Newton steps");
}

Matrix Objective::coupled_step(const Matrix&) { throw UsageError("this objective has no targets to alternate with"); }

EnergyValue Objective::value_at_targets(const Matrix&) {
  throw UsageError("this objective has no targets to alternate with");
}

void NonlinearBackend::stop(bool converged, std::string reason) {
  stopped_ = true;
  report_.converged = converged;
  report_.reason = std::move(reason);
}

Matrix NonlinearBackend::minimize(Objective& objective, const Matrix& U0, const NonlinearOptions& options,
                                  const Observer& observer) {
  watch_ = {};
  const std::string name = report_.backend;
  report_ = {};
  report_.backend = name;
  stopped_ = false;
  options_ = options;
  observer_ = observer;
  objective.check_start(U0);
  start();
  const EnergyValue energy = value(objective, U0);
  if (!std::isfinite(energy.objective())) {
    throw SolverError(fmt::format("nonlinear backend '{}': the energy is not finite at the start", name));
  }
  NonlinearStep first{.energy = energy};
  if (minimizes_objective()) first.gradient = stationarity(objective, objective.gradient(U0), energy);
  first.seconds = watch_.seconds();
  report_.history.push_back(first);
  if (first.gradient <= options_.gradient_tolerance) {
    stop(true, fmt::format("gradient {:.3g} at most tolerance {:.3g}", first.gradient, options_.gradient_tolerance));
  }
  Matrix U = over() ? U0 : run(objective, U0);
  if (report_.reason.empty()) {
    report_.reason = fmt::format("iteration limit {} (last step {:.3g}, tolerance {:.3g}", options_.max_iterations,
                                 last().step, options_.tolerance);
    if (minimizes_objective()) {
      report_.reason +=
          fmt::format("; gradient {:.3g}, tolerance {:.3g}", last().gradient, options_.gradient_tolerance);
    }
    report_.reason += ")";
  }
  observer_ = {};
  report_.seconds = watch_.seconds();
  return U;
}

Matrix NonlinearBackend::run(Objective& objective, const Matrix& U0) {
  const double length = objective.length_scale();
  Matrix U = U0;
  while (true) {
    whole_ = 0.0;
    Matrix next = step(objective, U);
    if (!next.allFinite()) {
      throw SolverError(fmt::format("nonlinear backend '{}': a coordinate is not finite after iteration {}",
                                    report_.backend, report_.iterations + 1));
    }
    const double change = (next - U).cwiseAbs().maxCoeff() / length;
    U.swap(next);
    const EnergyValue energy = value(objective, U);
    const double gradient = minimizes_objective() ? stationarity(objective, objective.gradient(U), energy)
                                                  : std::numeric_limits<double>::quiet_NaN();
    if (!advance(energy, change, std::max(change, whole_ / length), gradient)) return U;
  }
}

bool NonlinearBackend::advance(EnergyValue energy, double change, double whole, double gradient) {
  ++report_.iterations;
  report_.history.push_back({report_.iterations, energy, change, watch_.seconds(), gradient});
  if (!std::isfinite(energy.objective())) {
    throw SolverError(fmt::format("nonlinear backend '{}': the energy is not finite after iteration {}",
                                  report_.backend, report_.iterations));
  }
  const bool go_on = !observer_ || observer_(report_.history.back());
  if (gradient <= options_.gradient_tolerance && !report_.converged) {
    stop(true, fmt::format("gradient {:.3g} at most tolerance {:.3g}", gradient, options_.gradient_tolerance));
  } else if (!stopped_ && whole <= options_.tolerance) {
    stop(true, fmt::format("step {:.3g} at most tolerance {:.3g}", change, options_.tolerance));
  } else if (!stopped_ && !go_on) {
    stop(false, "stopped by the observer");
  }
  return !over();
}

}  // namespace variform
