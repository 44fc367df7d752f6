// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/base/types.h"

namespace variform {

/// A symmetric matrix without the entries that cancel. In conformal energies at beta = 0 the blocks that couple the two
/// coordinates are a null Lagrangian: what the cells around an interior edge bring sums up to rounding errors.
/// Assembled by connectivity these entries are stored nevertheless, and fill the factor.
///
/// Entries with |K_ij| <= 1e-14 sqrt(K_ii K_jj) are left out where they are at least a quarter of all: a perturbation
/// of the size of the rounding errors of the sums. Which ones is decided on the values of the first refill and kept, so
/// that the symbolic analysis stays valid, until one of them no longer cancels.
class ThinnedMatrix {
 public:
  /// The values of K (lower triangle with all diagonal entries, compressed), whose pattern must be that of the calls
  /// before: K itself where nothing is worth leaving out, else its thinned copy. Allocates nothing while the choice
  /// stays; same bits on any number of threads.
  const SparseMatrix& refill(const SparseMatrix& K);

 private:
  void choose(const SparseMatrix& K);

  std::vector<Index> kept_;     // entries of K, in order; empty: all
  std::vector<Index> dropped_;  // the others, and the column of each
  std::vector<Index> dropped_columns_;
  SparseMatrix matrix_;
};

}  // namespace variform
