// SPDX-License-Identifier: BSD-3-Clause
// One iteration of local/global alternation, by parts.
#include "experiments/benchmarks/scene.h"
#include "framework/form/problem_objective.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform::benchmarks {
namespace {

// Time of the benchmark: one iteration as a nonlinear backend runs it, history included. The parts are timed on their
// own, on the same state.
void iteration(benchmark::State& state, double beta) {
  const Scene scene("arap", beta, static_cast<Index>(state.range(0)));
  Problem problem = scene.problem();
  const auto backend = make_linear_backend("cholmod.supernodal");
  Matrix U = problem.solve(*backend);

  std::vector<Term> terms;
  terms.push_back({problem.terms().front().form, cell_norm(scene.domain, scene.norm)});
  Form& form = terms.front().form;
  Assembly assembly(terms);
  assembly.refill(terms);
  Reduction reduction(assembly.matrix(), scene.constraints, 1);
  reduction.refill(assembly.matrix(), scene.constraints);

  constexpr int kIterations = 10;
  ProblemObjective objective(problem, *backend);
  const auto local_global = make_nonlinear_backend("local_global");
  Samples samples;
  for (auto _ : state) {
    const double all = samples.time(
        "iterations", [&] { local_global->minimize(objective, U, {.tolerance = 0.0, .max_iterations = kIterations}); });
    samples.add("iteration", all / kIterations);
    state.SetIterationTime(all / kIterations);

    samples.time("targets", [&] { scene.energy->refresh_target(scene.domain, U, form); });
    samples.time("refill_targets", [&] { assembly.refill_targets(terms); });
    Eigen::MatrixXd rhs;
    samples.time("right_hand_side", [&] {
      rhs = reduction.right_hand_side(assembly.matrix(), assembly.right_hand_side(), scene.constraints);
    });
    Eigen::MatrixXd Y;
    samples.time("solve", [&] { Y = backend->solve(rhs); });
    samples.add("triangular_solve", backend->report().solve_seconds);
    samples.time("expand", [&] { U = reduction.expand(Y, scene.constraints, 2); });
    samples.time("value", [&] { benchmark::DoNotOptimize(problem.value(U)); });
  }
  samples.report(state);
  state.counters["solve/iteration_%"] = 100.0 * samples.ratio("solve", "iteration");
  state.counters["value/iteration_%"] = 100.0 * samples.ratio("value", "iteration");
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("cells")->Arg(20000)->Arg(200000)->Iterations(5)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(iteration, arap, 0.3)->Apply(sizes);
BENCHMARK_CAPTURE(iteration, arap_unregularized, 0.0)->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
