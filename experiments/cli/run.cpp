// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <new>
#include <optional>

#include "experiments/cli/commands.h"
#include "experiments/cli/progress_bar.h"
#include "experiments/pipelines.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/runner.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

void print_warnings(const Record& record) {
  for (const std::string& warning : record.warnings) fmt::print(stderr, "warning: {}\n", warning);
}

// The columns of the printed table: those that the config names, or a readable choice; swept keys first.
std::vector<std::string> shown_columns(const Record& record, const Config& config) {
  std::vector<std::string> columns;
  if (const ConfigNode root = config.root(); root.has("output") && root.at("output").has("columns")) {
    const std::vector<std::string> chosen = root.at("output").at("columns").strings();
    columns.insert(columns.end(), chosen.begin(), chosen.end());
  } else if (root.has("backends")) {
    columns.insert(columns.end(),
                   {"status", "converged", "solved", "excess", "difference", "iterations", "seconds_total",
                    "seconds_min", "seconds_max", "seconds_per_iteration", "peak_memory"});
  } else {
    const bool searched = std::any_of(record.rows.begin(), record.rows.end(),
                                      [](const Row& row) { return row.find("beta_found") != nullptr; });
    if (searched) columns.insert(columns.end(), {"beta", "beta_found"});
    columns.insert(columns.end(), {"vertices", "cells", "energy", "energy_R", "energy_W", "flipped", "min_det",
                                   "local_energy_max", "iterations", "converged", "solver_residual"});
  }
  if (record.failure != ExitCode::done) {
    std::erase(columns, "status");
    columns.insert(columns.begin(), {"status", "reason"});
  }
  columns.insert(columns.begin(), record.swept.begin(), record.swept.end());
  return columns;
}

// One kind of sweep from the command line: its assignments are keys of [sweep].
struct SweepOption {
  const char* name;
  const char* kind;
  const std::vector<std::string>* assignments;
  bool is_sampled;
};

// [low, high] is a range; a list of anything else are choices, a table is a range as in a config.
ConfigValue range_of(const ConfigValue& value) {
  const auto* const array = std::get_if<ConfigValue::Array>(&value.data);
  if (array == nullptr || array->size() != 2) return value;
  const auto is_integer = [](const ConfigValue& v) { return std::holds_alternative<std::int64_t>(v.data); };
  const auto is_number = [&](const ConfigValue& v) { return is_integer(v) || std::holds_alternative<double>(v.data); };
  if (!is_number((*array)[0]) || !is_number((*array)[1])) return value;
  ConfigValue::Table range = {{"min", (*array)[0]}, {"max", (*array)[1]}};
  if (is_integer((*array)[0]) && is_integer((*array)[1])) range.emplace_back("integer", ConfigValue{true, 0});
  return {range, 0};
}

// The kind that a config says or, where it has swept keys, means.
std::optional<std::string> swept_kind(const Config& config) {
  if (!config.root().has("sweep")) return std::nullopt;
  const ConfigNode sweep = config.root().at("sweep");
  if (sweep.has("kind")) return sweep.at("kind").string();
  const std::vector<std::string> reserved = config_section("[sweep]").names();
  for (const ConfigNode& child : sweep.children()) {
    if (std::find(reserved.begin(), reserved.end(), child.name()) == reserved.end()) return "grid";
  }
  return std::nullopt;
}

void add_sweep(const RunArguments& arguments, Config& config) {
  const SweepOption options[] = {{"--grid", "grid", &arguments.grid, false},
                                 {"--zip", "zip", &arguments.zip, false},
                                 {"--random", "random", &arguments.random, true},
                                 {"--lhs", "latin_hypercube", &arguments.latin_hypercube, true}};
  const SweepOption* chosen = nullptr;
  for (const SweepOption& option : options) {
    if (option.assignments->empty()) continue;
    if (chosen != nullptr) throw UsageError(fmt::format("{} and {} cannot be mixed", chosen->name, option.name));
    chosen = &option;
  }
  if (chosen != nullptr) {
    const std::string kind = swept_kind(config).value_or(chosen->kind);
    if (kind != chosen->kind) {
      throw UsageError(
          fmt::format("{}: the config sweeps by kind = \"{}\"; --set sweep={{}} takes that away", chosen->name, kind));
    }
    if (kind != "grid") config.set("sweep.kind", ConfigValue{kind, 0});
    for (const std::string& assignment : *chosen->assignments) {
      const std::size_t equals = assignment.find('=');
      if (equals == std::string::npos) {
        throw UsageError(fmt::format("{} {}: expected key={}", chosen->name, assignment,
                                     chosen->is_sampled ? "[low, high]" : "[values]"));
      }
      const std::string key = assignment.substr(0, equals);
      const std::string path = "sweep.\"" + key + "\"";
      config.set(path + assignment.substr(equals));
      if (chosen->is_sampled) config.set(path, range_of(config.root().at("sweep").at(key).value()));
    }
  }
  if (arguments.samples) config.set("sweep.samples", ConfigValue{std::int64_t{*arguments.samples}, 0});
  if (arguments.seed) config.set("sweep.seed", ConfigValue{*arguments.seed, 0});
}

