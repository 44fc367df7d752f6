// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/hermitian_matrix.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace variform {
namespace {

constexpr double kRounding = 1e-14;

}  // namespace

// Whether the block [aa, ab; ba, bb] of K is [a, -b; b, a], of which the upper half is not stored on the diagonal.
bool HermitianMatrix::convert(const double* K, std::size_t k) {
  const auto value = [K](Index source) { return source >= 0 ? K[source] : 0.0; };
  const auto diagonal = [&](Index i) { return std::abs(K[sources_[starts_[i]].aa]); };
  const Sources& s = sources_[k];
  const double slack = kRounding * std::sqrt(diagonal(rows_[k]) * diagonal(columns_[k]));
  const double aa = value(s.aa);
  const double bb = value(s.bb);
  const double ba = value(s.ba);
  const double ab = value(s.ab);
  values_[2 * k] = 0.5 * (aa + bb);
  values_[2 * k + 1] = rows_[k] == columns_[k] ? 0.0 : 0.5 * (ba - ab);
  return std::abs(aa - bb) <= slack && std::abs(ba + ab) <= slack;
}

bool HermitianMatrix::analyze(const SparseMatrix& K) {
  starts_.assign(1, 0);
  rows_.clear();
  columns_.clear();
  sources_.clear();
  const auto order = static_cast<Index>(K.cols());
  if (order == 0 || order % 2 != 0) return false;
  const Index* const starts = K.outerIndexPtr();
  const Index* const rows = K.innerIndexPtr();
  for (Index i = 0; i < order; ++i) {
    if (starts[i] == starts[i + 1] || rows[starts[i]] != i) return false;  // no diagonal entry
    // What most other matrices fail.
    const double* const K_i = K.valuePtr() + starts[i];
    if (i % 2 == 1 && !(std::abs(K_i[0] - K.valuePtr()[starts[i - 1]]) <= kRounding * std::abs(K_i[0]))) return false;
  }
  const auto expected = static_cast<std::size_t>(K.nonZeros()) / 2 + static_cast<std::size_t>(order);
  rows_.reserve(expected);
  columns_.reserve(expected);
  sources_.reserve(expected);
  constexpr Index kEnd = std::numeric_limits<Index>::max();
  for (Index j = 0; j < order; j += 2) {
    // Both columns of the pair at once, pair of rows by pair of rows.
    Index x = starts[j];
    Index y = starts[j + 1];
    while (x < starts[j + 1] || y < starts[j + 2]) {
      const Index pair = std::min(x < starts[j + 1] ? rows[x] / 2 : kEnd, y < starts[j + 2] ? rows[y] / 2 : kEnd);
      const auto take = [&](Index& k, Index end, Index row) { return k < end && rows[k] == row ? k++ : -1; };
      Sources s{};
      s.aa = take(x, starts[j + 1], 2 * pair);
      s.ba = take(x, starts[j + 1], 2 * pair + 1);
      s.ab = take(y, starts[j + 2], 2 * pair);
      s.bb = take(y, starts[j + 2], 2 * pair + 1);
      rows_.push_back(pair);
      columns_.push_back(j / 2);
      sources_.push_back(s);
    }
    starts_.push_back(static_cast<Index>(rows_.size()));
  }
  values_.resize(2 * rows_.size());
  return update(K);
}

bool HermitianMatrix::update(const SparseMatrix& K) {
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    if (!convert(K.valuePtr(), k)) return false;
  }
  return true;
}

}  // namespace variform
