// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <string>

#include "framework/base/parameters.h"
#include "framework/base/types.h"

namespace variform {

/// Empty if all diagonal entries of A are positive, otherwise what is wrong. Iterations notice nothing themselves of
/// matrices of the wrong sign and rows that were never filled.
inline std::string wrong_diagonal(const SparseMatrix& A) {
  const Vector diagonal = A.diagonal();
  Index worst = 0;
  if (diagonal.minCoeff(&worst) > 0.0) return {};
  return fmt::format("the matrix is not positive definite: diagonal entry {:.3g} at unknown {} of {}", diagonal[worst],
                     worst, diagonal.size());
}

/// Parameters that all iterative backends share.
inline Parameter tolerance_parameter() {
  return {.name = "tolerance", .value = 1e-10, .doc = "relative residual to stop at", .min = 1e-16, .max = 1.0};
}
inline Parameter limit_parameter() {
  return {.name = "max_iterations",
          .value = std::int64_t{0},
          .doc = "per right-hand side; 0: twice the number of unknowns",
          .min = 0.0,
          .max = 1e9};
}

}  // namespace variform
