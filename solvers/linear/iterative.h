// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>

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

}  // namespace variform
