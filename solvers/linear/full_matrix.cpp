// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/full_matrix.h"

#include <algorithm>

namespace variform {

void FullMatrix::analyze(const SparseMatrix& A, MatrixKind kind) {
  full_ = SparseMatrix();
  source_.clear();
  mirrored_ = kind == MatrixKind::spd || kind == MatrixKind::symmetric_indefinite;
  if (!mirrored_) return;

  IndexVector next = IndexVector::Zero(A.cols() + 1);  // column sizes, then where the next entry of a column goes
  for (Index j = 0; j < A.cols(); ++j) {
    for (SparseMatrix::InnerIterator entry(A, j); entry; ++entry) {
      ++next[j + 1];
      if (entry.row() != j) ++next[entry.row() + 1];
    }
  }
  for (Index j = 0; j < A.cols(); ++j) next[j + 1] += next[j];
  const Index count = next[A.cols()];
  full_.resize(A.rows(), A.cols());
  full_.resizeNonZeros(count);
  source_.resize(static_cast<std::size_t>(count));
  std::copy(next.begin(), next.end(), full_.outerIndexPtr());

  // Column j of the triangle comes after columns 0..j-1 mirrored their entries into column j of the full matrix, so the
  // rows of every column come out sorted.
  const auto put = [&](Index row, Index column, Index source) {
    const Index place = next[column]++;
    full_.innerIndexPtr()[place] = row;
    source_[static_cast<std::size_t>(place)] = source;
  };
  for (Index j = 0; j < A.cols(); ++j) {
    for (Index k = A.outerIndexPtr()[j]; k < A.outerIndexPtr()[j + 1]; ++k) {
      const Index i = A.innerIndexPtr()[k];
      put(i, j, k);
      if (i != j) put(j, i, k);
    }
  }
}

const SparseMatrix& FullMatrix::update(const SparseMatrix& A) {
  if (!mirrored_) return A;
  double* value = full_.valuePtr();
  for (const Index source : source_) *value++ = A.valuePtr()[source];
  return full_;
}

}  // namespace variform
