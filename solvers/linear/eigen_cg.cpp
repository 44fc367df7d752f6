// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/IterativeLinearSolvers>
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "framework/base/error.h"
#include "solvers/linear/iterative.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/linear/preconditioner.h"

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.spd = true, .direct = false};

constexpr const char* kMultigrid = "boomeramg";

/// One of Eigen's preconditioners.
template <class Inverse>
class EigenPreconditioner final : public Preconditioner {
 public:
  void analyze(const SparseMatrix& A) override { inverse_.analyzePattern(A); }
  void factorize(const SparseMatrix& A) override {
    inverse_.factorize(A);
    if (inverse_.info() != Eigen::Success) {
      throw SolverError(fmt::format("the preconditioner of the {} x {} matrix broke down", A.rows(), A.cols()));
    }
    nonzeros_ = 2 * A.nonZeros();  // the incomplete factor, and Eigen's lists of its columns
    rows_ = A.rows();
  }
  void apply(const Vector& r, Vector& z) override { z = inverse_.solve(r); }
  double bytes() const override {
    constexpr bool kIncomplete = !std::is_same_v<Inverse, Eigen::DiagonalPreconditioner<double>> &&
                                 !std::is_same_v<Inverse, Eigen::IdentityPreconditioner>;
    const double entry = sizeof(double) + sizeof(Index);
    return kIncomplete ? entry * static_cast<double>(nonzeros_) / 2 : sizeof(double) * static_cast<double>(rows_);
  }

 private:
  Inverse inverse_;
  Eigen::Index nonzeros_ = 0;
  Eigen::Index rows_ = 0;
};

struct CgOptions {
  double tolerance;
  Index max_iterations;
};

class ConjugateGradients final : public LinearBackend {
 public:
  ConjugateGradients(std::string name, const CgOptions& options, std::unique_ptr<Preconditioner> preconditioner)
      : LinearBackend(std::move(name)), options_(options), preconditioner_(std::move(preconditioner)) {}

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void do_analyze() override { preconditioner_->analyze(matrix()); }

  void do_factorize() override {
    if (const std::string wrong = wrong_diagonal(matrix()); !wrong.empty()) fail(wrong);
    preconditioner_->factorize(matrix());
    const double preconditioner = preconditioner_->bytes();
    if (preconditioner >= 0.0) {
      constexpr int kVectors = 6;  // b, x, r, z, p, A p
      mutable_report().peak_memory = preconditioner + kVectors * sizeof(double) * static_cast<double>(matrix().cols()) +
                                     (sizeof(double) + sizeof(Index)) * static_cast<double>(matrix().nonZeros());
    }
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    const Index limit = options_.max_iterations > 0 ? options_.max_iterations : std::max<Index>(2 * matrix().cols(), 2);
    double largest = 0.0;
    for (Index j = 0; j < B.cols(); ++j) {
      const std::vector<double> history = iterate(B.col(j), limit, X.col(j));
      const auto iterations = static_cast<Index>(history.size()) - 1;
      LinearReport& report = mutable_report();
      if (j == 0 || iterations > report.iterations) report.residual_history = history;
      report.iterations = std::max(report.iterations, iterations);
      largest = std::max(largest, history.back());
      if (!(history.back() <= options_.tolerance)) {
        fail(fmt::format(
            "no convergence for column {} of {} after {} iterations: relative residual {:.3g}, tolerance {:.3g}", j,
            B.cols(), iterations, history.back(), options_.tolerance));
      }
    }
    mutable_report().reason = fmt::format("reached relative residual {:.3g}", largest);
  }

  /// Preconditioned conjugate gradients (Hestenes and Stiefel 1952) from 0; returns the relative residuals.
  std::vector<double> iterate(const Vector& b, Index limit, Eigen::Ref<Vector> x) {
    const auto A = matrix().selfadjointView<Eigen::Lower>();
    x.setZero();
    const double size = b.norm();
    if (size == 0.0) return {0.0};
    Vector r = b;
    Vector z(b.size());
    Vector p = Vector::Zero(b.size());
    Vector Ap(b.size());
    double before = 1.0;
    std::vector<double> history = {1.0};
    while (history.back() > options_.tolerance && static_cast<Index>(history.size()) <= limit) {
      preconditioner_->apply(r, z);
      const double rz = r.dot(z);
      p = z + (rz / before) * p;
      before = rz;
      Ap.noalias() = A * p;
      const double curvature = p.dot(Ap);
      if (!(curvature > 0.0 && rz > 0.0)) {
        fail(
            fmt::format("the matrix or its preconditioner is not positive definite: p'Ap = {:.3g}, r'z = {:.3g} after "
                        "{} iterations, relative residual {:.3g}",
                        curvature, rz, history.size() - 1, history.back()));
      }
      const double step = rz / curvature;
      x += step * p;
      r -= step * Ap;
      history.push_back(r.norm() / size);
    }
    return history;
  }

  CgOptions options_;
  std::unique_ptr<Preconditioner> preconditioner_;
};

std::unique_ptr<Preconditioner> make_preconditioner(const Parameters& parameters) {
  const std::string& name = parameters.string("preconditioner");
  if (name == "amg") {
    return make_multigrid({parameters.string("multigrid"), static_cast<Index>(parameters.integer("block_size")),
                           parameters.string("multigrid_options")});
  }
  const auto refuse = [&name](const char* option) {
    throw UsageError(
        fmt::format("linear backend 'eigen.cg': {} is for preconditioner = \"amg\", not \"{}\"", option, name));
  };
  if (parameters.string("multigrid") != kMultigrid) refuse("multigrid");
  if (parameters.integer("block_size") != 1) refuse("block_size");
  if (!parameters.string("multigrid_options").empty()) refuse("multigrid_options");
  if (name == "incomplete_cholesky") {
    // Natural ordering: a fill-reducing one costs iterations here, as no fill is allowed anyway. Where a pivot breaks
    // down, Eigen shifts the diagonal until none does.
    using Incomplete = Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<Index>>;
    return std::make_unique<EigenPreconditioner<Incomplete>>();
  }
  if (name == "none") return std::make_unique<EigenPreconditioner<Eigen::IdentityPreconditioner>>();
  return std::make_unique<EigenPreconditioner<Eigen::DiagonalPreconditioner<double>>>();
}

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
       .doc = "approximate inverse that speeds up convergence; amg is algebraic multigrid and needs PETSc",
       .choices = {"diagonal", "incomplete_cholesky", "amg", "none"}},
      tolerance_parameter(),
      limit_parameter(),
      {.name = "multigrid",
       .value = std::string(kMultigrid),
       .doc = "amg only: hypre's classical coarsening or PETSc's smoothed aggregation",
       .choices = {"boomeramg", "gamg"}},
      {.name = "block_size",
       .value = std::int64_t{1},
       .doc = "amg only: unknowns per vertex, d for coupled energies",
       .min = 1.0,
       .max = 64.0},
      {.name = "multigrid_options",
       .value = std::string(),
       .doc = "amg only: options of PETSc, as \"-pc_hypre_boomeramg_strong_threshold 0.5\""},
  };
  entry.make = [name = entry.name](const Parameters& parameters) -> std::unique_ptr<LinearBackend> {
    const CgOptions options{parameters.number("tolerance"), static_cast<Index>(parameters.integer("max_iterations"))};
    return std::make_unique<ConjugateGradients>(name, options, make_preconditioner(parameters));
  };
  return entry;
}

}  // namespace variform
