// SPDX-License-Identifier: BSD-3-Clause
// What a program does that uses the installed library: poses a square by two corners, which a similarity fulfils, and
// by three, which none does.
#include <cstdio>

#include "energies/energies.h"
#include "experiments/pipelines.h"
#include "framework/domain/domain.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "integrators/ode/ode_backends.h"
#include "solvers/linear/linear_backends.h"

int main() {
  using namespace variform;
  const Domain domain(rectangle_mesh({.width = 1.0, .height = 1.0, .h = 0.125}));
  const EnergyEntry& entry = energies().find("asap");
  const auto energy = entry.make(Parameters(entry.parameters));
  const Index right = 8;
  const Index top = domain.vertex_count() - 1;
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(0, Eigen::RowVector2d(0.0, 0.0));
  constraints.fix(right, Eigen::RowVector2d(0.0, 2.0));
  const auto minimum = [&] {
    Problem problem(domain, *energy, {.beta = 0.2}, constraints);
    const auto backend = make_linear_backend("auto");
    return problem.value(problem.solve(*backend)).plain;
  };
  const double similar = minimum();
  constraints.fix(top, Eigen::RowVector2d(1.0, 1.0));
  const double bent = minimum();
  for (const OdeBackendEntry& ode : ode_backends().entries()) {
    if (ode.available) make_ode_backend(ode.name);
  }
  std::printf("energy %.3g for two corners, %.6g for three; %zu pipelines\n", similar, bent,
              pipelines().entries().size());
  return similar < 1e-20 && bent > 0.01 && !pipelines().entries().empty() ? 0 : 1;
}
