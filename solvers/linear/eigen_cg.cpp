// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/IterativeLinearSolvers>
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "solvers/linear/linear_backends.h"

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.spd = true, .direct = false};

struct CgOptions {
  double tolerance;
  Index max_iterations;
};

template <class Preconditioner>
class ConjugateGradients final : public LinearBackend {
 public:
  ConjugateGradients(std::string name, const CgOptions& options) : LinearBackend(std::move(name)), options_(options) {
    solver_.setTolerance(options.tolerance);
  }

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void do_analyze() override { solver_.analyzePattern(matrix()); }

  void do_factorize() override {
    // The method itself notices nothing; this finds matrices of the wrong sign and rows that were never filled.
    const Vector diagonal = matrix().diagonal();
    Index worst = 0;
    if (!(diagonal.minCoeff(&worst) > 0.0)) {
      fail(fmt::format("the matrix is not positive definite: diagonal entry {:.3g} at unknown {} of {}",
                       diagonal[worst], worst, diagonal.size()));
    }
    solver_.factorize(matrix());
    if (solver_.info() != Eigen::Success) {
      fail(fmt::format("the preconditioner of the {} x {} matrix broke down", matrix().rows(), matrix().cols()));
    }
    solver_.setMaxIterations(options_.max_iterations > 0 ? options_.max_iterations : 2 * matrix().cols());
  }

  Eigen::MatrixXd do_solve(const Eigen::MatrixXd& B) override {
    Eigen::MatrixXd X(B.rows(), B.cols());
    Index iterations = 0;
    double error = 0.0;
    for (Index j = 0; j < B.cols(); ++j) {
      X.col(j) = solver_.solve(B.col(j));
      iterations = std::max(iterations, static_cast<Index>(solver_.iterations()));
      error = std::max(error, solver_.error());
      mutable_report().iterations = iterations;
      if (solver_.info() != Eigen::Success) {
        fail(fmt::format(
            "no convergence for column {} of {} after {} iterations: relative residual {:.3g}, tolerance {:.3g}", j,
            B.cols(), solver_.iterations(), solver_.error(), options_.tolerance));
      }
    }
    mutable_report().reason = fmt::format("reached relative residual {:.3g}", error);
    return X;
  }

  CgOptions options_;
  Eigen::ConjugateGradient<SparseMatrix, Eigen::Lower, Preconditioner> solver_;
};

}  // namespace

LinearBackendEntry describe_eigen_cg() {
  LinearBackendEntry entry;
  entry.name = "eigen.cg";
  entry.doc = "preconditioned conjugate gradients: little memory, accuracy as asked";
  entry.capabilities = kCapabilities;
  entry.licence = "MPL-2.0";
  entry.parameters = {
      {.name = "preconditioner",
       .value = std::string("diagonal"),
       .doc = "approximate inverse that speeds up convergence",
       .choices = {"diagonal", "incomplete_cholesky", "none"}},
      {.name = "tolerance", .value = 1e-10, .doc = "relative residual to stop at", .min = 1e-16, .max = 1.0},
      {.name = "max_iterations",
       .value = std::int64_t{0},
       .doc = "per right-hand side; 0: twice the number of unknowns",
       .min = 0.0,
       .max = 1e9},
  };
  entry.make = [name = entry.name](const Parameters& parameters) -> std::unique_ptr<LinearBackend> {
    const CgOptions options{parameters.number("tolerance"), static_cast<Index>(parameters.integer("max_iterations"))};
    const std::string& preconditioner = parameters.string("preconditioner");
    if (preconditioner == "incomplete_cholesky") {
      // Natural ordering: a fill-reducing one costs iterations here, as no fill is allowed anyway.
      using Incomplete = Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<Index>>;
      return std::make_unique<ConjugateGradients<Incomplete>>(name, options);
    }
    if (preconditioner == "none") {
      return std::make_unique<ConjugateGradients<Eigen::IdentityPreconditioner>>(name, options);
    }
    return std::make_unique<ConjugateGradients<Eigen::DiagonalPreconditioner<double>>>(name, options);
  };
  return entry;
}

}  // namespace variform
