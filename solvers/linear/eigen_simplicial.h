// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/SparseCholesky>
#include <fmt/format.h>

#include <string>
#include <type_traits>
#include <utility>

#include "framework/solver/linear_backend.h"

namespace variform {

/// Eigen's SimplicialLLT or SimplicialLDLT as a backend for positive definite matrices.
template <class Factorization>
class EigenSimplicial final : public LinearBackend {
 public:
  explicit EigenSimplicial(std::string name) : LinearBackend(std::move(name)) {}

  LinearCapabilities capabilities() const override { return {.spd = true}; }

 private:
  /// LDL' does not store the unit diagonal of L.
  static constexpr bool kUnitDiagonal =
      (std::decay_t<decltype(std::declval<Factorization>().matrixL())>::Mode & Eigen::UnitDiag) != 0;

  void do_analyze() override {
    factorization_.analyzePattern(matrix());
    mutable_report().ordering = "AMD";
  }

  void do_factorize() override {
    factorization_.factorize(matrix());
    if constexpr (kUnitDiagonal) {
      // Eigen's LDL' goes through with negative pivots.
      const auto& pivots = factorization_.vectorD();
      for (Index k = 0; k < pivots.size(); ++k) {
        if (!(pivots[k] > 0.0)) {
          fail(fmt::format("the matrix is not positive definite: pivot {:.3g} at unknown {} of {}", pivots[k],
                           factorization_.permutationPinv().indices()[k], matrix().cols()));
        }
      }
    }
    if (factorization_.info() != Eigen::Success) {
      fail(fmt::format("the {} x {} matrix is not positive definite", matrix().rows(), matrix().cols()));
    }
    count();
  }

  void count() {
    const auto& L = factorization_.matrixL().nestedExpression();
    double flops = 0.0;
    for (Index j = 0; j < L.cols(); ++j) {
      const double column = L.outerIndexPtr()[j + 1] - L.outerIndexPtr()[j] + (kUnitDiagonal ? 1 : 0);
      flops += column * column;
    }
    mutable_report().nnz_factor = L.outerIndexPtr()[L.cols()] + (kUnitDiagonal ? L.cols() : 0);
    mutable_report().flops = flops;
    const double entry = sizeof(double) + sizeof(Index);  // of the factor, and of the permuted matrix beside it
    mutable_report().peak_memory =
        entry * (static_cast<double>(mutable_report().nnz_factor) + static_cast<double>(matrix().nonZeros()));
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override { X = factorization_.solve(B); }

  Factorization factorization_;
};

}  // namespace variform
