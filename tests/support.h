// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/base/types.h"

namespace variform::testing {

/// The symmetric matrix whose lower triangle is stored, dense.
inline Eigen::MatrixXd dense_symmetric(const SparseMatrix& lower) {
  const SparseMatrix full = lower.selfadjointView<Eigen::Lower>();
  return full;
}

}  // namespace variform::testing
