// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/thinned_matrix.h"

#include <cmath>

#include "framework/base/parallel.h"

namespace variform {
namespace {

constexpr double kNegligible = 1e-14;
constexpr double kWorthwhile = 0.25;  // share of all entries

// Whether entry k, in column j, is left out. The diagonal entry of a column comes first.
bool is_negligible(const SparseMatrix& K, Index k, Index j) {
  const Index* starts = K.outerIndexPtr();
  const double* values = K.valuePtr();
  if (k == starts[j]) return false;
  const double diagonals = values[starts[j]] * values[starts[K.innerIndexPtr()[k]]];
  // False where something is not finite: the backend is to see it.
  return std::abs(values[k]) <= kNegligible * std::sqrt(std::abs(diagonals));
}

}  // namespace

const SparseMatrix& ThinnedMatrix::refill(const SparseMatrix& K) {
  const bool holds = !kept_.empty() && parallel_sum(static_cast<Index>(dropped_.size()), [&](Index i) {
                                         return is_negligible(K, dropped_[i], dropped_columns_[i]) ? 0.0 : 1.0;
                                       }) == 0.0;
  if (!holds) choose(K);
  if (kept_.empty()) return K;
  parallel_for(
      static_cast<Index>(kept_.size()), [&](Index i) { matrix_.valuePtr()[i] = K.valuePtr()[kept_[i]]; }, 4096);
  return matrix_;
}

void ThinnedMatrix::choose(const SparseMatrix& K) {
  kept_.clear();
  dropped_.clear();
  dropped_columns_.clear();
  const auto columns = static_cast<Index>(K.cols());
  const auto for_each_negligible = [&](Index j, const auto& visit) {
    for (Index k = K.outerIndexPtr()[j]; k < K.outerIndexPtr()[j + 1]; ++k) visit(k, is_negligible(K, k, j));
  };
  const double share = parallel_sum(columns, [&](Index j) {
    double count = 0.0;
    for_each_negligible(j, [&](Index, bool negligible) { count += negligible ? 1.0 : 0.0; });
    return count;
  });
  if (!(share >= kWorthwhile * static_cast<double>(K.nonZeros())) || share == 0.0) {
    if (matrix_.cols() > 0) matrix_.resize(0, 0);
    return;
  }
  dropped_.reserve(static_cast<std::size_t>(share));
  dropped_columns_.reserve(static_cast<std::size_t>(share));
  kept_.reserve(static_cast<std::size_t>(K.nonZeros()) - dropped_.capacity());
  matrix_.resize(K.rows(), K.cols());
  matrix_.resizeNonZeros(K.nonZeros() - static_cast<Index>(share));
  for (Index j = 0; j < columns; ++j) {
    matrix_.outerIndexPtr()[j] = static_cast<Index>(kept_.size());
    for_each_negligible(j, [&](Index k, bool negligible) {
      if (negligible) {
        dropped_.push_back(k);
        dropped_columns_.push_back(j);
      } else {
        matrix_.innerIndexPtr()[kept_.size()] = K.innerIndexPtr()[k];
        kept_.push_back(k);
      }
    });
  }
  matrix_.outerIndexPtr()[columns] = static_cast<Index>(kept_.size());
}

}  // namespace variform
