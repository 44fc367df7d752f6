// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/experiment/figure.h"

namespace variform {

/// What a solver paid for each problem of a set: seconds, say, or iterations; infinite where it failed.
struct SolverCosts {
  std::string solver;
  std::vector<double> costs;  ///< by problem, the same problems for all solvers
};

/// Performance profiles (Dolan, Moré 2002): for each solver the share of problems, rho(tau), that it solves at no more
/// than tau times the cost of the best solver for that problem. rho(1) is how often it is the best, the height at the
/// right end how often it solves at all; problems that no solver solved count as failures of all.
///
/// Returns step curves in log2 tau, from 0 to a little beyond the largest finite ratio of any solver.
/// Throws UsageError when the numbers of problems differ, there are none, or a cost is not positive.
std::vector<Curve> performance_profile(const std::vector<SolverCosts>& solvers);

}  // namespace variform
