// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/SparseLU>
#include <fmt/format.h>

#include "solvers/linear/full_matrix.h"
#include "solvers/linear/linear_backends.h"

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.symmetric_indefinite = true, .general = true};

class EigenLu final : public LinearBackend {
 public:
  explicit EigenLu(std::string name) : LinearBackend(std::move(name)) {}

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void do_analyze() override {
    full_.analyze(matrix(), kind());
    lu_.analyzePattern(full_.update(matrix()));
    mutable_report().ordering = "COLAMD";
  }

  void do_factorize() override {
    lu_.factorize(full_.update(matrix()));
    if (lu_.info() != Eigen::Success) {
      std::string message = lu_.lastErrorMessage();
      while (!message.empty() && message.back() == '\n') message.pop_back();
      fail(fmt::format("the {} x {} matrix is singular: {}", matrix().rows(), matrix().cols(), message));
    }
    mutable_report().nnz_factor = lu_.nnzL() + lu_.nnzU();
    mutable_report().peak_memory = (sizeof(double) + sizeof(Index)) * static_cast<double>(lu_.nnzL() + lu_.nnzU());
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override { X = lu_.solve(B); }

  FullMatrix full_;
  Eigen::SparseLU<SparseMatrix, Eigen::COLAMDOrdering<Index>> lu_;
};

}  // namespace

LinearBackendEntry describe_eigen_lu() {
  LinearBackendEntry entry;
  entry.name = "eigen.lu";
  entry.doc = "sparse LU with partial pivoting";
  entry.capabilities = kCapabilities;
  entry.licence = "MPL-2.0";
  entry.make = [name = entry.name](const Parameters&) { return std::make_unique<EigenLu>(name); };
  return entry;
}

}  // namespace variform
