// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/experiment/plan.h"
#include "framework/experiment/process_pool.h"
#include "framework/experiment/runner.h"

namespace variform {

/// A point of a study at its end.
struct Point {
  Row values = {};  ///< swept keys; "seed" where there is one
  ProcessOutcome outcome = ProcessOutcome::interrupted;
  std::string reason = {};              ///< why it has no result, one line
  ExitCode exit_code = ExitCode::done;  ///< what the program would have answered, had this been its only point
  PointResult result = {};              ///< if ok; without mesh and fields, which are on disk
};

/// Runs all points of a plan, or takes them from the folder (options.resume), in this process or in processes of their
/// own (options.point_command). Every finished point is in the folder at once: mesh and fields in meshes/, the rest as
/// a checkpoint in points/. Points come back in their order, those that an interrupt left out as interrupted.
std::vector<Point> run_points(const Config& config, const Plan& plan, const RunOptions& options);

/// Whether the point of a row has a result.
bool succeeded(const Row& row);

}  // namespace variform
