// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "framework/experiment/backend_comparison.h"
#include "framework/experiment/claim.h"
#include "framework/experiment/config.h"
#include "framework/experiment/pipeline.h"
#include "framework/experiment/pivot.h"
#include "framework/experiment/search.h"
#include "framework/experiment/sweep.h"

namespace variform {

/// A [[plot]] of a config.
struct PlotRequest {
  std::string name, title, x, y;
  std::vector<std::string> series;
  Condition where;
  bool log_x = false;
  bool log_y = false;
};

/// The runner's share of a config, checked.
struct Plan {
  const PipelineEntry* pipeline = nullptr;
  std::string title, source;
  Sweep sweep;
  std::optional<BackendComparison> backends;  ///< every point of the sweep is run with each of its variants
  std::optional<ThresholdSearch> bisection;
  std::string reference;  ///< [compare]
  std::vector<Claim> claims;
  std::vector<PlotRequest> plots;
  std::vector<PivotRequest> pivots;
  std::vector<std::string> figures;
  std::vector<std::string> columns;
  std::vector<std::pair<std::string, std::string>> rates;  ///< metric, size
  int max_panels = 24;
  int max_frames = 60;  ///< of an animation in the report, for each point
  int panel_columns = 0;
  bool logarithmic = true;
  Camera camera;

  /// The swept keys and, in a comparison, "backend".
  std::vector<std::string> swept_keys() const;
  int point_count() const { return sweep.point_count() * (backends ? static_cast<int>(backends->variants.size()) : 1); }
  /// Whether the config is one point, whose failure is that of the run.
  bool is_single() const { return sweep.is_empty() && !backends; }
};

/// Reads the runner's sections; throws UsageError with file, line and key when they make no sense.
Plan read_plan(const Config& config, const Registry<PipelineEntry>& pipelines);

/// Config of a point: the swept values and seeds in their places, the runner's sections gone. `values`: the swept keys
/// with their values and, where the sweep has seed keys, "seed".
Config point_config(const Config& config, const Plan& plan, int point, Row& values);

/// Checks every point by the pipeline's check; throws what that throws.
void check_points(const Config& config, const Plan& plan);

/// The given keys of a row in words, for titles: "arap, beta = 0.2". digits: of numbers; 0: all.
std::string group_text(const Row& row, const std::vector<std::string>& keys, int digits = 0);

}  // namespace variform
