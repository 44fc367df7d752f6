// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/runner.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/utsname.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/experiment/backend_comparison.h"
#include "framework/experiment/claim.h"
#include "framework/experiment/drawing.h"
#include "framework/experiment/folder_lock.h"
#include "framework/experiment/plan.h"
#include "framework/experiment/points.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

// Largest and mean distance of images of probe points between each row and the reference row of its group.
void compare_probes(const Plan& plan, const std::vector<Point>& points, Record& record) {
  const Condition reference(plan.reference);
  const std::vector<std::string> keys = reference.keys();
  std::vector<std::string> others;
  for (const std::string& key : plan.swept_keys()) {
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) others.push_back(key);
  }
  std::map<std::string, std::size_t> references;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (succeeded(record.rows[i]) && reference.holds(record.rows[i]))
      references.emplace(group_text(record.rows[i], others), i);
  }
  if (references.empty()) record.warnings.push_back(fmt::format("compare: no row fulfils '{}'", plan.reference));
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!succeeded(record.rows[i])) continue;
    double largest = std::nan("");
    double sum = 0.0;
    std::int64_t common = 0;
    const auto found = references.find(group_text(record.rows[i], others));
    if (found != references.end()) {
      const Matrix& a = points[i].result.probes;
      const Matrix& b = points[found->second].result.probes;
      for (Eigen::Index k = 0; k < std::min(a.rows(), b.rows()); ++k) {
        const double distance = (a.row(k) - b.row(k)).norm() / points[i].result.probe_scale;
        if (!std::isfinite(distance)) continue;
        sum += distance;
        largest = std::isnan(largest) ? distance : std::max(largest, distance);
        ++common;
      }
    }
    record.rows[i].set("map_difference", largest);
    record.rows[i].set("map_difference_mean", sum / static_cast<double>(common));
    record.rows[i].set("probe_points", common);
  }
}

// Searches of the same kind share a table and a plot for each metric of interest.
void add_searches(const Plan& plan, const std::vector<Point>& points, Record& record) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::string point = group_text(record.rows[i], plan.swept_keys());
    for (const Trials& trials : points[i].result.trials) {
      record.searches.push_back({point, trials});
      Table table{.caption = fmt::format("Search: {}{}{}", trials.aim, point.empty() ? "" : ", ", point)};
      if (!trials.found) table.caption += " (not found)";
      for (const std::string& key : {trials.key, std::string("asked"), std::string("held"), trials.against}) {
        if (!key.empty()) table.columns.push_back({key});
      }
      for (const std::string& key : trials.metrics) table.columns.push_back({key});
      table.rows = trials.rows;
      record.tables.push_back(std::move(table));
    }
  }
}

// Rows next to each other in the table differ in the size alone, where the size is swept: rates are those of a group of
// rows that agree in all other swept keys. The rows get them, too, as "<metric>_eoc".
Table convergence_table(const Plan& plan, const std::string& metric, const std::string& size, std::vector<Row>& rows) {
  std::vector<std::string> others = plan.swept_keys();
  const bool grouped = std::erase(others, size) > 0;
  if (!grouped) others.clear();
  struct Group {
    std::string name;
    Table table;
    std::vector<std::size_t> places;
  };
  std::vector<Group> groups;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::string name = group_text(rows[i], others);
    auto group = std::find_if(groups.begin(), groups.end(), [&](const Group& g) { return g.name == name; });
    if (group == groups.end()) group = groups.insert(groups.end(), {name, Table(), {}});
    group->table.rows.push_back(rows[i]);
    group->places.push_back(i);
  }
  Table table{fmt::format("Convergence of {} with {}", metric, size), {}, {}};
  for (const std::string& key : plan.swept_keys()) table.columns.push_back({key});
  if (!grouped) table.columns.push_back({size});
  table.columns.push_back({metric});
  const std::vector<Column> columns = table.columns;
  for (Group& group : groups) {
    group.table.columns = columns;
    add_convergence_rate(group.table, metric, size);
    table.columns = group.table.columns;
    for (std::size_t i = 0; i < group.places.size(); ++i) {
      if (const Value* rate = group.table.rows[i].find(metric + "_eoc")) {
        rows[group.places[i]].set(metric + "_eoc", *rate);
      }
    }
    table.rows.insert(table.rows.end(), group.table.rows.begin(), group.table.rows.end());
  }
  return table;
}

