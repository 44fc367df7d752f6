// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nonlinear_backends.h"

#ifdef VARIFORM_WITH_CERES
#include <ceres/first_order_function.h>
#include <ceres/gradient_problem.h>
#include <ceres/gradient_problem_solver.h>
#include <ceres/iteration_callback.h>
#include <fmt/format.h>

#include <cmath>
#include <exception>
#include <limits>

#include "solvers/nonlinear/ceres_callback.h"
#include "solvers/nonlinear/library_backend.h"
#include "solvers/nonlinear/quiet_ceres.h"
#endif

namespace variform {

#ifdef VARIFORM_WITH_CERES
namespace {

// f, and false beyond a barrier, which shortens the step. The last point with gradient is kept for the history.
class Function final : public ceres::FirstOrderFunction {
 public:
  Function(const ScaledObjective& objective, std::exception_ptr& error) : objective_(objective), error_(error) {}

  int NumParameters() const override { return static_cast<int>(objective_.size()); }

  bool Evaluate(const double* parameters, double* cost, double* gradient) const override {
    if (error_) return false;  // Ceres tries shorter steps first
    try {
      const Eigen::Map<const Eigen::VectorXd> x(parameters, objective_.size());
      const Matrix U = objective_.state(x);
      const EnergyValue energy = objective_.objective().value(U);
      *cost = objective_.value(energy);
      if (!std::isfinite(*cost)) return false;
      if (gradient != nullptr) {
        last_ = {x, energy, objective_.objective().gradient(U)};
        Eigen::Map<Eigen::VectorXd>(gradient, objective_.size()) = objective_.gradient(last_.gradient);
      }
      return true;
    } catch (...) {
      error_ = std::current_exception();
      return false;
    }
  }

  struct Point {
    Eigen::VectorXd x = {};
    EnergyValue energy = {};
    Eigen::VectorXd gradient = {};  // by the variables
  };
  const Point& last() const { return last_; }

 private:
  const ScaledObjective& objective_;
  std::exception_ptr& error_;
  mutable Point last_;
};

class CeresLineSearch final : public LibraryBackend, private CeresCallback {
 public:
  explicit CeresLineSearch(const Parameters& parameters) : LibraryBackend("ceres.line_search") {
    const std::string& direction = parameters.string("direction");
    options_.line_search_direction_type = direction == "lbfgs"                ? ceres::LBFGS
                                          : direction == "conjugate_gradient" ? ceres::NONLINEAR_CONJUGATE_GRADIENT
                                                                              : ceres::STEEPEST_DESCENT;
    const std::string& variant = parameters.string("conjugate_gradient");
    options_.nonlinear_conjugate_gradient_type = variant == "polak_ribiere"      ? ceres::POLAK_RIBIERE
                                                 : variant == "hestenes_stiefel" ? ceres::HESTENES_STIEFEL
                                                                                 : ceres::FLETCHER_REEVES;
    options_.max_lbfgs_rank = static_cast<int>(parameters.integer("memory"));
    options_.use_approximate_eigenvalue_bfgs_scaling = true;
    options_.max_num_iterations = std::numeric_limits<int>::max();
    options_.function_tolerance = options_.gradient_tolerance = options_.parameter_tolerance = 0.0;
    options_.max_num_line_search_step_size_iterations = 50;
    options_.min_line_search_step_size = 1e-20;
    options_.logging_type = ceres::SILENT;
    options_.update_state_every_iteration = true;
  }

 protected:
  std::string optimize(const ScaledObjective& objective) override {
    error_ = {};
    objective_ = &objective;
    x_ = objective.start();
    auto* function = new Function(objective, error_);
    function_ = function;
    ceres::GradientProblem problem(function);
    ceres::GradientProblemSolver::Options options = options_;
    options.callbacks.push_back(this);
    ceres::GradientProblemSolver::Summary summary;
    const QuietCeres quiet;
    ceres::Solve(options, problem, x_.data(), &summary);
    rethrow();
    return summary.message;
  }

 private:
  bool goes_on(const ceres::IterationSummary&) override {
    const Function::Point& known = function_->last();
    return known.x == x_ ? reached(*objective_, x_, known.energy, known.gradient) : reached(*objective_, x_);
  }

  ceres::GradientProblemSolver::Options options_;
  const ScaledObjective* objective_ = nullptr;
  const Function* function_ = nullptr;  // owned by the problem
  Eigen::VectorXd x_;
};

}  // namespace
#endif

NonlinearBackendEntry describe_ceres_line_search() {
  NonlinearBackendEntry entry;
  entry.name = "ceres.line_search";
  entry.doc = "L-BFGS, nonlinear conjugate gradients or steepest descent with a Wolfe line search, of Ceres";
  entry.package = "libceres-dev";
  entry.option = "VARIFORM_CERES";
  entry.licence = "GPL-2.0-or-later";  // Ceres itself is BSD-3-Clause; Debian's is linked to SuiteSparse
  entry.parameters = {{.name = "direction",
                       .value = std::string("lbfgs"),
                       .doc = "of the search",
                       .choices = {"lbfgs", "conjugate_gradient", "steepest_descent"}},
                      {.name = "memory",
                       .value = std::int64_t{20},
                       .doc = "lbfgs: pairs of steps and gradients that are kept",
                       .min = 1.0,
                       .max = 1000.0},
                      {.name = "conjugate_gradient",
                       .value = std::string("polak_ribiere"),
                       .doc = "conjugate_gradient: formula",
                       .choices = {"polak_ribiere", "hestenes_stiefel", "fletcher_reeves"}}};
#ifdef VARIFORM_WITH_CERES
  entry.make = [](const Parameters& p) { return std::make_unique<CeresLineSearch>(p); };
#endif
  return entry;
}

}  // namespace variform
