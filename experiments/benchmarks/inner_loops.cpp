// SPDX-License-Identifier: BSD-3-Clause
// The loops that iterations and time steps consist of, against what the memory of the machine gives in the same run.
#include <vector>

#include "experiments/benchmarks/scene.h"
#include "framework/base/parallel.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

/// a = b + s c on arrays far larger than the caches, by all threads, as in McCalpin's STREAM.
class Stream {
 public:
  void run() {
    parallel_for(
        kSize, [&](Index i) { a_[i] = b_[i] + 3.0 * c_[i]; }, 1 << 16);
    benchmark::DoNotOptimize(a_.data());
  }
  /// Of one run, the write counted once.
  static constexpr double kBytes = 3.0 * sizeof(double) * (16 << 20);

 private:
  static constexpr Index kSize = 16 << 20;  // 128 MiB each
  std::vector<double> a_ = std::vector<double>(kSize, 0.0);
  std::vector<double> b_ = std::vector<double>(kSize, 1.0);
  std::vector<double> c_ = std::vector<double>(kSize, 2.0);
};

template <class T>
double bytes(const std::vector<T>& values) {
  return static_cast<double>(values.size() * sizeof(T));
}

// Traffic that a loop cannot do without: every array that it reads or writes, once.
struct Loop {
  const char* name;
  double bytes;
};

// Time of the benchmark: all loops. Counters: time, rate and share of the stream rate of each.
void inner_loops(benchmark::State& state, const char* solver, double beta) {
  const Scene scene("arap", beta, static_cast<Index>(state.range(0)));
  Problem problem = scene.problem();
  const auto backend = make_linear_backend(solver);
  const Matrix U = problem.solve(*backend);
  problem.solve(*backend);  // a second one: the factor is what repeated solves use

  std::vector<Term> terms;
  terms.push_back({problem.terms().front().form, cell_norm(scene.domain, scene.norm)});
  Form& form = terms.front().form;
  Assembly assembly(terms);
  assembly.refill(terms);
  Reduction reduction(assembly.matrix(), scene.constraints, 1);
  reduction.refill(assembly.matrix(), scene.constraints);
  assembly.refill_targets(terms);
  const Eigen::MatrixXd rhs =
      reduction.right_hand_side(assembly.matrix(), assembly.right_hand_side(), scene.constraints);

  const double sites = form.site_count();
  const double blocks = sites * form.residuals() * form.unknowns() * form.site_size(0) * sizeof(double);
  const double targets = sites * form.residuals() * form.columns() * sizeof(double);
  const double values = static_cast<double>(U.size()) * sizeof(double);
  const double entries = static_cast<double>(assembly.matrix().nonZeros());
  const double factor = static_cast<double>(backend->report().nnz_factor) * (sizeof(double) + sizeof(Index));
  const std::vector<Loop> loops = {
      {"refill", blocks + entries * sizeof(double)},
      {"local_step", blocks + bytes(form.nodes()) + values + targets},
      {"refill_targets", blocks + bytes(form.nodes()) + targets + values},
      // Forwards and backwards; the two columns in two halves, each of which reads the factor.
      {"triangular_solve", 2.0 * 2.0 * factor + 4.0 * values},
  };
  Samples samples;
  Stream stream;
  for (auto _ : state) {
    samples.time("stream", [&] { stream.run(); });
    const Stopwatch watch;
    samples.time("refill", [&] { assembly.refill(terms); });
    samples.time("local_step", [&] { scene.energy->refresh_target(scene.domain, U, form); });
    samples.time("refill_targets", [&] { assembly.refill_targets(terms); });
    benchmark::DoNotOptimize(backend->solve(rhs));
    samples.add("triangular_solve", backend->report().solve_seconds);
    state.SetIterationTime(watch.seconds());
  }
  samples.report(state);
  state.SetLabel(backend->report().backend);
  const double stream_rate = Stream::kBytes / samples.median("stream");
  state.counters["stream_GB/s"] = 1e-9 * stream_rate;
  for (const Loop& loop : loops) {
    const double rate = loop.bytes / samples.median(loop.name);
    state.counters[std::string(loop.name) + "_GB/s"] = 1e-9 * rate;
    state.counters[std::string(loop.name) + "/stream_%"] = 100.0 * rate / stream_rate;
  }
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("cells")->Arg(200000)->Arg(1000000)->Iterations(7)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(inner_loops, arap_unregularized, "cholmod.supernodal", 0.0)->Apply(sizes);
BENCHMARK_CAPTURE(inner_loops, arap, "cholmod.supernodal", 0.3)->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
