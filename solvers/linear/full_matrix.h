// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/solver/linear_backend.h"

namespace variform {

/// All entries of a square matrix, for backends that know no symmetric storage: a lower triangle is mirrored, general
/// matrices are passed on. The map of the entries is made once per pattern, so that new values are only copied.
class FullMatrix {
 public:
  void analyze(const SparseMatrix& A, MatrixKind kind);

  /// The full matrix of A, which has the analysed pattern; valid as long as A and this object.
  const SparseMatrix& update(const SparseMatrix& A);

 private:
  bool mirrored_ = false;
  SparseMatrix full_;
  std::vector<Index> source_;  ///< value k of full_ is value source_[k] of the lower triangle
};

}  // namespace variform
