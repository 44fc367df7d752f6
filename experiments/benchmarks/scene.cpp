// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/benchmarks/scene.h"

#include <sys/resource.h>
#include <time.h>

#include <algorithm>
#include <cmath>

#include "energies/energies.h"
#include "framework/domain/generators.h"

namespace variform::benchmarks {

Scene::Scene(const std::string& energy_name, double beta, Index cells)
    : domain(rectangle_mesh({.h = 1.0 / std::round(std::sqrt(cells / 2.0)), .jitter = 0.2})),
      norm{.beta = beta},
      constraints(domain.vertex_count(), 2) {
  const EnergyEntry& entry = energies().find(energy_name);
  energy = entry.make(Parameters(entry.parameters));
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const Eigen::RowVector2d x = domain.positions().row(v);
    if (x[0] == 0.0) constraints.fix(v, x);
    if (x[0] == 1.0) constraints.fix(v, Eigen::RowVector2d(x[0] + 0.3, x[1] + 0.2));
  }
}

double thread_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double Samples::median(const std::string& name) const {
  std::vector<double> sorted = seconds_.at(name);
  std::sort(sorted.begin(), sorted.end());
  return sorted[sorted.size() / 2];
}

void Samples::report(benchmark::State& state) const {
  for (const auto& [name, values] : seconds_) state.counters[name + "_ms"] = 1e3 * median(name);
}

double peak_memory() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return 1024.0 * static_cast<double>(usage.ru_maxrss);
}

}  // namespace variform::benchmarks