std::string cpu_model() {
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line)) {
    if (line.rfind("model name", 0) == 0 && line.find(':') != std::string::npos) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

void add_provenance(const Config& config, double seconds, Record& record) {
  utsname system{};
  uname(&system);
  record.provenance.emplace_back("config file", config.file());
  record.provenance.emplace_back("date (UTC)", fmt::format("{:%Y-%m-%d %H:%M:%S}", fmt::gmtime(std::time(nullptr))));
  record.provenance.emplace_back(
      "machine", fmt::format("{}, {} threads, {} {}", cpu_model(), std::thread::hardware_concurrency(), system.sysname,
                             system.machine));
  record.provenance.emplace_back("compiler", fmt::format("{} {}", __VERSION__,
#ifdef NDEBUG
                                                         "(optimized)"
#else
                                                         "(assertions on)"
#endif
                                                         ));
  record.provenance.emplace_back(
      "Eigen", fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION));
  record.provenance.emplace_back("wall time", fmt::format("{:.2f} s", seconds));
}

void add_row(const Plan& plan, Point& point, Record& record) {
  Row row = point.values;
  const std::string where = group_text(row, plan.swept_keys());
  const auto warn = [&](const std::string& warning) {
    record.warnings.push_back(where.empty() ? warning : where + ": " + warning);
  };
  row.set("status", to_string(point.outcome));
  if (point.outcome != ProcessOutcome::ok) {
    row.set("reason", point.reason);
    warn(fmt::format("{}: {}", to_string(point.outcome), point.reason));
    // A backend that fails is a result of a comparison; files that are not there are none.
    if (!plan.backends || point.exit_code == ExitCode::data) record.failure = std::max(record.failure, point.exit_code);
  }
  for (const auto& [metric, value] : point.result.metrics.entries()) row.set(metric, value);
  const auto check_name = [&](const MeshFigure& figure) {
    const std::vector<std::string>& names = plan.pipeline->figures;
    if (std::find(names.begin(), names.end(), figure.name) != names.end()) return;
    warn(fmt::format("pipeline '{}' made a figure '{}' that it does not declare", plan.pipeline->name, figure.name));
  };
  for (const MeshFigure& figure : point.result.figures) check_name(figure);
  // A trajectory without figures is none to be drawn.
  if (const auto& frames = point.result.trajectory.frames;
      !frames.empty() && frames.front().figure.mesh.cell_count() > 0) {
    check_name(frames.front().figure);
  }
  for (const std::string& warning : point.result.warnings) warn(warning);
  record.rows.push_back(std::move(row));
}

}  // namespace

fs::path find_input(const std::string& name, const fs::path& config_folder) {
  const fs::path path(name);
  std::vector<fs::path> places;
  if (path.is_absolute()) {
    places.push_back(path);
  } else {
    places.push_back(config_folder / path);
    if (const char* data = std::getenv("VARIFORM_DATA")) {
      std::stringstream folders(data);
      std::string folder;
      while (std::getline(folders, folder, ':')) {
        if (!folder.empty()) places.push_back(fs::path(folder) / path);
      }
    }
  }
  std::vector<std::string> tried;
  for (const fs::path& place : places) {
    if (fs::exists(place)) return place;
    tried.push_back(place.lexically_normal().string());
  }
  throw DataError(fmt::format("'{}' is not there; looked at {} (further folders: environment variable VARIFORM_DATA)",
                              name, fmt::join(tried, ", ")));
}

int check_experiment(const Config& config, const Registry<PipelineEntry>& pipelines) {
  const Plan plan = read_plan(config, pipelines);
  check_points(config, plan);
  return plan.point_count();
}

