// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/pipeline.h"
#include "framework/experiment/record.h"

namespace variform {

struct Plan;
struct Point;

/// The key of rows that names the variant.
inline constexpr const char* kBackendKey = "backend";

/// One of the backends that a comparison runs every problem with: the keys that it sets in [solver].
struct BackendVariant {
  std::string name;
  std::vector<std::pair<std::string, ConfigValue>> settings;
};

/// [backends] of a config: every point of the sweep is a problem, solved by every variant. As TOML:
///
///   [backends]
///   repeats = 5                   # timed runs of each, after
///   warm_up = 1                   # runs that are not counted
///   accuracy = 1e-6               # solved: converged, with an energy at most this share above the lowest one found
///   reference = "newton"          # whose solution the others are compared with; default: the lowest energy
///   [[backends.variant]]
///   name = "newton"               # default: the backends' names
///   nonlinear = "newton"          # linear, linear_options, nonlinear, nonlinear_options of [solver]
///
/// Everything else of [solver], the stopping criterion above all, is the same for all.
struct BackendComparison {
  int repeats = 5;
  int warm_up = 1;
  double accuracy = 1e-6;
  std::string reference = {};
  std::vector<BackendVariant> variants = {};
};

/// Reads [backends]; throws UsageError with file, line and key when it makes no sense.
BackendComparison read_backends(const ConfigNode& node);

/// Puts the variant's keys into [solver]. Options in the config that belong to another backend go.
void apply(const BackendVariant& variant, Config& config);

/// Runs a point as often as the comparison says: the last result, with the median of all times (metrics in seconds),
/// seconds_min and seconds_max of seconds_total, and the peak memory of the process.
PointResult run_repeatedly(const PipelineEntry& pipeline, const Config& config, const BackendComparison& backends);

/// What the rows of a comparison have beside the metrics of the pipeline.
std::vector<Metric> comparison_metrics();
/// The columns that its tables show unless the config says which.
std::vector<std::string> comparison_columns();

/// Rows get `objective`, `excess`, `difference`, `solved` and `rate`; the record gets tables of the pairwise
/// differences of solutions, convergence plots (energy against iterations and time, residuals of iterative linear
/// backends) and, of two problems or more, a performance profile. points: those of the record's rows, in their order.
void compare_backends(const Plan& plan, const Config& config, const std::vector<Point>& points, bool figures,
                      const std::filesystem::path& folder, Record& record);

}  // namespace variform
