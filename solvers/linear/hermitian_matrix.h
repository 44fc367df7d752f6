// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "framework/base/types.h"

namespace variform {

/// A real symmetric matrix K of order 2n that is a Hermitian matrix H of order n in disguise: unknowns come in pairs
/// z = x + i y (interleaved), and every 2 x 2 block is [a, -b; b, a], which multiplies by a + i b. So are the matrices
/// of energies that turn with the image plane (conformal maps, for any beta), as long as the constraints hold whole
/// vertices. A factorization of H needs half the memory and half the operations of one of K, and its graph has half
/// the vertices.
class HermitianMatrix {
 public:
  /// Takes the pattern of K (lower triangle, compressed, rows sorted) and its values; false if K is no such matrix.
  bool analyze(const SparseMatrix& K);
  /// New values of the same pattern; false if they do not fit: then H is not to be used. Blocks may differ from the
  /// form by 1e-14 of sqrt(K_ii K_jj), the rounding errors of an assembly.
  bool update(const SparseMatrix& K);

  /// Lower triangle of H by compressed columns; values are pairs (a, b).
  Index size() const { return static_cast<Index>(starts_.size()) - 1; }
  const std::vector<Index>& column_pointers() const { return starts_; }
  const std::vector<Index>& rows() const { return rows_; }
  const std::vector<double>& values() const { return values_; }

 private:
  bool convert(const double* K, std::size_t k);

  // Entries of K that make one of H, -1 where K stores none.
  struct Sources {
    Index aa, ba, ab, bb;  // at rows (x, y, x, y) and columns (x, x, y, y)
  };

  std::vector<Index> starts_;
  std::vector<Index> rows_;
  std::vector<Index> columns_;
  std::vector<Sources> sources_;
  std::vector<double> values_;
};

}  // namespace variform