Config configured(const RunArguments& arguments) {
  Config config = Config::load(arguments.config);
  for (const std::string& assignment : arguments.set) {
    const std::string key = config.set(assignment);
    // A value given by hand stands: neither it nor anything inside it is swept any more.
    if (key.rfind("sweep", 0) == 0 || !config.root().has("sweep")) continue;
    std::vector<std::string> swept;
    for (const ConfigNode& child : config.root().at("sweep").children()) swept.push_back(child.path().substr(6));
    for (const std::string& name : swept) {
      if (name == key || name.rfind(key + ".", 0) == 0) config.erase("sweep.\"" + name + "\"");
    }
    if (key.find('"') == std::string::npos) config.erase("sweep." + key);
    if (!config.root().at("sweep").has("seed_key")) continue;
    ConfigValue::Array seed_keys;
    for (const ConfigNode& name : config.root().at("sweep").at("seed_key").elements(true)) {
      if (name.string() != key && name.string().rfind(key + ".", 0) != 0) seed_keys.push_back(name.value());
    }
    if (seed_keys.empty()) {
      config.erase("sweep.seed_key");
    } else {
      config.set("sweep.seed_key", {seed_keys, 0});
    }
  }
  add_sweep(arguments, config);
  return config;
}

ConfigValue text(const std::string& value) { return {value, 0}; }

// The variants of [backends] by names of backends.
std::vector<ConfigValue> variants(const CompareArguments& arguments) {
  const auto names = [](const std::vector<std::string>& given, const auto& registry) {
    if (given != std::vector<std::string>{"all"}) return given.empty() ? std::vector<std::string>{""} : given;
    std::vector<std::string> all;
    for (const auto& entry : registry.entries()) {
      if (entry.available) all.push_back(entry.name);
    }
    return all;
  };
  std::vector<ConfigValue> result;
  for (const std::string& nonlinear : names(arguments.nonlinear, nonlinear_backends())) {
    for (const std::string& linear : names(arguments.linear, linear_backends())) {
      ConfigValue::Table variant;
      if (!nonlinear.empty()) variant.emplace_back("nonlinear", text(nonlinear));
      if (!linear.empty()) variant.emplace_back("linear", text(linear));
      result.push_back({variant, 0});
    }
  }
  return result;
}

void set_backends(const CompareArguments& arguments, Config& config) {
  if (!arguments.linear.empty() || !arguments.nonlinear.empty()) {
    // What another kind of experiment states, draws and searches is not about backends.
    if (!config.root().has("backends")) {
      for (const char* section : {"claim", "plot", "compare", "bisect", "output"}) config.erase(section);
    }
    config.set("backends.variant", {variants(arguments), 0});
  } else if (!config.root().has("backends")) {
    throw UsageError(fmt::format("{}: nothing to compare: the config has no [backends]; give --linear or --nonlinear",
                                 config.file()));
  }
  if (arguments.repeats) config.set("backends.repeats", {std::int64_t{*arguments.repeats}, 0});
  if (arguments.warm_up) config.set("backends.warm_up", {std::int64_t{*arguments.warm_up}, 0});
  if (arguments.accuracy) config.set("backends.accuracy", {*arguments.accuracy, 0});
  if (!arguments.reference.empty()) config.set("backends.reference", text(arguments.reference));
}

Record run_config(const Config& config, const RunArguments& arguments) {
  if (arguments.out.empty()) throw UsageError("--out: expected a folder");
  if (arguments.jobs == 0 && (arguments.limits.seconds > 0.0 || arguments.limits.memory_mib > 0.0)) {
    throw UsageError("--time-limit and --memory-limit need processes: --jobs 1 or more");
  }
  const ProgressBar bar(!arguments.quiet && isatty(STDERR_FILENO) != 0);
  RunOptions options{.folder = arguments.out,
                     .figures = !arguments.no_figures,
                     .resume = arguments.resume,
                     .provenance = provenance(),
                     .jobs = std::max(1, arguments.jobs),
                     .limits = arguments.limits,
                     .progress = [&bar](const Progress& progress) {
                       bar.show(progress);
                       return !interrupted;
                     }};
  if (arguments.jobs > 0) options.point_command = {kThisProgram, "point"};
  return run_experiment(config, pipelines(), options);
}

ExitCode run_and_show(const Config& config, const RunArguments& arguments) {
  const Record record = run_config(config, arguments);
  print_warnings(record);
  if (!arguments.quiet) {
    fmt::print("{}\n", record_table(record, shown_columns(record, config)).markdown());
    if (!record.verdicts.empty()) fmt::print("{}\n", claims_table(record.verdicts).markdown());
    fmt::print("Report: {}\n", (fs::absolute(arguments.out) / "report.html").lexically_normal().string());
  }
  return record.failure;
}

