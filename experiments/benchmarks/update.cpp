// SPDX-License-Identifier: BSD-3-Clause
// Adding and removing one handle: a change of the factorization against a new one.
#include "experiments/benchmarks/scene.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

// Time of the benchmark: the change. Counters compare with the numeric factorizations of the same matrix.
void handle(benchmark::State& state, const std::string& energy) {
  const Scene scene(energy, 0.0, static_cast<Index>(state.range(0)));
  Problem problem = scene.problem();
  const SparseMatrix& K = problem.reduced_matrix();
  const auto updated = make_linear_backend("cholmod.simplicial");
  const auto simplicial = make_linear_backend("cholmod.simplicial");
  const auto supernodal = make_linear_backend("cholmod.supernodal");
  updated->factorize(K, MatrixKind::spd);
  const std::vector<Index> middle = {static_cast<Index>(K.rows()) / 2};
  SparseMatrix soft(K.rows(), 1);
  soft.insert(middle[0], 0) = 1.0;
  soft.makeCompressed();
  updated->hold(middle);  // what the first change prepares
  updated->release(middle);
  Samples samples;
  for (auto _ : state) {
    samples.time("hold", [&] { updated->hold(middle); });
    samples.time("release", [&] { updated->release(middle); });
    state.SetIterationTime(samples.time("update", [&] { updated->update(soft, 1); }));
    samples.time("downdate", [&] { updated->update(soft, -1); });
    samples.time("simplicial", [&] { simplicial->factorize(K, MatrixKind::spd); });
    samples.time("supernodal", [&] { supernodal->factorize(K, MatrixKind::spd); });
  }
  samples.report(state);
  state.counters["unknowns"] = static_cast<double>(K.rows());
  state.counters["supernodal/hold"] = samples.ratio("supernodal", "hold");
  state.counters["supernodal/release"] = samples.ratio("supernodal", "release");
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("cells")->Arg(20000)->Arg(200000)->Iterations(5)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(handle, arap, "arap")->Apply(sizes);
BENCHMARK_CAPTURE(handle, larap, "larap")->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