Record run_experiment(const Config& config, const Registry<PipelineEntry>& pipelines, const RunOptions& options) {
  const Stopwatch watch;
  const Plan plan = read_plan(config, pipelines);
  check_points(config, plan);
  Record record;
  record.title = plan.title;
  record.source = plan.source;
  record.pipeline = plan.pipeline->name;
  record.config = config.text();
  record.swept = plan.swept_keys();
  record.camera = plan.camera;
  record.max_frames = plan.max_frames;
  record.provenance = options.provenance;
  for (const Metric& metric : plan.pipeline->metrics) record.columns.push_back(metric.column);

  std::error_code failed;
  fs::create_directories(options.folder, failed);
  if (failed) throw DataError(fmt::format("{}: cannot be created: {}", options.folder.string(), failed.message()));
  const FolderLock lock(options.folder);
  remove_unfinished_files(options.folder);
  for (const char* sub : {"meshes", "figures", "points"}) {
    fs::create_directories(options.folder / sub, failed);
    if (failed)
      throw DataError(fmt::format("{}: cannot be created: {}", (options.folder / sub).string(), failed.message()));
    remove_unfinished_files(options.folder / sub);
  }
  // A record there is one of an earlier run: it must not pass for this one, should this one fail.
  fs::remove(options.folder / "record.json", failed);
  if (failed) {
    throw DataError(
        fmt::format("{}: cannot be replaced: {}", (options.folder / "record.json").string(), failed.message()));
  }

  std::vector<Point> points = run_points(config, plan, options);
  if (plan.is_single() && points.front().exit_code != ExitCode::done) {
    const Point& point = points.front();
    const bool told = point.outcome == ProcessOutcome::failed;
    throw_error(point.exit_code, told ? point.reason : fmt::format("{}: {}", to_string(point.outcome), point.reason));
  }
  const std::size_t total = points.size();
  std::erase_if(points, [](const Point& point) { return point.outcome == ProcessOutcome::interrupted; });
  const bool complete = points.size() == total;
  if (!complete) {
    record.warnings.push_back(
        fmt::format("interrupted after {} of {} points; --resume goes on from there", points.size(), total));
  }
  for (Point& point : points) add_row(plan, point, record);

  if (plan.backends) {
    compare_backends(plan, config, points, options.figures, options.folder, record);
    for (const Metric& metric : comparison_metrics()) record.columns.push_back(metric.column);
  }
  if (!plan.reference.empty()) compare_probes(plan, points, record);
  for (const auto& [metric, size] : plan.rates) {
    record.tables.push_back(convergence_table(plan, metric, size, record.rows));
  }
  add_searches(plan, points, record);
  for (const Claim& claim : plan.claims) {
    Verdict verdict = decide(claim, record.rows, plan.swept_keys());
    if (!complete) {
      verdict.outcome = Verdict::Outcome::undecided;
      verdict.reason = "the run was interrupted";
    }
    record.verdicts.push_back(verdict);
  }
  const auto expect_key = [&](const std::string& key, const char* where) {
    if (record.rows.empty()) return;
    if (std::any_of(record.rows.begin(), record.rows.end(), [&](const Row& row) { return row.find(key) != nullptr; }))
      return;
    record.warnings.push_back(fmt::format("{}: no row has '{}'", where, key));
  };
  for (const std::string& key : plan.columns) expect_key(key, "output.columns");
  for (const auto& [metric, size] : plan.rates) {
    expect_key(metric, "output.rates");
    expect_key(size, "output.rates");
  }
  for (const PivotRequest& request : plan.pivots) {
    try {
      record.tables.push_back(pivot(record.rows, request));
    } catch (const UsageError& error) {  // known only now, and no reason to lose the results
      record.warnings.push_back(fmt::format("output.pivot of '{}': {}", request.value, error.what()));
    }
  }
  if (options.figures) draw_figures(plan, points, options.folder, record);
  add_provenance(config, watch.seconds(), record);
  std::vector<std::string> columns = plan.columns;
  if (columns.empty() && plan.backends) columns = comparison_columns();
  if (!columns.empty()) {
    if (record.failure != ExitCode::done) {
      std::erase(columns, "status");
      columns.insert(columns.begin(), {"status", "reason"});
    }
    columns.insert(columns.begin(), record.swept.begin(), record.swept.end());
  }
  write_record(record, options.folder, columns);
  return record;
}

}  // namespace variform