fs::path shipped_experiments() {
  // Installed programs may have been moved together with their data.
  std::error_code unknown;
  const fs::path program = fs::read_symlink("/proc/self/exe", unknown);
  const fs::path beside = (program.parent_path() / VARIFORM_RELATIVE_EXPERIMENTS).lexically_normal();
  for (const fs::path& place : {beside, fs::path(VARIFORM_SOURCE_EXPERIMENTS)}) {
    if (fs::is_directory(place)) return place;
  }
  throw DataError("the shipped experiments are not there; name config files or folders");
}

std::vector<fs::path> find_configs(const std::vector<std::string>& places) {
  std::vector<fs::path> roots(places.begin(), places.end());
  if (roots.empty()) roots.push_back(shipped_experiments());
  std::vector<fs::path> configs;
  for (const fs::path& root : roots) {
    if (fs::is_directory(root)) {
      for (const auto& entry : fs::recursive_directory_iterator(root)) {
        if (entry.path().extension() == ".toml") configs.push_back(entry.path());
      }
    } else if (fs::exists(root)) {
      configs.push_back(root);
    } else {
      throw UsageError(fmt::format("{}: no such config or folder", root.string()));
    }
  }
  std::sort(configs.begin(), configs.end());
  if (configs.empty()) throw UsageError("no configs found");
  return configs;
}

// Configs whose inputs are not on this machine say so by `requires`.
std::string missing_input(const Config& config) {
  if (!config.root().has("requires")) return {};
  for (const std::string& file : config.root().at("requires").strings()) {
    try {
      find_input(file, config.folder());
    } catch (const DataError&) {
      return file;
    }
  }
  return {};
}

}  // namespace

ExitCode run(const RunArguments& arguments) { return run_and_show(configured(arguments), arguments); }

ExitCode compare(const RunArguments& arguments, const CompareArguments& backends) {
  Config config = configured(arguments);
  set_backends(backends, config);
  return run_and_show(config, arguments);
}

ExitCode sweep(const RunArguments& arguments) {
  if (const Config config = configured(arguments); !config.root().has("sweep")) {
    throw UsageError(fmt::format(
        "{}: nothing to sweep: the config has no [sweep]; give --grid key=[values], --zip, --random or --lhs",
        arguments.config));
  }
  return run(arguments);
}

ExitCode reproduce(const std::vector<std::string>& places, const RunArguments& arguments) {
  std::vector<Verdict> all;
  int failed = 0;
  int broken = 0;
  ExitCode worst = ExitCode::done;
  Table overview{"Claims", {{"experiment"}, {"statement"}, {"published"}, {"ours"}, {"verdict"}}, {}};
  for (const fs::path& path : find_configs(places)) {
    if (interrupted) break;
    const std::string name = fs::absolute(path).parent_path().filename().string() + "/" + path.stem().string();
    const auto add = [&](const std::string& statement, const std::string& published, const std::string& ours,
                         const std::string& verdict) {
      Row row;
      row.set("experiment", name);
      row.set("statement", statement);
      row.set("published", published);
      row.set("ours", ours);
      row.set("verdict", verdict);
      overview.rows.push_back(row);
    };
    try {
      RunArguments at = arguments;
      at.config = path.string();
      at.out = (fs::path(arguments.out) / name).string();
      const Config config = configured(at);
      if (const std::string missing = missing_input(config); !missing.empty()) {
        if (!arguments.quiet) fmt::print(stderr, "{}: skipped, '{}' is not on this machine\n", name, missing);
        add("(not run)", "", fmt::format("input '{}' is not there", missing), "skipped");
        continue;
      }
      if (!arguments.quiet) fmt::print(stderr, "{} ...\n", name);
      const Record record = run_config(config, at);
      if (record.failure != ExitCode::done) {
        print_warnings(record);
        worst = std::max(worst, record.failure);
        ++broken;
      }
      for (const Verdict& verdict : record.verdicts) {
        add(verdict.text, verdict.published, verdict.ours.empty() ? verdict.reason : verdict.ours,
            to_string(verdict.outcome));
        failed += verdict.outcome != Verdict::Outcome::holds;
      }
      all.insert(all.end(), record.verdicts.begin(), record.verdicts.end());
    } catch (const Error& error) {
      fmt::print(stderr, "error: {}: {}\n", name, error.what());
      add("(did not run)", "", error.what(), "error");
      ++broken;
      worst = std::max(worst, error.exit_code());
    }
  }
  std::error_code error;
  fs::create_directories(arguments.out, error);
  if (error) throw DataError(fmt::format("{}: cannot be created: {}", arguments.out, error.message()));
  write_file(fs::path(arguments.out) / "claims.md", overview.markdown());
  write_file(fs::path(arguments.out) / "claims.csv", overview.csv());
  fmt::print("{}\n{} claims, {} of them not held; {} experiments with errors\n", overview.markdown(), all.size(),
             failed, broken);
  if (worst != ExitCode::done) return worst;
  return failed > 0 ? ExitCode::claim_failed : ExitCode::done;
}

int point() {
  const std::string request(std::istreambuf_iterator<char>(std::cin), {});
  try {
    run_point_request(request, pipelines());
  } catch (const std::bad_alloc&) {
    return kExitOutOfMemory;
  }
  return static_cast<int>(ExitCode::done);
}

}  // namespace variform
