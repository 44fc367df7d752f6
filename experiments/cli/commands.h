// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "framework/base/error.h"
#include "framework/experiment/process_pool.h"

namespace variform {

/// Set by the first SIGINT or SIGTERM; whoever runs something long looks at it and ends.
extern std::atomic<bool> interrupted;

/// What `run`, `sweep` and `reproduce` take.
struct RunArguments {
  std::string config = {};
  std::string out = {};
  std::vector<std::string> set = {};
  std::vector<std::string> grid = {};    ///< key=[values]
  std::vector<std::string> zip = {};     ///< key=[values]
  std::vector<std::string> random = {};  ///< key=[low, high], key={ min, max, ... } or key=[choices]
  std::vector<std::string> latin_hypercube = {};
  std::optional<int> samples = {};
  std::optional<std::int64_t> seed = {};
  int jobs = 1;  ///< 0: points run in this process
  ProcessLimits limits = {};
  bool resume = false;
  bool no_figures = false;
  bool quiet = false;
};

/// What `compare` takes beside.
struct CompareArguments {
  std::vector<std::string> linear = {};     ///< names of backends, or "all"
  std::vector<std::string> nonlinear = {};  ///< with both: every pair
  std::optional<int> repeats = {};
  std::optional<int> warm_up = {};
  std::optional<double> accuracy = {};
  std::string reference = {};
};

ExitCode run(const RunArguments& arguments);
ExitCode sweep(const RunArguments& arguments);
/// Runs a config with every one of a list of backends.
ExitCode compare(const RunArguments& arguments, const CompareArguments& backends);
ExitCode reproduce(const std::vector<std::string>& places, const RunArguments& arguments);
/// Runs the point that standard input asks for: the process of a point. Returns the exit code.
int point();

/// What `table` takes.
struct TableArguments {
  std::string folder = {};
  std::vector<std::string> rows = {};
  std::vector<std::string> columns = {};
  std::string value = {};
  std::string aggregate = {};
  std::string format = "md";
};

/// Prints the rows of a finished run, or a pivot of them.
ExitCode table(const TableArguments& arguments);

ExitCode list(const std::string& what);
ExitCode info(const std::string& file, bool triangulate);
ExitCode doctor();
ExitCode version();

/// Facts of this program for records: version, licence in effect, BLAS with its speed.
std::vector<std::pair<std::string, std::string>> provenance();

}  // namespace variform
