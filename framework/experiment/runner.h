// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/pipeline.h"
#include "framework/experiment/process_pool.h"
#include "framework/experiment/record.h"

namespace variform {

/// How far a run is, in points.
struct Progress {
  int done = 0;          ///< ended, whether or not with a result
  int total = 0;         ///< of the run
  int failed = 0;        ///< of those done: without result
  int taken = 0;         ///< of those done: from an earlier run
  double running = 0.0;  ///< shares done of the points that run, summed up: a number of points, too
};

struct RunOptions {
  std::filesystem::path folder;  ///< where everything goes; created
  bool figures = true;
  bool resume = false;  ///< take points that a previous run of the same config finished
  /// Facts of the program that runs (its version, licence, BLAS); the runner adds machine, date and config.
  std::vector<std::pair<std::string, std::string>> provenance = {};
  /// A program with arguments that hands its standard input to run_point_request. With it every point runs in a process
  /// of its own, and crashes, limits and interrupts hit one point only; without, points run in this process, one after
  /// another. Results are the same.
  std::vector<std::string> point_command = {};
  int jobs = 1;               ///< processes at a time
  ProcessLimits limits = {};  ///< of each process
  /// Called before each point, every few milliseconds while processes run, and after the last point with done = total =
  /// the points that have ended; returning false stops: points in flight are given up (in this process: the running one
  /// is finished), what is finished is written, with a warning.
  std::function<bool(const Progress&)> progress = {};
};

/// Runs a config: expands [sweep], runs the pipeline on every point (bisecting first where [bisect] asks for it),
/// decides the claims, draws figures and writes the folder (record.json, table.*, meshes/, figures/, report.html).
///
/// Sections of the runner, beside those of the pipeline: title, source, pipeline, [sweep], [bisect], [compare],
/// [[claim]], [[plot]], [output]; docs/running.md describes them.
///
/// Every row has a `status`: "ok", or of a point of a sweep without result "failed", "crashed", "timed_out" or
/// "out_of_memory", with `reason` and no metrics.
///
/// Throws UsageError for configs that make no sense (before anything runs) and when another run is writing to the
/// folder; of a config without sweep, whatever the pipeline throws, and SolverError for a crash or a limit.
Record run_experiment(const Config& config, const Registry<PipelineEntry>& pipelines, const RunOptions& options);

/// Checks a config and throws as run_experiment does, without running anything but what reading needs.
/// Returns the number of points.
int check_experiment(const Config& config, const Registry<PipelineEntry>& pipelines);

/// Runs one point of a run whose run_experiment started this program, and writes it into the folder of the run.
/// request: what the program got on standard input. Throws what the pipeline throws.
void run_point_request(const std::string& request, const Registry<PipelineEntry>& pipelines);

}  // namespace variform
