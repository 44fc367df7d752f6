// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/linear_backends.h"

#ifdef VARIFORM_WITH_SUITESPARSE
#include <fmt/format.h>
#include <umfpack.h>

#include <array>

#include "solvers/linear/full_matrix.h"
#endif

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.symmetric_indefinite = true, .general = true};

#ifdef VARIFORM_WITH_SUITESPARSE

class Umfpack final : public LinearBackend {
 public:
  explicit Umfpack(std::string name) : LinearBackend(std::move(name)) {
    umfpack_di_defaults(control_.data());
    control_[UMFPACK_PRL] = 0;
  }

  ~Umfpack() override {
    umfpack_di_free_numeric(&numeric_);
    umfpack_di_free_symbolic(&symbolic_);
  }

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void do_analyze() override {
    umfpack_di_free_numeric(&numeric_);
    umfpack_di_free_symbolic(&symbolic_);
    full_.analyze(matrix(), kind());
    A_ = &full_.update(matrix());
    // Without values: the analysis serves all values with this pattern.
    check("analysis",
          umfpack_di_symbolic(static_cast<int>(A_->rows()), static_cast<int>(A_->cols()), A_->outerIndexPtr(),
                              A_->innerIndexPtr(), nullptr, &symbolic_, control_.data(), info_.data()));
    const bool symmetric = info_[UMFPACK_STRATEGY_USED] == UMFPACK_STRATEGY_SYMMETRIC;
    const int ordering = static_cast<int>(info_[UMFPACK_ORDERING_USED]);
    mutable_report().ordering = ordering == UMFPACK_ORDERING_METIS ? "METIS" : symmetric ? "AMD" : "COLAMD";
  }

  void do_factorize() override {
    umfpack_di_free_numeric(&numeric_);
    A_ = &full_.update(matrix());
    const int status = umfpack_di_numeric(A_->outerIndexPtr(), A_->innerIndexPtr(), A_->valuePtr(), symbolic_,
                                          &numeric_, control_.data(), info_.data());
    if (status == UMFPACK_WARNING_singular_matrix) {
      fail(fmt::format("the {} x {} matrix is singular: {} non-zero pivots", A_->rows(), A_->cols(),
                       static_cast<std::int64_t>(info_[UMFPACK_UDIAG_NZ])));
    }
    check("factorization", status);
    mutable_report().nnz_factor = static_cast<std::int64_t>(info_[UMFPACK_LNZ] + info_[UMFPACK_UNZ]);
    mutable_report().flops = info_[UMFPACK_FLOPS];
    mutable_report().peak_memory = info_[UMFPACK_PEAK_MEMORY] * info_[UMFPACK_SIZE_OF_UNIT];
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    IndexVector indices(A_->rows());
    Vector work(5 * A_->rows());  // iterative refinement needs this much
    for (Index j = 0; j < B.cols(); ++j) {
      check("solve",
            umfpack_di_wsolve(UMFPACK_A, A_->outerIndexPtr(), A_->innerIndexPtr(), A_->valuePtr(), X.col(j).data(),
                              B.col(j).data(), numeric_, control_.data(), info_.data(), indices.data(), work.data()));
    }
  }

  void check(const char* phase, int status) const {
    if (status == UMFPACK_OK) return;
    const std::string error = status == UMFPACK_ERROR_out_of_memory       ? "out of memory"
                              : status == UMFPACK_WARNING_singular_matrix ? "singular"
                                                                          : fmt::format("status {}", status);
    fail(fmt::format("UMFPACK {} of the {} x {} matrix: {}", phase, A_->rows(), A_->cols(), error));
  }

  std::array<double, UMFPACK_CONTROL> control_{};
  std::array<double, UMFPACK_INFO> info_{};
  FullMatrix full_;
  const SparseMatrix* A_ = nullptr;  ///< all entries
  void* symbolic_ = nullptr;
  void* numeric_ = nullptr;
};

#endif

}  // namespace

LinearBackendEntry describe_umfpack() {
  LinearBackendEntry entry;
  entry.name = "umfpack";
  entry.doc = "multifrontal LU by BLAS";
  entry.capabilities = kCapabilities;
  entry.package = "libsuitesparse-dev";
  entry.option = "VARIFORM_SUITESPARSE";
  entry.licence = "GPL-2.0-or-later";
#ifdef VARIFORM_WITH_SUITESPARSE
  entry.make = [name = entry.name](const Parameters&) { return std::make_unique<Umfpack>(name); };
#endif
  return entry;
}

}  // namespace variform
