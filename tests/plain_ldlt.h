// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/solver/linear_backend.h"

namespace variform::testing {

/// L D L' of a small matrix without pivots, in memory of its own: allocates when the size changes only.
class PlainLdlt final : public LinearBackend {
 public:
  PlainLdlt() : LinearBackend("plain") {}
  LinearCapabilities capabilities() const override { return {.spd = true, .symmetric_indefinite = true}; }

 protected:
  void do_analyze() override {}

  void do_factorize() override {
    const Index n = static_cast<Index>(matrix().cols());
    L_.setZero(n, n);
    for (Index j = 0; j < n; ++j) {
      for (SparseMatrix::InnerIterator it(matrix(), j); it; ++it) L_(it.row(), j) = it.value();
    }
    for (Index j = 0; j < n; ++j) {
      for (Index k = 0; k < j; ++k) {
        const double l = L_(j, k) * L_(k, k);
        for (Index i = j; i < n; ++i) L_(i, j) -= L_(i, k) * l;
      }
      for (Index i = j + 1; i < n; ++i) L_(i, j) /= L_(j, j);
    }
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    const Index n = static_cast<Index>(matrix().cols());
    for (Index c = 0; c < B.cols(); ++c) {
      for (Index i = 0; i < n; ++i) {
        X(i, c) = B(i, c);
        for (Index k = 0; k < i; ++k) X(i, c) -= L_(i, k) * X(k, c);
      }
      for (Index i = 0; i < n; ++i) X(i, c) /= L_(i, i);
      for (Index i = n - 1; i >= 0; --i) {
        for (Index k = i + 1; k < n; ++k) X(i, c) -= L_(k, i) * X(k, c);
      }
    }
  }

 private:
  Eigen::MatrixXd L_;
};

}  // namespace variform::testing
