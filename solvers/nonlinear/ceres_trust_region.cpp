// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nonlinear_backends.h"

#ifdef VARIFORM_WITH_CERES
#include <ceres/cost_function.h>
#include <ceres/evaluation_callback.h>
#include <ceres/iteration_callback.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>

#include "framework/base/error.h"
#include "solvers/nonlinear/ceres_callback.h"
#include "solvers/nonlinear/library_backend.h"
#include "solvers/nonlinear/quiet_ceres.h"
#endif

namespace variform {

#ifdef VARIFORM_WITH_CERES
namespace {

using RowMatrix = Eigen::SparseMatrix<double, Eigen::RowMajor, Index>;

// The residual and its Jacobian at the state that Ceres is about to evaluate, computed at once for all residual blocks.
// Scaled so that |residual|^2 = f(x).
class StackedResidual final : public ceres::EvaluationCallback {
 public:
  StackedResidual(const ScaledObjective& objective, Eigen::VectorXd& x, std::exception_ptr& error)
      : objective_(objective), x_(x), error_(error) {
    evaluate();
  }

  void PrepareForEvaluation(bool, bool new_evaluation_point) override {
    if (!new_evaluation_point || error_) return;  // Ceres tries shorter steps first
    try {
      evaluate();
    } catch (...) {
      error_ = std::current_exception();
      finite_ = false;
    }
  }

  bool finite() const { return finite_; }
  const RowMatrix& jacobian() const { return jacobian_; }
  const Eigen::VectorXd& residual() const { return residual_; }

 private:
  void evaluate() {
    const Matrix U = objective_.state(x_);
    finite_ = std::isfinite(objective_.objective().value(U).objective());
    if (!finite_) return;  // beyond a barrier
    const double scale = 1.0 / std::sqrt(objective_.energy());
    LeastSquares model = objective_.objective().least_squares(U);
    residual_ = scale * model.residual;
    const Eigen::Index entries = jacobian_.nonZeros();
    jacobian_ = model.jacobian;
    jacobian_ *= scale * objective_.length();
    if (entries > 0 && jacobian_.nonZeros() != entries) {
      throw SolverError("nonlinear backend 'ceres.trust_region': the pattern of the Jacobian changed on the way");
    }
  }

  const ScaledObjective& objective_;
  Eigen::VectorXd& x_;
  std::exception_ptr& error_;
  bool finite_ = false;
  RowMatrix jacobian_;
  Eigen::VectorXd residual_;
};

// Consecutive rows that see the same variables. Their entries lie in the order of Ceres' parameter blocks, which are
// runs of variables.
class Rows final : public ceres::CostFunction {
 public:
  Rows(const StackedResidual& all, Index first, Index count, const std::vector<int>& block_sizes)
      : all_(all), first_(first) {
    set_num_residuals(count);
    *mutable_parameter_block_sizes() = block_sizes;
  }

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    if (!all_.finite()) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, num_residuals()) = all_.residual().segment(first_, num_residuals());
    if (jacobians == nullptr) return true;
    const RowMatrix& J = all_.jacobian();
    for (int i = 0; i < num_residuals(); ++i) {
      const double* entry = J.valuePtr() + J.outerIndexPtr()[first_ + i];
      for (std::size_t b = 0; b < parameter_block_sizes().size(); ++b) {
        const int size = parameter_block_sizes()[b];
        if (jacobians[b] != nullptr) std::copy_n(entry, size, jacobians[b] + static_cast<std::ptrdiff_t>(i) * size);
        entry += size;
      }
    }
    return true;
  }

 private:
  const StackedResidual& all_;
  Index first_;
};

// First variable of each run of consecutive variables that the same rows see, and the number of variables at the end.
std::vector<Index> variable_blocks(const SparseMatrix& J) {
  std::vector<Index> starts;
  const auto rows_of = [&](Index j) {
    return std::pair(J.innerIndexPtr() + J.outerIndexPtr()[j], J.innerIndexPtr() + J.outerIndexPtr()[j + 1]);
  };
  for (Index j = 0; j < J.cols(); ++j) {
    if (j > 0) {
      const auto [a, a_end] = rows_of(j - 1);
      const auto [b, b_end] = rows_of(j);
      if (std::equal(a, a_end, b, b_end)) continue;
    }
    starts.push_back(j);
  }
  starts.push_back(static_cast<Index>(J.cols()));
  return starts;
}

