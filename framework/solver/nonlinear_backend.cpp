// SPDX-License-Identifier: BSD-3-Clause
#include "framework/solver/nonlinear_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"

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
  const Stopwatch watch;
  const std::string name = report_.backend;
  report_ = {};
  report_.backend = name;
  stopped_ = false;
  objective.check_start(U0);
  start();
  Matrix U = U0;
  report_.history.push_back({0, value(objective, U), 0.0, watch.seconds()});
  while (report_.iterations < options.max_iterations) {
    whole_ = 0.0;
    Matrix next = step(objective, U);
    if (!next.allFinite()) {
      throw SolverError(fmt::format("nonlinear backend '{}': a coordinate is not finite after iteration {}", name,
                                    report_.iterations + 1));
    }
    const double change = (next - U).cwiseAbs().maxCoeff() / objective.length_scale();
    U.swap(next);
    ++report_.iterations;
    report_.history.push_back({report_.iterations, value(objective, U), change, watch.seconds()});
    if (!std::isfinite(report_.history.back().energy.total)) {
      throw SolverError(
          fmt::format("nonlinear backend '{}': the energy is not finite after iteration {}", name, report_.iterations));
    }
    const bool go_on = !observer || observer(report_.history.back());
    if (stopped_) break;
    if (std::max(change, whole_ / objective.length_scale()) <= options.tolerance) {
      report_.converged = true;
      report_.reason = fmt::format("step {:.3g} at most tolerance {:.3g}", change, options.tolerance);
      break;
    }
    if (!go_on) {
      report_.reason = "stopped by the observer";
      break;
    }
  }
  if (report_.reason.empty()) {
    report_.reason = fmt::format("iteration limit {} (last step {:.3g}, tolerance {:.3g})", options.max_iterations,
                                 report_.history.back().step, options.tolerance);
  }
  report_.seconds = watch.seconds();
  return U;
}

}  // namespace variform
