// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/points.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <new>
#include <optional>
#include <set>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/checkpoint.h"
#include "framework/experiment/fingerprint.h"
#include "framework/experiment/json.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// The result is that of the upper end of the bracket; without one, of the last value tried.
PointResult bisect(const PipelineEntry& pipeline, const Config& config, const ThresholdSearch& search,
                   const Workspace& workspace) {
  std::optional<PointResult> best;
  bool best_held = false;
  Trials trials = find_threshold(search, [&](double value) {
    Config point = config;
    point.set(search.key, ConfigValue{value, 0});
    PointResult result = pipeline.run(point, workspace.part(point.text()));
    Row metrics = result.metrics;
    const bool held = search.until.holds(metrics);
    // Bisection goes down from what held to what holds.
    if (held || !best_held) best = std::move(result);
    best_held = best_held || held;
    return metrics;
  });
  PointResult result = std::move(*best);
  result.metrics.set("bisect_found", trials.found);
  result.metrics.set("bracket_low", trials.low);
  result.metrics.set("bracket_high", trials.high);
  result.metrics.set("bisect_runs", static_cast<std::int64_t>(trials.rows.size()));
  if (!trials.found) {
    result.warnings.push_back(
        fmt::format("no value of {} up to {} fulfils '{}'", search.key, search.high, search.until.text()));
  }
  result.trials.push_back(std::move(trials));
  return result;
}

constexpr const char* kUnfinished = ".unfinished";

// Where the files of a point are.
struct PointFiles {
  PointFiles(const fs::path& run_folder, int point)
      : folder(run_folder),
        name(fmt::format("point-{:04}", point)),
        checkpoint(folder / "points" / (name + ".json")),
        unfinished(folder / "points" / (name + kUnfinished)),
        fields("meshes/" + name + ".vtu"),
        series("meshes/" + name + ".pvd") {}

  // Of a frame of the series, relative to meshes/.
  std::string frame(std::size_t number) const { return fmt::format("{}/frame-{:04}.vtu", name, number); }

  fs::path folder;
  std::string name;
  fs::path checkpoint;
  fs::path unfinished;
  std::string fields;  // this and the next one relative to the folder
  std::string series;
};

// What a finished point depends on: its config, the bisection, the content of its input files, the program.
class CheckpointKeys {
 public:
  CheckpointKeys(const Config& config, const Plan& plan, const RunOptions& options) : plan_(plan) {
    if (plan.bisection) common_ = config.root().at("bisect").value().text();
    if (plan.backends) common_ = fmt::format("\n# {} runs after {}", plan.backends->repeats, plan.backends->warm_up);
    for (const auto& [name, fact] : options.provenance) {
      if (name == "variform") common_ += fmt::format("\n# version {}", fact);
    }
  }

  std::string operator()(const Config& at) {
    std::string key = at.text() + common_;
    if (!plan_.pipeline->inputs) return key;
    try {
      for (const fs::path& file : plan_.pipeline->inputs(at)) {
        if (!fs::is_regular_file(file)) continue;
        auto known = contents_.find(file);
        if (known == contents_.end()) known = contents_.emplace(file, identity(file)).first;
        key += known->second;
      }
    } catch (const Error&) {
      key += "\n# without its files";  // the run says what is wrong with them
    }
    return key;
  }