class CeresTrustRegion final : public LibraryBackend, private CeresCallback {
 public:
  explicit CeresTrustRegion(const Parameters& parameters) : LibraryBackend("ceres.trust_region") {
    const bool dogleg = parameters.string("strategy") == "dogleg";
    const bool iterative = parameters.string("linear_solver") == "cgnr";
    if (dogleg && iterative) {
      throw UsageError(
          "nonlinear backend 'ceres.trust_region': strategy dogleg needs linear_solver sparse_normal_cholesky");
    }
    options_.trust_region_strategy_type = dogleg ? ceres::DOGLEG : ceres::LEVENBERG_MARQUARDT;
    options_.linear_solver_type = iterative ? ceres::CGNR : ceres::SPARSE_NORMAL_CHOLESKY;
    options_.preconditioner_type = ceres::JACOBI;
    options_.max_linear_solver_iterations = 1000;
    options_.max_num_iterations = std::numeric_limits<int>::max();
    options_.function_tolerance = options_.gradient_tolerance = options_.parameter_tolerance = 0.0;
    options_.max_num_consecutive_invalid_steps = 50;  // a barrier takes some
    options_.logging_type = ceres::SILENT;
    options_.update_state_every_iteration = true;
  }

 protected:
  std::string optimize(const ScaledObjective& objective) override {
    error_ = {};
    objective_ = &objective;
    x_ = objective.start();
    StackedResidual all(objective, x_, error_);
    ceres::Problem::Options ownership;
    ownership.evaluation_callback = &all;
    ceres::Problem problem(ownership);
    add_blocks(problem, all);
    if (problem.NumResidualBlocks() == 0) return "no residual depends on a variable";
    ceres::Solver::Options options = options_;
    options.callbacks.push_back(this);
    ceres::Solver::Summary summary;
    const QuietCeres quiet;
    ceres::Solve(options, &problem, &summary);
    rethrow();
    return summary.message;
  }

 private:
  // A parameter block per vertex and a residual block per cell and facet, found in the pattern of the Jacobian alone.
  // Rows that see no variable are constant and left out.
  void add_blocks(ceres::Problem& problem, const StackedResidual& all) {
    const RowMatrix& J = all.jacobian();
    const std::vector<Index> starts = variable_blocks(J);
    std::vector<Index> block_of(J.cols());
    for (std::size_t b = 0; b + 1 < starts.size(); ++b) {
      std::fill(block_of.begin() + starts[b], block_of.begin() + starts[b + 1], static_cast<Index>(b));
    }
    const auto columns_of = [&](Index i) {
      return std::pair(J.innerIndexPtr() + J.outerIndexPtr()[i], J.innerIndexPtr() + J.outerIndexPtr()[i + 1]);
    };
    std::vector<double*> blocks;
    std::vector<int> sizes;
    for (Index row = 0; row < J.rows();) {
      const auto [begin, end] = columns_of(row);
      Index next = row + 1;
      while (next < J.rows()) {
        const auto [other, other_end] = columns_of(next);
        if (!std::equal(begin, end, other, other_end)) break;
        ++next;
      }
      blocks.clear();
      sizes.clear();
      for (const Index* j = begin; j != end; j += sizes.back()) {
        const Index b = block_of[*j];
        blocks.push_back(x_.data() + starts[b]);
        sizes.push_back(starts[b + 1] - starts[b]);
      }
      if (!blocks.empty()) problem.AddResidualBlock(new Rows(all, row, next - row, sizes), nullptr, blocks);
      row = next;
    }
  }

  bool goes_on(const ceres::IterationSummary& summary) override {
    return summary.step_is_successful ? reached(*objective_, x_) : stayed();
  }

  ceres::Solver::Options options_;
  const ScaledObjective* objective_ = nullptr;
  Eigen::VectorXd x_;
};

}  // namespace
#endif

NonlinearBackendEntry describe_ceres_trust_region() {
  NonlinearBackendEntry entry;
  entry.name = "ceres.trust_region";
  entry.doc = "trust region on the stacked residual, of Ceres; a rejected step is an iteration, too";
  entry.package = "libceres-dev";
  entry.option = "VARIFORM_CERES";
  entry.licence = "GPL-2.0-or-later";  // Ceres itself is BSD-3-Clause; Debian's is linked to SuiteSparse
  entry.parameters = {{.name = "strategy",
                       .value = std::string("levenberg_marquardt"),
                       .doc = "how a step fits the trust region",
                       .choices = {"levenberg_marquardt", "dogleg"}},
                      {.name = "linear_solver",
                       .value = std::string("sparse_normal_cholesky"),
                       .doc = "for the step; cgnr: conjugate gradients with block Jacobi preconditioner, inexact",
                       .choices = {"sparse_normal_cholesky", "cgnr"}}};
#ifdef VARIFORM_WITH_CERES
  entry.make = [](const Parameters& p) { return std::make_unique<CeresTrustRegion>(p); };
#endif
  return entry;
}

}  // namespace variform
