// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/cholmod_backend.h"

#ifdef VARIFORM_WITH_SUITESPARSE
#include <fmt/format.h>

#include <array>
#include <string>

#include "framework/base/parallel.h"
#include "solvers/linear/suitesparse.h"
#endif

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.spd = true};

#ifdef VARIFORM_WITH_SUITESPARSE

std::string ordering_name(int ordering) {
  switch (ordering) {
    case CHOLMOD_NATURAL: return "natural";
    case CHOLMOD_AMD: return "AMD";
    case CHOLMOD_METIS: return "METIS";
    case CHOLMOD_NESDIS: return "NESDIS";
    case CHOLMOD_COLAMD: return "COLAMD";
    case CHOLMOD_POSTORDERED: return "natural, postordered";
    default: return fmt::format("ordering {}", ordering);
  }
}

class CholmodBackend final : public LinearBackend {
 public:
  CholmodBackend(std::string name, CholmodMethod method) : LinearBackend(std::move(name)) {
    common_->supernodal = method == CholmodMethod::supernodal ? CHOLMOD_SUPERNODAL : CHOLMOD_SIMPLICIAL;
  }

  ~CholmodBackend() override { free_factor(); }

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void free_factor() { cholmod_free_factor(&factor_, common_.get()); }

  cholmod_sparse view() const {
    return cholmod_view<int>(matrix(), matrix().outerIndexPtr(), matrix().innerIndexPtr(), -1);
  }

  void do_analyze() override {
    free_factor();
    common_->memory_usage = common_->memory_inuse;
    cholmod_sparse A = view();
    factor_ = cholmod_analyze(&A, common_.get());
    check("analysis");
    mutable_report().ordering = ordering_name(factor_->ordering);
    mutable_report().nnz_factor = static_cast<std::int64_t>(common_->lnz);
    mutable_report().flops = common_->fl;
  }

  void do_factorize() override {
    cholmod_sparse A = view();
    cholmod_factorize(&A, factor_, common_.get());
    check("factorization");
    if (factor_->minor < factor_->n) {
      fail(fmt::format("the matrix is not positive definite: the factorization stops at unknown {} of {}",
                       unknown(factor_->minor), factor_->n));
    }
    if (!factor_->is_ll) check_pivots();
  }

  /// LDL' goes through with negative pivots.
  void check_pivots() const {
    const int* start = static_cast<const int*>(factor_->p);
    const double* values = static_cast<const double*>(factor_->x);
    for (std::size_t k = 0; k < factor_->n; ++k) {
      const double pivot = values[start[k]];
      if (!(pivot > 0.0)) {
        fail(fmt::format("the matrix is not positive definite: pivot {:.3g} at unknown {} of {}", pivot, unknown(k),
                         factor_->n));
      }
    }
  }

  int unknown(std::size_t k) const { return static_cast<const int*>(factor_->Perm)[k]; }

  // Right-hand sides in two halves at a time: a few columns are bound by one core, not by memory. The halves do not
  // depend on the number of threads, so neither do the bits of the solution.
  Eigen::MatrixXd do_solve(const Eigen::MatrixXd& B) override {
    const Eigen::Index split = (B.cols() + 1) / 2;
    Eigen::MatrixXd X(B.rows(), B.cols());
    std::array<std::string, 2> errors;
    const auto solve_half = [&](int half) {
      const Eigen::Index from = half == 0 ? 0 : split;
      const Eigen::Index count = half == 0 ? split : B.cols() - split;
      if (count == 0) return;
      SolveSpace& space = spaces_[half];
      cholmod_dense right = cholmod_view(B, from, count);
      cholmod_solve2(CHOLMOD_A, factor_, &right, nullptr, &space.X, nullptr, &space.Y, &space.E, space.common.get());
      errors[half] = space.common.error();
      if (errors[half].empty()) X.middleCols(from, count) = eigen_view(*space.X);
    };
    parallel_for(
        2, [&](Index half) { solve_half(half); }, 1);
    for (const std::string& error : errors) refuse("solve", error);
    return X;
  }

  void check(const char* phase) {
    mutable_report().peak_memory = static_cast<double>(common_->memory_usage);
    refuse(phase, common_.error());
  }

  void refuse(const char* phase, const std::string& error) const {
    if (error.empty()) return;
    fail(fmt::format("CHOLMOD {} of the {} x {} matrix: {}", phase, matrix().rows(), matrix().cols(), error));
  }

  // Solution and workspaces of one half, kept between solves.
  struct SolveSpace {
    ~SolveSpace() {
      for (cholmod_dense** work : {&X, &Y, &E}) cholmod_free_dense(work, common.get());
    }
    CholmodCommon<int> common;
    cholmod_dense* X = nullptr;
    cholmod_dense* Y = nullptr;
    cholmod_dense* E = nullptr;
  };

  CholmodCommon<int> common_;
  cholmod_factor* factor_ = nullptr;
  std::array<SolveSpace, 2> spaces_;
};

#endif

}  // namespace

LinearBackendEntry describe_cholmod(CholmodMethod method) {
  LinearBackendEntry entry;
  entry.name = method == CholmodMethod::supernodal ? "cholmod.supernodal" : "cholmod.simplicial";
  entry.capabilities = kCapabilities;
  entry.package = "libsuitesparse-dev";
  entry.option = "VARIFORM_SUITESPARSE";
#ifdef VARIFORM_WITH_SUITESPARSE
  entry.make = [name = entry.name, method](const Parameters&) {
    return std::make_unique<CholmodBackend>(name, method);
  };
#endif
  return entry;
}

}  // namespace variform
