// SPDX-License-Identifier: BSD-3-Clause
// Steps of a continuous deformation: what an evaluation of the velocity field is made of, against one that declares,
// analyzes and factorizes everything anew.
#include <cmath>
#include <memory>
#include <vector>

#include "energies/energies.h"
#include "experiments/benchmarks/scene.h"
#include "framework/domain/generators.h"
#include "integrators/ode/ode_backends.h"
#include "integrators/shape/deformation_flow.h"
#include "integrators/shape/handles.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

constexpr double kStep = 0.01;

Domain planar(Index cells) {
  // 2 n^2 triangles.
  const double h = 1.0 / std::sqrt(static_cast<double>(cells) / 2.0);
  return Domain(rectangle_mesh({.width = 1.0, .height = 1.0, .h = h, .jitter = 0.2}));
}

Domain tetrahedral(Index cells) {
  // 6 tetrahedra for each of 2 n^3 cubes.
  const double h = 1.0 / std::cbrt(static_cast<double>(cells) / 12.0);
  return Domain(bar_tet_mesh(2.0, 1.0, 1.0, h, 0.1));
}

// A closed surface of 20 n^2 triangles.
Domain surface(Index cells) { return Domain(sphere_mesh(1.0, 1.107 / std::sqrt(static_cast<double>(cells) / 20.0))); }

// One end is held, the other one moves sideways.
std::vector<Handle> handles_of(const Domain& domain) {
  const Matrix& X = domain.positions();
  const double low = X.col(0).minCoeff();
  const double high = X.col(0).maxCoeff();
  const double margin = domain.kind() == DomainKind::surface ? 0.1 * (high - low) : 1e-9;
  Handle fixed{.name = "fixed"};
  Handle moved{.name = "moved"};
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (X(v, 0) < low + margin) fixed.vertices.push_back(v);
    if (X(v, 0) > high - margin) moved.vertices.push_back(v);
  }
  SpacePoint velocity = SpacePoint::Zero(domain.ambient_dimension());
  velocity[1] = 0.5;
  moved.motion = translate(velocity, {0.0, 1e6});
  return {fixed, moved};
}

// Time of the benchmark: one step of the third-order multistep method, two evaluations.
void step(benchmark::State& state, const std::string& name, Domain (*make)(Index)) {
  const auto cells = static_cast<Index>(state.range(0));
  const Domain domain = make(cells);
  const EnergyEntry& entry = energies().find(name);
  const auto energy = entry.make(Parameters(entry.parameters));
  const NormOptions norm{.beta = state.range(1) / 100.0};
  const std::vector<Handle> handles = handles_of(domain);
  const auto linear = make_linear_backend("cholmod.supernodal");
  DeformationFlow flow(domain, *energy, norm, handles, 0.0, *linear);
  Vector y = flow.rest_state();
  Vector dy(y.size());
  flow.velocity(0.0, y, dy);  // pattern and analysis

  Samples samples;
  double t = 0.0;
  for (auto _ : state) {
    const ProblemTimes before = flow.problem().times();
    const double geometry = flow.geometry_seconds();
    const double seconds = samples.time("step", [&] {
      for (int evaluation = 0; evaluation < 2; ++evaluation) {
        t += 0.5 * kStep;
        y += 0.5 * kStep * dy;
        flow.velocity(t, y, dy);
      }
    });
    state.SetIterationTime(seconds);
    const ProblemTimes& after = flow.problem().times();
    const double refill =
        flow.geometry_seconds() - geometry + after.declare - before.declare + after.refill - before.refill;
    samples.add("refill", refill);
    samples.add("factorize", after.factorize - before.factorize);
    samples.add("solve", after.solve - before.solve);
    // Two evaluations as they are without anything kept.
    samples.time("anew", [&] {
      for (int evaluation = 0; evaluation < 2; ++evaluation) {
        const auto fresh = make_linear_backend("cholmod.supernodal");
        DeformationFlow again(domain, *energy, norm, handles, 0.0, *fresh);
        again.velocity(t, y, dy);
      }
    });
  }
  samples.report(state);
  state.counters["refill/factorize_%"] = 100.0 * samples.ratio("refill", "factorize");
  state.counters["anew/step"] = samples.ratio("anew", "step");
  state.counters["steps/s"] = 1.0 / samples.median("step");
  state.counters["vertices"] = domain.vertex_count();
  state.counters["cells"] = domain.cell_count();
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"cells", "beta_%"})->UseManualTime()->Unit(benchmark::kMillisecond)->Iterations(3);
  for (const Index cells : {10000, 50000, 200000}) benchmark->Args({cells, 0})->Args({cells, 30});
}

BENCHMARK_CAPTURE(step, planar_metr, "metr", planar)->Apply(sizes);
BENCHMARK_CAPTURE(step, tetrahedral_metr, "metr", tetrahedral)->Apply(sizes);

BENCHMARK_CAPTURE(step, surface_near_isometric, "near_isometric", surface)->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
