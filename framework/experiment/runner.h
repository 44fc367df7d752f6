// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/pipeline.h"
#include "framework/experiment/record.h"

namespace variform {

struct RunOptions {
  std::filesystem::path folder;  ///< where everything goes; created
  bool figures = true;
  bool resume = false;  ///< take points that a previous run of the same config finished
  /// Facts of the program that runs (its version, licence, BLAS); the runner adds machine, date and config.
  std::vector<std::pair<std::string, std::string>> provenance = {};
  /// Called before each point with its number and the count of points, after the last with both equal; returning false
  /// stops: what is finished is written, with a warning.
  std::function<bool(int done, int total)> progress = {};
};

/// Runs a config: expands [sweep], runs the pipeline on every point (bisecting first where [bisect] asks for it),
/// decides the claims, draws figures and writes the folder (record.json, table.*, meshes/, figures/, report.html).
///
/// Sections of the runner, beside those of the pipeline: title, source, pipeline, [sweep], [bisect], [compare],
/// [[claim]], [[plot]], [output]; docs/running.md describes them.
///
/// Throws UsageError for configs that make no sense (before anything runs), and whatever the pipeline throws.
Record run_experiment(const Config& config, const Registry<PipelineEntry>& pipelines, const RunOptions& options);

/// Checks a config and throws as run_experiment does, without running anything but what reading needs.
/// Returns the number of points.
int check_experiment(const Config& config, const Registry<PipelineEntry>& pipelines);

}  // namespace variform
