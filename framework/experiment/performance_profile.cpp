// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/performance_profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/base/error.h"

namespace variform {

std::vector<Curve> performance_profile(const std::vector<SolverCosts>& solvers) {
  if (solvers.empty() || solvers.front().costs.empty()) {
    throw UsageError("performance profile: needs a solver and a problem");
  }
  const std::size_t problems = solvers.front().costs.size();
  std::vector<double> best(problems, std::numeric_limits<double>::infinity());
  for (const SolverCosts& solver : solvers) {
    if (solver.costs.size() != problems) {
      throw UsageError(fmt::format("performance profile: {} costs of '{}' for {} problems", solver.costs.size(),
                                   solver.solver, problems));
    }
    for (std::size_t p = 0; p < problems; ++p) {
      if (!(solver.costs[p] > 0.0)) {
        throw UsageError(fmt::format("performance profile: cost {} of '{}': expected a positive number",
                                     solver.costs[p], solver.solver));
      }
      best[p] = std::min(best[p], solver.costs[p]);
    }
  }
  // Logarithms of the ratios of all solved problems, in order.
  std::vector<std::vector<double>> ratios(solvers.size());
  double end = 1.0;
  for (std::size_t s = 0; s < solvers.size(); ++s) {
    for (std::size_t p = 0; p < problems; ++p) {
      if (std::isfinite(solvers[s].costs[p])) ratios[s].push_back(std::log2(solvers[s].costs[p] / best[p]));
    }
    std::sort(ratios[s].begin(), ratios[s].end());
    if (!ratios[s].empty()) end = std::max(end, 1.05 * ratios[s].back());
  }
  std::vector<Curve> curves;
  for (std::size_t s = 0; s < solvers.size(); ++s) {
    Curve curve{solvers[s].solver, {0.0}, {0.0}};
    for (std::size_t k = 0; k < ratios[s].size(); ++k) {
      const double share = static_cast<double>(k + 1) / static_cast<double>(problems);
      if (ratios[s][k] > curve.x.back()) {
        curve.x.push_back(ratios[s][k]);
        curve.y.push_back(curve.y.back());
      }
      curve.x.push_back(ratios[s][k]);
      curve.y.push_back(share);
    }
    curve.x.push_back(end);
    curve.y.push_back(curve.y.back());
    curves.push_back(std::move(curve));
  }
  return curves;
}

}  // namespace variform
