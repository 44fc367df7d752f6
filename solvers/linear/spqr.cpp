// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/linear_backends.h"

#ifdef VARIFORM_WITH_SUITESPARSE
#include <SuiteSparseQR.hpp>
#include <fmt/format.h>

#include "solvers/linear/suitesparse.h"
#endif

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.least_squares = true};

#ifdef VARIFORM_WITH_SUITESPARSE

std::string ordering_name(SuiteSparse_long ordering) {
  switch (ordering) {
    case SPQR_ORDERING_FIXED:
    case SPQR_ORDERING_NATURAL: return "natural";
    case SPQR_ORDERING_COLAMD: return "COLAMD";
    case SPQR_ORDERING_AMD: return "AMD";
    case SPQR_ORDERING_METIS: return "METIS";
    default: return fmt::format("ordering {}", ordering);
  }
}

class Spqr final : public LinearBackend {
 public:
  explicit Spqr(std::string name) : LinearBackend(std::move(name)) {}
  ~Spqr() override { free_factorization(); }

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void free_factorization() { SuiteSparseQR_free<double>(&qr_, common_.get()); }

  cholmod_sparse view() const { return cholmod_view(matrix(), column_pointers_.data(), rows_.data(), 0); }

  void do_analyze() override {
    free_factorization();
    common_->memory_usage = common_->memory_inuse;
    const SparseMatrix& A = matrix();
    column_pointers_.assign(A.outerIndexPtr(), A.outerIndexPtr() + A.cols() + 1);
    rows_.assign(A.innerIndexPtr(), A.innerIndexPtr() + A.nonZeros());
    cholmod_sparse all = view();
    qr_ = SuiteSparseQR_symbolic<double>(SPQR_ORDERING_DEFAULT, /*allow_tol=*/1, &all, common_.get());
    check("analysis");
    mutable_report().ordering = ordering_name(common_->SPQR_istat[7]);
    mutable_report().nnz_factor = common_->SPQR_istat[0];  // both are upper bounds
    mutable_report().flops = common_->SPQR_flopcount_bound;
  }

  void do_factorize() override {
    cholmod_sparse all = view();
    SuiteSparseQR_numeric<double>(SPQR_DEFAULT_TOL, &all, qr_, common_.get());
    check("factorization");
    if (qr_->rank < matrix().cols()) {
      fail(fmt::format("the {} x {} matrix has rank {}, full column rank is needed", matrix().rows(), matrix().cols(),
                       qr_->rank));
    }
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    cholmod_dense right = cholmod_view(B);
    cholmod_dense* rotated = SuiteSparseQR_qmult<double>(SPQR_QTX, qr_, &right, common_.get());
    check("solve");
    cholmod_dense* solution = SuiteSparseQR_solve<double>(SPQR_RETX_EQUALS_B, qr_, rotated, common_.get());
    cholmod_l_free_dense(&rotated, common_.get());
    check("solve");
    X = eigen_view(*solution);
    cholmod_l_free_dense(&solution, common_.get());
  }

  void check(const char* phase) {
    mutable_report().peak_memory = static_cast<double>(common_->memory_usage);
    if (const std::string error = common_.error(); !error.empty()) {
      fail(fmt::format("SPQR {} of the {} x {} matrix: {}", phase, matrix().rows(), matrix().cols(), error));
    }
  }

  CholmodCommon<SuiteSparse_long> common_;
  std::vector<SuiteSparse_long> column_pointers_;
  std::vector<SuiteSparse_long> rows_;
  SuiteSparseQR_factorization<double>* qr_ = nullptr;
};

#endif

}  // namespace

LinearBackendEntry describe_spqr() {
  LinearBackendEntry entry;
  entry.name = "spqr";
  entry.doc = "multifrontal QR by BLAS: least squares without squaring the condition number";
  entry.capabilities = kCapabilities;
  entry.package = "libsuitesparse-dev";
  entry.option = "VARIFORM_SUITESPARSE";
  entry.licence = "GPL-2.0-or-later";
#ifdef VARIFORM_WITH_SUITESPARSE
  entry.make = [name = entry.name](const Parameters&) { return std::make_unique<Spqr>(name); };
#endif
  return entry;
}

}  // namespace variform
