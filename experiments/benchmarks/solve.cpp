// SPDX-License-Identifier: BSD-3-Clause
// Triangular solves, one right-hand side at a time and many at once, and whole runs.
#include <random>

#include "experiments/benchmarks/scene.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

// Time of the benchmark: one solve for all right-hand sides.
void solve(benchmark::State& state, const std::string& energy, double beta, const std::string& backend_name) {
  constexpr int kColumns = 32;
  const Scene scene(energy, beta, static_cast<Index>(state.range(0)));
  Problem problem = scene.problem();
  const SparseMatrix& K = problem.reduced_matrix();
  const auto backend = make_linear_backend(backend_name);
  backend->factorize(K, MatrixKind::spd);
  std::mt19937 random(1);
  const Eigen::MatrixXd B = Eigen::MatrixXd::NullaryExpr(
      K.rows(), kColumns, [&] { return std::uniform_real_distribution(-1.0, 1.0)(random); });
  Samples samples;
  for (auto _ : state) {
    state.SetIterationTime(samples.time("batch", [&] { benchmark::DoNotOptimize(backend->solve(B)); }));
    samples.add("batch_without_check", backend->report().solve_seconds);
    double unchecked = 0.0;
    samples.time("single", [&] {
      for (int column = 0; column < kColumns; ++column) {
        benchmark::DoNotOptimize(backend->solve(B.col(column)));
        unchecked += backend->report().solve_seconds;
      }
    });
    samples.add("single_without_check", unchecked);
  }
  samples.report(state);
  state.counters["single/batch"] = samples.ratio("single", "batch");
  state.counters["single/batch_without_check"] = samples.ratio("single_without_check", "batch_without_check");
}

// Time of the benchmark: from a mesh in memory to the solution. The peak is that of the process, so it is the peak of
// this run only if the benchmark is the only one that the filter selects.
void run(benchmark::State& state, const std::string& energy, double beta) {
  Samples samples;
  for (auto _ : state) {
    state.SetIterationTime(samples.time("total", [&] {
      const Scene scene(energy, beta, static_cast<Index>(state.range(0)));
      Problem problem = scene.problem();
      const auto backend = make_linear_backend("cholmod.supernodal");
      benchmark::DoNotOptimize(problem.solve(*backend));
      const ProblemTimes& times = problem.times();
      samples.add("declare", times.declare);
      samples.add("pattern", times.pattern);
      samples.add("refill", times.refill);
      samples.add("analyze", times.analyze);
      samples.add("factorize", times.factorize);
      samples.add("solve", times.solve);
      state.counters["factor_entries"] = static_cast<double>(backend->report().nnz_factor);
    }));
  }
  samples.report(state);
  state.counters["peak_MB"] = peak_memory() / 1e6;
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("cells")->Arg(20000)->Arg(200000)->Iterations(3)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(solve, asap, "asap", 0.3, "cholmod.supernodal")->Apply(sizes);
BENCHMARK_CAPTURE(solve, asap_unregularized, "asap", 0.0, "cholmod.supernodal")->Apply(sizes);
BENCHMARK_CAPTURE(solve, asap_eigen, "asap", 0.3, "eigen.ldlt")
    ->ArgName("cells")
    ->Arg(20000)  // one at a time and many at once take the same time per column, whatever the size
    ->Iterations(3)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(run, asap, "asap", 0.3)->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
