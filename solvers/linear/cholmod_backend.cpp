// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/cholmod_backend.h"

#ifdef VARIFORM_WITH_SUITESPARSE
#include <fmt/format.h>

#include <array>
#include <string>
#include <vector>

#include "framework/base/parallel.h"
#include "solvers/linear/hermitian_matrix.h"
#include "solvers/linear/suitesparse.h"
#endif

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.spd = true, .update = true};

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

  ~CholmodBackend() override { free_factors(); }

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void free_factors() {
    cholmod_free_factor(&factor_, common_.get());
    cholmod_free_factor(&symbolic_, common_.get());
  }

  // The matrix that is factorized: K, or the Hermitian one of half its order that it stands for.
  cholmod_sparse view() const {
    if (!complex_) return cholmod_view<int>(matrix(), matrix().outerIndexPtr(), matrix().innerIndexPtr(), -1);
    cholmod_sparse view{};
    view.nrow = view.ncol = static_cast<std::size_t>(hermitian_.size());
    view.nzmax = hermitian_.rows().size();
    view.p = const_cast<int*>(hermitian_.column_pointers().data());
    view.i = const_cast<int*>(hermitian_.rows().data());
    view.x = const_cast<double*>(hermitian_.values().data());
    view.stype = -1;
    view.itype = CHOLMOD_INT;
    view.xtype = CHOLMOD_COMPLEX;
    view.dtype = CHOLMOD_DOUBLE;
    view.sorted = 1;
    view.packed = 1;
    return view;
  }

  // A block of right-hand sides. Pairs of real unknowns are complex ones in memory.
  cholmod_dense view(const Eigen::MatrixXd& B, Eigen::Index from, Eigen::Index count) const {
    cholmod_dense view = cholmod_view(B, from, count);
    if (!complex_) return view;
    view.nrow /= 2;
    view.nzmax /= 2;
    view.d /= 2;
    view.xtype = CHOLMOD_COMPLEX;
    return view;
  }

  void do_analyze() override {
    complex_ = hermitian_.analyze(matrix());
    analyze_pattern();
  }

  void analyze_pattern() {
    free_factors();
    common_->memory_usage = common_->memory_inuse;
    cholmod_sparse A = view();
    factor_ = cholmod_analyze(&A, common_.get());
    check("analysis");
    symbolic_ = cholmod_copy_factor(factor_, common_.get());
    check("analysis");
    modified_ = false;
    // An entry of a complex factor is two numbers; a multiplication of complex numbers is four.
    mutable_report().ordering = ordering_name(factor_->ordering) + (complex_ ? ", complex" : "");
    mutable_report().nnz_factor = static_cast<std::int64_t>((complex_ ? 2.0 : 1.0) * common_->lnz);
    mutable_report().flops = (complex_ ? 4.0 : 1.0) * common_->fl;
  }

  void do_factorize() override {
    if (complex_ && !hermitian_.update(matrix())) {
      complex_ = false;
      analyze_pattern();
    }
    if (modified_ || (symbolic_->is_super && !factor_->is_super)) {
      cholmod_free_factor(&factor_, common_.get());
      factor_ = cholmod_copy_factor(symbolic_, common_.get());
      check("restoring of the analysis");
      modified_ = false;
    }
    solves_ = 0;
    cholmod_sparse A = view();
    cholmod_factorize(&A, factor_, common_.get());
    check("factorization");
    if (factor_->minor < factor_->n) {
      fail(fmt::format("the matrix is not positive definite: the factorization stops at unknown {} of {}",
                       unknown(factor_->minor), matrix().rows()));
    }
    if (!factor_->is_ll) check_pivots();
  }

  /// LDL' goes through with negative pivots.
  void check_pivots() const {
    const int* start = static_cast<const int*>(factor_->p);
    const double* values = static_cast<const double*>(factor_->x);
    for (std::size_t k = 0; k < factor_->n; ++k) {
      const double pivot = values[(complex_ ? 2 : 1) * start[k]];
      if (!(pivot > 0.0)) {
        fail(fmt::format("the matrix is not positive definite: pivot {:.3g} at unknown {} of {}", pivot, unknown(k),
                         matrix().rows()));
      }
    }
  }

  // Rows of the factor are those of the matrix in the fill-reducing order; CHOLMOD makes it LDL' itself. A factor of
  // the Hermitian matrix is of no use here.
  void prepare_update() {
    if (complex_) {
      complex_ = false;
      analyze_pattern();
      do_factorize();
    }
    if (!modified_) {
      place_.resize(factor_->n);
      for (std::size_t k = 0; k < factor_->n; ++k) {
        place_[static_cast<std::size_t>(static_cast<const int*>(factor_->Perm)[k])] = static_cast<int>(k);
      }
    }
    modified_ = true;
  }

  void do_update(const SparseMatrix& C, int sign) override {
    if (complex_) {  // the matrix is the updated one already
      complex_ = false;
      analyze_pattern();
      do_factorize();
      return;
    }
    prepare_update();
    SparseMatrix permuted(C.rows(), C.cols());
    std::vector<Eigen::Triplet<double, Index>> triplets;
    for (Index j = 0; j < C.cols(); ++j) {
      for (SparseMatrix::InnerIterator entry(C, j); entry; ++entry) {
        triplets.emplace_back(place_[static_cast<std::size_t>(entry.row())], j, entry.value());
      }
    }
    permuted.setFromTriplets(triplets.begin(), triplets.end());
    cholmod_sparse columns = cholmod_view<int>(permuted, permuted.outerIndexPtr(), permuted.innerIndexPtr(), 0);
    cholmod_updown(sign > 0 ? 1 : 0, &columns, factor_, common_.get());
    check("update");
    if (factor_->minor < factor_->n) fail("the updated matrix is not positive definite");
    check_pivots();
  }

  void do_hold(Index unknown) override {
    prepare_update();
    cholmod_rowdel(static_cast<std::size_t>(place_[static_cast<std::size_t>(unknown)]), nullptr, factor_,
                   common_.get());
    check("update");
  }

  void do_release(Index unknown, const SparseRow& row) override {
    prepare_update();
    const auto k = static_cast<std::size_t>(place_[static_cast<std::size_t>(unknown)]);
    SparseMatrix column(matrix().rows(), 1);
    std::vector<Eigen::Triplet<double, Index>> triplets;
    for (const auto& [i, value] : row) triplets.emplace_back(place_[static_cast<std::size_t>(i)], 0, value);
    column.setFromTriplets(triplets.begin(), triplets.end());
    cholmod_sparse view = cholmod_view<int>(column, column.outerIndexPtr(), column.innerIndexPtr(), 0);
    cholmod_rowadd(k, &view, factor_, common_.get());
    check("update");
    check_pivots();
  }

  int unknown(std::size_t k) const { return (complex_ ? 2 : 1) * static_cast<const int*>(factor_->Perm)[k]; }

  // Dense blocks pay for the zeros that they store with many columns only: a factorization that is used again and again
  // with a few becomes a simplicial one, whose solves take half the time.
  void prepare_factor(Eigen::Index columns) {
    constexpr Eigen::Index kFewColumns = 3;
    constexpr int kLdl = 0;
    constexpr int kSimplicial = 0;
    constexpr int kPacked = 1;
    constexpr int kMonotonic = 1;
    if (!factor_->is_super || complex_ || columns > kFewColumns || ++solves_ < 2) return;
    cholmod_change_factor(factor_->xtype, kLdl, kSimplicial, kPacked, kMonotonic, factor_, common_.get());
    cholmod_sparse A = view();
    cholmod_resymbol(&A, nullptr, 0, kPacked, factor_, common_.get());  // without the zeros
    check("conversion of the factor");
  }

  // Right-hand sides in two halves at a time: a few columns are bound by one core, not by memory. The halves do not
  // depend on the number of threads, so neither do the bits of the solution.
  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    prepare_factor(B.cols());
    const Eigen::Index split = (B.cols() + 1) / 2;
    std::array<std::string, 2> errors;
    const auto solve_half = [&](int half) {
      const Eigen::Index from = half == 0 ? 0 : split;
      const Eigen::Index count = half == 0 ? split : B.cols() - split;
      if (count == 0) return;
      SolveSpace& space = spaces_[half];
      cholmod_dense right = view(B, from, count);
      cholmod_solve2(CHOLMOD_A, factor_, &right, nullptr, &space.X, nullptr, &space.Y, &space.E, space.common.get());
      errors[half] = space.common.error();
      if (errors[half].empty()) {
        X.middleCols(from, count) =
            Eigen::Map<const Eigen::MatrixXd>(static_cast<const double*>(space.X->x), X.rows(), count);
      }
    };
    parallel_for(
        2, [&](Index half) { solve_half(half); }, 1);
    for (const std::string& error : errors) refuse("solve", error);
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
  HermitianMatrix hermitian_;
  bool complex_ = false;  // hermitian_ is factorized in place of the matrix
  cholmod_factor* factor_ = nullptr;
  cholmod_factor* symbolic_ = nullptr;  // the analysis, which conversions and updates of the factor lose
  bool modified_ = false;               // by updates
  std::vector<int> place_;              // unknown -> row of the factor, once modified
  int solves_ = 0;                      // with a few columns, since the last factorization
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
