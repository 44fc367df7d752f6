// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/spectrum.h"

#include <vector>

#include "framework/operators/operators.h"

namespace variform {

EigenPairs spectrum(Problem& problem, EigenBackend& backend, Index count, SpectrumMetric metric) {
  if (metric == SpectrumMetric::identity) return backend.solve(problem.normal_matrix(), SparseMatrix(), count);
  const SparseMatrix vertex_mass = mass_matrix(problem.domain());
  const int unknowns = problem.traits().unknowns;
  std::vector<Eigen::Triplet<double, Index>> triplets;
  triplets.reserve(static_cast<std::size_t>(vertex_mass.nonZeros()) * unknowns);
  for (Index j = 0; j < vertex_mass.cols(); ++j) {
    for (SparseMatrix::InnerIterator entry(vertex_mass, j); entry; ++entry) {
      if (entry.row() < j) continue;
      for (int c = 0; c < unknowns; ++c) {
        triplets.emplace_back(static_cast<Index>(entry.row()) * unknowns + c, j * unknowns + c, entry.value());
      }
    }
  }
  const SparseMatrix& H = problem.normal_matrix();
  SparseMatrix M(H.rows(), H.cols());
  M.setFromTriplets(triplets.begin(), triplets.end());
  return backend.solve(H, M, count);
}

}  // namespace variform
