// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <utility>

#include "framework/base/types.h"

namespace variform {

/// Calls body(i) for i in [0, count), in parallel. Iterations must not write to the same place, so results do not
/// depend on the number of threads.
template <class Body>
void parallel_for(Index count, const Body& body, Index grain = 512) {
  tbb::parallel_for(
      tbb::blocked_range<Index>(0, count, static_cast<std::size_t>(grain)),
      [&](const tbb::blocked_range<Index>& range) {
        for (Index i = range.begin(); i != range.end(); ++i) body(i);
      },
      tbb::simple_partitioner());
}

/// Sum of term(i) for i in [0, count), with a fixed order of additions: the same bits on any number of threads.
template <class Term>
double parallel_sum(Index count, const Term& term, Index grain = 4096) {
  return tbb::parallel_deterministic_reduce(
      tbb::blocked_range<Index>(0, count, static_cast<std::size_t>(grain)), 0.0,
      [&](const tbb::blocked_range<Index>& range, double sum) {
        for (Index i = range.begin(); i != range.end(); ++i) sum += term(i);
        return sum;
      },
      [](double a, double b) { return a + b; });
}

}  // namespace variform
