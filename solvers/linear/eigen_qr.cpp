// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/SparseQR>
#include <fmt/format.h>

#include "solvers/linear/full_matrix.h"
#include "solvers/linear/linear_backends.h"

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.symmetric_indefinite = true, .general = true, .least_squares = true};

/// Eigen's factorization, with a count of what it did.
class CountedQr : public Eigen::SparseQR<SparseMatrix, Eigen::COLAMDOrdering<Index>> {
 public:
  /// Reflector k, of q entries, was applied to the columns that have an entry in row k of R: 4 q operations each.
  double flops() const {
    double sum = 0.0;
    for (Index j = 0; j < m_R.cols(); ++j) {
      for (typename QRMatrixType::InnerIterator entry(m_R, j); entry; ++entry) {
        const auto k = entry.row();
        sum += 4.0 * static_cast<double>(m_Q.outerIndexPtr()[k + 1] - m_Q.outerIndexPtr()[k]);
      }
    }
    return sum;
  }
  double bytes() const {
    return (sizeof(double) + sizeof(Index)) * static_cast<double>(m_R.nonZeros() + m_Q.nonZeros() + m_pmat.nonZeros());
  }
};

class EigenQr final : public LinearBackend {
 public:
  explicit EigenQr(std::string name) : LinearBackend(std::move(name)) {}

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  const SparseMatrix& all() { return kind() == MatrixKind::least_squares ? matrix() : full_.update(matrix()); }

  void do_analyze() override {
    if (kind() != MatrixKind::least_squares) full_.analyze(matrix(), kind());
    qr_.analyzePattern(all());
    mutable_report().ordering = "COLAMD";
  }

  void do_factorize() override {
    qr_.factorize(all());
    if (qr_.info() != Eigen::Success) {
      fail(fmt::format("QR of the {} x {} matrix: {}", matrix().rows(), matrix().cols(), qr_.lastErrorMessage()));
    }
    if (qr_.rank() < matrix().cols()) {
      fail(fmt::format("the {} x {} matrix is singular: it has rank {}, full column rank is needed", matrix().rows(),
                       matrix().cols(), qr_.rank()));
    }
    mutable_report().nnz_factor = qr_.matrixR().nonZeros();
    mutable_report().flops = qr_.flops();
    mutable_report().peak_memory = qr_.bytes();
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override { X = qr_.solve(B); }

  FullMatrix full_;
  CountedQr qr_;
};

}  // namespace

LinearBackendEntry describe_eigen_qr() {
  LinearBackendEntry entry;
  entry.name = "eigen.qr";
  entry.doc = "sparse QR, column by column: least squares, and square systems that LU finds hard; slow";
  entry.capabilities = kCapabilities;
  entry.licence = "MPL-2.0";
  entry.make = [name = entry.name](const Parameters&) { return std::make_unique<EigenQr>(name); };
  return entry;
}

}  // namespace variform
