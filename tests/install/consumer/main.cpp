// SPDX-License-Identifier: BSD-3-Clause
// What a program does that uses the installed library: poses a square by two corners, which a similarity fulfils, and
// by three, which none does; and bends a strip continuously.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "energies/energies.h"
#include "experiments/pipelines.h"
#include "framework/domain/domain.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "integrators/ode/ode_backends.h"
#include "integrators/shape/deformation_flow.h"
#include "solvers/linear/linear_backends.h"

namespace {

using namespace variform;

// The example of README.md: largest distance of the turned end from where its handle has it, in a deformation that came
// to its end.
double bent_strip_error() {
  const Domain rest(rectangle_mesh({.width = 4.0, .h = 1.0 / 8}));
  Handle left{.name = "left"};
  Handle right{.name = "right"};
  for (Index v = 0; v < rest.vertex_count(); ++v) {
    if (rest.positions()(v, 0) == 0.0) left.vertices.push_back(v);
    if (rest.positions()(v, 0) == 4.0) right.vertices.push_back(v);
  }
  right.motion = rotate(Eigen::Vector2d(4.0, 0.5), {}, std::numbers::pi / 2, {0.0, 1.0});  // a quarter turn

  const EnergyEntry& entry = energies().find("metr");
  const auto energy = entry.make(Parameters(entry.parameters));
  const auto linear = make_linear_backend("auto");
  DeformationFlow flow(rest, *energy, {.beta = 0.1}, {left, right}, 0.0, *linear);
  const auto integrator = make_ode_backend("abm3");
  const Vector y = integrator->integrate(flow, flow.rest_state(), 0.0, 1.0, {.tolerance = 1e-4});
  const Matrix X = DeformationFlow::positions_of(y, 2);

  if (!integrator->report().completed) return 1.0;
  double largest = 0.0;
  for (const Index v : right.vertices) {
    const double arm = rest.positions()(v, 1) - 0.5;
    largest = std::max(largest, std::hypot(X(v, 0) - 4.0 + arm, X(v, 1) - 0.5));
  }
  return largest;
}

}  // namespace

int main() {
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
  const double error = bent_strip_error();
  std::printf("energy %.3g for two corners, %.6g for three; handle error %.3g; %zu pipelines\n", similar, bent, error,
              pipelines().entries().size());
  return similar < 1e-20 && bent > 0.01 && error < 1e-12 && !pipelines().entries().empty() ? 0 : 1;
}
