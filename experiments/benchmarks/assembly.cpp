// SPDX-License-Identifier: BSD-3-Clause
// Matrix assembly against what it replaces (a triple product of sparse matrices) and what it feeds (analysis and
// factorization).
#include "framework/form/assembly.h"

#include <tbb/global_control.h>

#include "experiments/benchmarks/scene.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

// W (x) I_n: W between residuals instead of sites.
SparseMatrix expanded(const SparseMatrix& W, int n) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  triplets.reserve(static_cast<std::size_t>(W.nonZeros()) * n);
  for (Index j = 0; j < W.outerSize(); ++j) {
    for (SparseMatrix::InnerIterator it(W, j); it; ++it) {
      for (int i = 0; i < n; ++i) triplets.emplace_back(static_cast<Index>(it.row()) * n + i, j * n + i, it.value());
    }
  }
  SparseMatrix result(W.rows() * n, W.cols() * n);
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

// Time of the benchmark: Assembly::refill and Reduction::refill together.
void refill(benchmark::State& state, const std::string& energy, double beta) {
  const Scene scene(energy, beta, static_cast<Index>(state.range(0)));
  const Problem problem = scene.problem();
  const std::vector<Term>& terms = problem.terms();
  Assembly assembly(terms);
  Reduction reduction(assembly.matrix(), scene.constraints, problem.traits().unknowns);
  const SparseMatrix E = terms.front().form.sparse_operator();
  const SparseMatrix W = expanded(terms.front().norm->matrix(), terms.front().form.residuals());
  const auto cholmod = make_linear_backend("cholmod.supernodal");
  const auto eigen = make_linear_backend("eigen.ldlt");
  const auto refill_all = [&] {
    assembly.refill(terms);
    reduction.refill(assembly.matrix(), scene.constraints);
  };
  refill_all();
  cholmod->analyze(reduction.matrix(), MatrixKind::spd);

  Samples samples;
  for (auto _ : state) {
    state.SetIterationTime(samples.time("refill", refill_all));
    samples.time("refill_assembly", [&] { assembly.refill(terms); });
    samples.time("refill_reduction", [&] { reduction.refill(assembly.matrix(), scene.constraints); });
    {
      const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
      samples.time("refill_1_thread", refill_all);
    }
    samples.time("triple_product", [&] {
      SparseMatrix H = E.transpose() * W * E;
      benchmark::DoNotOptimize(H.valuePtr());
    });
    cholmod->factorize(reduction.matrix(), MatrixKind::spd);
    samples.add("cholmod_factorize", cholmod->report().factorize_seconds);
  }
  // An order of magnitude slower: once is enough.
  eigen->factorize(reduction.matrix(), MatrixKind::spd);
  samples.add("eigen_factorize", eigen->report().factorize_seconds);
  samples.report(state);
  state.counters["product/refill"] = samples.ratio("triple_product", "refill");
  state.counters["product/refill_1_thread"] = samples.ratio("triple_product", "refill_1_thread");
  state.counters["refill/cholmod_%"] = 100.0 * samples.ratio("refill", "cholmod_factorize");
  state.counters["refill/eigen_%"] = 100.0 * samples.ratio("refill", "eigen_factorize");
}

// Time of the benchmark: everything that is done once per connectivity, before the symbolic analysis.
void pattern(benchmark::State& state, const std::string& energy, double beta) {
  const Scene scene(energy, beta, static_cast<Index>(state.range(0)));
  const Problem problem = scene.problem();
  const std::vector<Term>& terms = problem.terms();
  Samples samples;
  for (auto _ : state) {
    std::unique_ptr<Assembly> assembly;
    std::unique_ptr<Reduction> reduction;
    const double first = samples.time("pattern_assembly", [&] { assembly = std::make_unique<Assembly>(terms); });
    const double second = samples.time("pattern_reduction", [&] {
      reduction = std::make_unique<Reduction>(assembly->matrix(), scene.constraints, problem.traits().unknowns);
    });
    samples.add("pattern", first + second);
    state.SetIterationTime(first + second);
    for (const char* name : {"cholmod.supernodal", "eigen.ldlt"}) {
      // A new one each time: a backend skips the analysis of a pattern that it knows.
      const auto backend = make_linear_backend(name);
      backend->analyze(reduction->matrix(), MatrixKind::spd);
      samples.add(name + std::string("_analyze"), backend->report().analyze_seconds);
    }
  }
  samples.report(state);
  state.counters["pattern/cholmod_%"] = 100.0 * samples.ratio("pattern", "cholmod.supernodal_analyze");
  state.counters["pattern/eigen_%"] = 100.0 * samples.ratio("pattern", "eigen.ldlt_analyze");
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("cells")->Arg(20000)->Arg(200000)->Iterations(5)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(refill, asap, "asap", 0.3)->Apply(sizes);
BENCHMARK_CAPTURE(refill, asap_unregularized, "asap", 0.0)->Apply(sizes);
BENCHMARK_CAPTURE(refill, arap, "arap", 0.3)->Apply(sizes);
BENCHMARK_CAPTURE(pattern, asap, "asap", 0.3)->Apply(sizes);
BENCHMARK_CAPTURE(pattern, asap_unregularized, "asap", 0.0)->Apply(sizes);
BENCHMARK_CAPTURE(pattern, arap, "arap", 0.3)->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