 private:
  static std::string identity(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    const std::string content((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
    return fmt::format("\n# {}: {} bytes, {:016x}", file.string(), content.size(), fingerprint(content));
  }

  const Plan& plan_;
  std::string common_;
  std::map<fs::path, std::string> contents_;
};

// Whether the files that a result names are there: meshes are not in the checkpoint.
bool has_files(const PointFiles& files, const PointResult& result) {
  const auto exists = [&](const std::string& file) { return fs::exists(files.folder / file); };
  const Value* const mesh = result.metrics.find("mesh");
  if (mesh != nullptr && !(exists(to_text(*mesh)) && exists(files.fields))) return false;
  const std::size_t frames = result.trajectory.frames.size();
  if (frames > 0 && !exists(files.series)) return false;
  for (std::size_t i = 0; i < frames; ++i) {
    if (!exists("meshes/" + files.frame(i))) return false;
  }
  return true;
}

std::optional<PointResult> take_point(const PointFiles& files, const std::string& key) {
  std::optional<PointResult> result = load_point(files.checkpoint, key);
  if (result && !has_files(files, *result)) result.reset();
  return result;
}

// The collection comes last, so that it never names a frame that is not there.
void write_series(const PointFiles& files, const Trajectory& trajectory) {
  const fs::path frames = files.folder / "meshes" / files.name;
  std::error_code failed;
  fs::remove(files.folder / files.series, failed);
  fs::remove_all(frames, failed);
  if (trajectory.frames.empty()) return;
  fs::create_directories(frames, failed);
  if (failed) throw DataError(fmt::format("{}: cannot be created: {}", frames.string(), failed.message()));
  std::vector<std::pair<double, std::string>> entries;
  for (const Trajectory::Frame& frame : trajectory.frames) {
    const std::string file = files.frame(entries.size());
    write_mesh(files.folder / "meshes" / file, frame.mesh, frame.fields);
    entries.emplace_back(frame.time, file);
  }
  write_pvd(files.folder / files.series, entries);
}

PointResult compute(const Plan& plan, const Config& at, const Workspace& workspace) {
  if (plan.bisection) return bisect(*plan.pipeline, at, *plan.bisection, workspace);
  if (plan.backends) return run_repeatedly(*plan.pipeline, at, *plan.backends);  // half a run is no time
  return plan.pipeline->run(at, workspace);
}

PointResult execute_point(const Plan& plan, const Config& at, const PointFiles& files, const std::string& key,
                          bool resume) {
  const Workspace workspace(files.unfinished, key, resume);
  workspace.progress(0.0);
  PointResult result;
  try {
    result = compute(plan, at, workspace);
  } catch (const Error&) {
    workspace.clear();  // it would end in the same way again
    throw;
  }
  if (!plan.backends) result.trace = {};  // only comparisons look at it
  if (result.mesh.cell_count() > 0) {
    const bool tetrahedra = result.mesh.cells.cols() == 4;
    const std::string mesh = "meshes/" + files.name + (tetrahedra ? ".mesh" : ".obj");
    if (result.uv.size() > 0) {
      write_obj_uv(files.folder / mesh, result.mesh, result.uv, result.uv_cells);
    } else if (mesh != files.fields) {
      write_mesh(files.folder / mesh, result.mesh);
    }
    write_mesh(files.folder / files.fields, result.mesh, result.fields);
    result.metrics.set("mesh", mesh);
  }
  write_series(files, result.trajectory);
  if (!result.trajectory.frames.empty()) result.metrics.set("series", files.series);
  save_point(files.checkpoint, key, result);
  workspace.clear();
  return result;
}

// Meshes and fields are on disk: only what the record and its figures need is kept.
void keep(PointResult&& result, bool figures, Point& point) {
  point.outcome = ProcessOutcome::ok;
  point.result = std::move(result);
  point.result.mesh = {};
  point.result.fields.clear();
  for (Trajectory::Frame& frame : point.result.trajectory.frames) {
    frame.mesh = {};
    frame.fields.clear();
  }
  if (!figures) {
    point.result.figures.clear();
    point.result.trajectory = {};
  }
}

void fail(ProcessOutcome outcome, ExitCode code, const std::string& reason, Point& point) {
  point.outcome = outcome;
  point.exit_code = code;
  point.reason = reason;
}

class PointRun {
 public:
  PointRun(const Config& config, const Plan& plan, const RunOptions& options)
      : config_(config),
        plan_(plan),
        options_(options),
        keys_(config, plan, options),
        points_(static_cast<std::size_t>(plan.point_count())),
        progress_{.total = plan.point_count()} {}

  std::vector<Point> run() {
    if (!options_.resume) remove_unfinished_work();
    if (options_.point_command.empty())
      run_here();
    else
      run_in_processes();
    if (options_.progress) {
      progress_.total = progress_.done;
      options_.progress(progress_);
    }
    return std::move(points_);
  }

 private:
  void remove_unfinished_work() const {
    std::error_code ignored;
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(options_.folder / "points", ignored)) {
      const fs::path extension = entry.path().extension();
      if (extension == kUnfinished || extension == Workspace::kProgress) files.push_back(entry.path());
    }
    for (const fs::path& file : files) fs::remove(file, ignored);
  }

  bool keep_going() const { return !options_.progress || options_.progress(progress_); }

  Config config_of(int point) {
    Point& at = points_[static_cast<std::size_t>(point)];
    at.values = {};
    return point_config(config_, plan_, point, at.values);
  }

  // True when there is a result of an earlier run. Else none is left that could pass for that of this one.
  bool take(int point, const std::string& key) {
    const PointFiles files(options_.folder, point);
    std::error_code ignored;
    if (options_.resume) {
      if (std::optional<PointResult> result = take_point(files, key)) {
        Workspace(files.unfinished, {}, false).clear();  // of a process that was killed between result and end
        keep(std::move(*result), options_.figures, points_[static_cast<std::size_t>(point)]);
        ++progress_.taken;
        ++progress_.done;
        return true;
      }
    }
    fs::remove(files.checkpoint, ignored);
    return false;
  }

  void count(const Point& point) {
    ++progress_.done;
    if (point.outcome != ProcessOutcome::ok) ++progress_.failed;
  }

  void run_here() {
    for (int i = 0; i < progress_.total && keep_going(); ++i) {
      const Config at = config_of(i);
      const std::string key = keys_(at);
      if (take(i, key)) continue;
      Point& point = points_[static_cast<std::size_t>(i)];
      try {
        keep(execute_point(plan_, at, PointFiles(options_.folder, i), key, options_.resume), options_.figures, point);
      } catch (const Error& error) {
        fail(ProcessOutcome::failed, error.exit_code(), error.what(), point);
      } catch (const std::bad_alloc&) {
        fail(ProcessOutcome::out_of_memory, ExitCode::solver, "an allocation failed", point);
      } catch (const std::exception& error) {
        fail(ProcessOutcome::failed, ExitCode::data, error.what(), point);  // as a process of its own
      }
      count(point);
    }
  }

  void run_in_processes() {
    std::vector<int> left;
    for (int i = 0; i < progress_.total && keep_going(); ++i) {
      if (!take(i, keys_(config_of(i)))) left.push_back(i);
    }
    const std::string config = config_.message();
    std::set<int> running;
    const auto job = [&](std::size_t number) {
      running.insert(left[number]);
      const Json request = {{"config", config},
                            {"folder", options_.folder.string()},
                            {"point", left[number]},
                            {"key", keys_(config_of(left[number]))},
                            {"resume", options_.resume}};
      return ProcessJob{options_.point_command, to_text(request, -1)};
    };
    const auto finished = [&](std::size_t number, const ProcessResult& end) {
      const int i = left[number];
      Point& point = points_[static_cast<std::size_t>(i)];
      running.erase(i);
      look_at(running);
      std::optional<PointResult> result;
      // Between its last file and its end it may be interrupted, too.
      if (end.outcome == ProcessOutcome::ok || end.outcome == ProcessOutcome::interrupted) {
        result = take_point(PointFiles(options_.folder, i), keys_(config_of(i)));
      }
      if (result) {
        // What a library writes there is seen as if it had been written by this process.
        if (!end.error.empty()) std::fwrite(end.error.data(), 1, end.error.size(), stderr);
        keep(std::move(*result), options_.figures, point);
      } else if (end.outcome == ProcessOutcome::interrupted) {
        return;
      } else if (end.outcome == ProcessOutcome::ok) {
        fail(ProcessOutcome::failed, ExitCode::data, "its files are not there or not its own", point);
      } else {
        const bool is_known =
            end.exit_code == static_cast<int>(ExitCode::usage) || end.exit_code == static_cast<int>(ExitCode::data);
        const bool told = end.outcome == ProcessOutcome::failed && is_known;
        // One that ended badly after it had written its result: what it wrote is not to be taken.
        std::error_code ignored;
        fs::remove(PointFiles(options_.folder, i).checkpoint, ignored);
        fail(end.outcome, told ? static_cast<ExitCode>(end.exit_code) : ExitCode::solver, end.reason, point);
      }
      count(point);
    };
    run_processes(left.size(), job,
                  {.jobs = options_.jobs, .limits = options_.limits, .finished = finished, .keep_going = [&] {
                     constexpr double kPause = 0.1;
                     if (looked_.seconds() > kPause) look_at(running);
                     return keep_going();
                   }});
  }

  // How far the points are that run.
  void look_at(const std::set<int>& running) {
    progress_.running = 0.0;
    for (const int point : running) {
      progress_.running += Workspace::progress_of(PointFiles(options_.folder, point).unfinished);
    }
    looked_.restart();
  }

  const Config& config_;
  const Plan& plan_;
  const RunOptions& options_;
  CheckpointKeys keys_;
  std::vector<Point> points_;
  Progress progress_;
  Stopwatch looked_;
};

}  // namespace

std::vector<Point> run_points(const Config& config, const Plan& plan, const RunOptions& options) {
  return PointRun(config, plan, options).run();
}

bool succeeded(const Row& row) {
  const Value* const status = row.find("status");
  return status == nullptr || to_text(*status) == to_string(ProcessOutcome::ok);
}

void run_point_request(const std::string& request, const Registry<PipelineEntry>& pipelines) {
  try {
    const Json json = Json::parse(request);
    const Config config = Config::from_message(json.at("config").get<std::string>());
    const Plan plan = read_plan(config, pipelines);
    const int point = json.at("point").get<int>();
    if (point < 0 || point >= plan.point_count()) throw UsageError(fmt::format("there is no point {}", point));
    Row ignored;
    execute_point(plan, point_config(config, plan, point, ignored),
                  PointFiles(json.at("folder").get<std::string>(), point), json.at("key").get<std::string>(),
                  json.at("resume").get<bool>());
  } catch (const Json::exception& error) {
    throw UsageError(fmt::format("no request of a run: {}", error.what()));
  }
}

}  // namespace variform
