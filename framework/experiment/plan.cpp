// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/plan.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/known_keys.h"

namespace variform {
namespace {

const std::vector<std::string> kRunnerKeys = {"title",   "source",   "pipeline", "requires", "sweep", "bisect",
                                              "compare", "backends", "claim",    "plot",     "output"};

const std::vector<std::string> kBisectionKeys = {"bisect_found", "bracket_low", "bracket_high", "bisect_runs"};

// A key whose value the runner sets must lead into a section that the pipeline reads: anything else would be a sweep of
// equal points.
void check_key(const ConfigNode& place, const std::string& key, const ConfigValue& value, const Config& config,
               const Plan& plan) {
  const std::string section = key.substr(0, key.find_first_of(".["));
  const std::vector<std::string>& sections = plan.pipeline->sections;
  if (std::find(sections.begin(), sections.end(), section) == sections.end()) {
    place.fail(fmt::format("'{}' is in no section of pipeline '{}'; its sections: {}", key, plan.pipeline->name,
                           fmt::join(sections, ", ")));
  }
  place.located([&] {
    Config changed = config;
    changed.set(key, value);
    return 0;
  });
}

// Variants would replace what the sweep sets: rows would name a value that they do not have.
void check_sweep(const Plan& plan, const Config& config) {
  for (const auto& [key, value] : plan.sweep.values(0)) {
    const std::string section = key.substr(0, key.find_first_of(".[", std::string("solver.").size()));
    for (const BackendVariant& variant : plan.backends->variants) {
      for (const auto& [setting, ignored] : variant.settings) {
        if (section != "solver." + setting && section != "solver." + setting + "_options") continue;
        ConfigNode(value, config.file(), "sweep." + key)
            .fail(fmt::format("'{}' is what the variants of [backends] differ in", key));
      }
    }
  }
}

Camera read_camera(const ConfigNode& node) {
  node.accept_keys(config_section("[output.camera]").names());
  Camera camera;
  const auto vector = [&node](const char* key, const Eigen::Vector3d& fallback) -> Eigen::Vector3d {
    if (!node.has(key)) return fallback;
    const std::vector<double> values = node.at(key).numbers();
    if (values.size() != 3) node.at(key).fail("expected three numbers");
    return {values[0], values[1], values[2]};
  };
  camera.direction = vector("direction", camera.direction);
  camera.up = vector("up", camera.up);
  camera.zoom = node.number_or("zoom", camera.zoom);
  const std::string projection = node.string_or("projection", "orthographic");
  if (projection != "orthographic" && projection != "perspective") {
    node.at("projection").fail("expected \"orthographic\" or \"perspective\"");
  }
  camera.perspective = projection == "perspective";
  node.located([&] { return View(camera, Eigen::Vector3d::Zero(), 1.0); });
  return camera;
}

// What claims, columns, rates and plots name must be something that rows will have: a name that none has would show
// after the run, as a claim that nothing decides.
void check_keys(const ConfigNode& root, const Plan& plan) {
  KnownKeys known;
  known.add("swept keys", plan.swept_keys());
  std::vector<std::string> metrics;
  for (const Metric& metric : plan.pipeline->metrics) metrics.push_back(metric.column.key);
  known.add(fmt::format("metrics of '{}'", plan.pipeline->name), metrics);
  KnownKeys of_pipeline = known;
  std::vector<std::string> own = {"status", "reason", "mesh", "series"};
  if (plan.backends) {
    for (const Metric& metric : comparison_metrics()) own.push_back(metric.column.key);
  }
  if (!plan.sweep.seed_keys().empty()) own.emplace_back("seed");
  if (plan.bisection) own.insert(own.end(), kBisectionKeys.begin(), kBisectionKeys.end());
  if (!plan.reference.empty()) own.insert(own.end(), {"map_difference", "map_difference_mean", "probe_points"});
  for (const auto& [metric, size] : plan.rates) own.push_back(metric + "_eoc");
  known.add("set by the runner", own);

  if (plan.bisection) of_pipeline.require(root.at("bisect").at("until"), plan.bisection->until);
  if (root.has("claim")) {
    for (const ConfigNode& node : root.at("claim").elements()) {
      known.require(node.at("metric"), node.at("metric").string());
      if (node.has("along")) known.require(node.at("along"), node.at("along").string());
      for (const char* key : {"where", "relative_to", "minus"}) {
        if (node.has(key)) known.require(node.at(key), Condition(node.at(key).string()));
      }
    }
  }
  if (root.has("plot")) {
    for (const ConfigNode& node : root.at("plot").elements()) {
      for (const char* key : {"x", "y"}) known.require(node.at(key), node.at(key).string());
      if (node.has("where")) known.require(node.at("where"), Condition(node.at("where").string()));
      if (!node.has("series")) continue;
      for (const ConfigNode& key : node.at("series").elements(true)) known.require(key, key.string());
    }
  }
  if (!root.has("output")) return;
  const ConfigNode output = root.at("output");
  if (output.has("columns")) {
    for (const ConfigNode& key : output.at("columns").elements()) known.require(key, key.string());
  }
  if (output.has("pivot")) {
    for (const ConfigNode& request : output.at("pivot").elements()) {
      for (const char* key : {"rows", "columns"}) {
        if (!request.has(key)) continue;
        for (const ConfigNode& element : request.at(key).elements(true)) known.require(element, element.string());
      }
      known.require(request.at("value"), request.at("value").string());
    }
  }
  if (output.has("rates")) {
    for (const ConfigNode& rate : output.at("rates").children()) {
      known.require(rate, rate.name());
      known.require(rate, rate.string());
    }
  }
}

Value as_value(const ConfigValue& value) {
  if (const auto* flag = std::get_if<bool>(&value.data)) return *flag;
  if (const auto* integer = std::get_if<std::int64_t>(&value.data)) return *integer;
  if (const auto* number = std::get_if<double>(&value.data)) return *number;
  if (const auto* text = std::get_if<std::string>(&value.data)) return *text;
  return value.text();
}

}  // namespace

std::vector<std::string> Plan::swept_keys() const {
  std::vector<std::string> keys = sweep.keys();
  if (backends) keys.emplace_back(kBackendKey);
  return keys;
}

Plan read_plan(const Config& config, const Registry<PipelineEntry>& pipelines) {
  const ConfigNode root = config.root();
  Plan plan;
  const ConfigNode pipeline = root.at("pipeline");
  plan.pipeline = &pipeline.located([&]() -> const PipelineEntry& { return pipelines.find(pipeline.string()); });
  std::vector<std::string> accepted = kRunnerKeys;
  accepted.insert(accepted.end(), plan.pipeline->sections.begin(), plan.pipeline->sections.end());
  root.accept_keys(accepted);
  plan.title = root.string_or("title", std::filesystem::path(config.file()).stem().string());
  plan.source = root.string_or("source", "");
  if (root.has("requires")) root.at("requires").strings();
  if (root.has("sweep")) {
    const ConfigNode node = root.at("sweep");
    plan.sweep = Sweep(node);
    for (const auto& [key, value] : plan.sweep.values(0)) {
      check_key(ConfigNode(value, config.file(), "sweep." + key), key, value, config, plan);
    }
    for (const std::string& key : plan.sweep.seed_keys()) {
      check_key(node.at("seed_key"), key, ConfigValue{plan.sweep.seed(0), 0}, config, plan);
    }
  }
  if (root.has("backends")) {
    const ConfigNode node = root.at("backends");
    const std::vector<std::string>& sections = plan.pipeline->sections;
    if (std::find(sections.begin(), sections.end(), "solver") == sections.end()) {
      node.fail(fmt::format("pipeline '{}' has no [solver] to choose backends in", plan.pipeline->name));
    }
    plan.backends = read_backends(node);
    if (root.has("bisect")) root.at("bisect").fail("a comparison of backends does not bisect");
    check_sweep(plan, config);
  }
  if (root.has("bisect")) {
    const ConfigNode node = root.at("bisect");
    node.accept_keys(config_section("[bisect]").names());
    ThresholdSearch bisection;
    bisection.key = node.at("key").string();
    bisection.low = node.at("low").number();
    bisection.high = node.at("high").number();
    bisection.absolute_tolerance = node.number_or("tolerance", 1e-3);
    bisection.max_trials = std::numeric_limits<int>::max();
    bisection.until = node.at("until").located([&] { return Condition(node.at("until").string()); });
    if (plan.sweep.has(bisection.key)) node.at("key").fail(fmt::format("'{}' is swept already", bisection.key));
    check_key(node.at("key"), bisection.key, ConfigValue{bisection.low, 0}, config, plan);
    if (!(bisection.low < bisection.high && std::isfinite(bisection.high - bisection.low))) {
      node.fail("expected low < high");
    }
    if (!(bisection.absolute_tolerance > 0.0)) node.at("tolerance").fail("expected a positive number");
    plan.bisection = bisection;
  }
  if (root.has("compare")) {
    const ConfigNode node = root.at("compare");
    node.accept_keys(config_section("[compare]").names());
    plan.reference = node.at("reference").string();
    const Condition reference = node.at("reference").located([&] { return Condition(plan.reference); });
    for (const std::string& key : reference.keys()) {
      if (!plan.sweep.has(key)) node.at("reference").fail(fmt::format("'{}' is not swept", key));
    }
    if (plan.reference.empty()) node.at("reference").fail("expected a condition on swept keys");
  }
  if (root.has("claim")) {
    for (const ConfigNode& node : root.at("claim").elements()) plan.claims.push_back(read_claim(node));
  }
  if (root.has("plot")) {
    for (const ConfigNode& node : root.at("plot").elements()) {
      node.accept_keys(config_section("[[plot]]").names());
      PlotRequest plot;
      plot.x = node.at("x").string();
      plot.y = node.at("y").string();
      plot.name = node.string_or("name", fmt::format("plot-{}", plan.plots.size() + 1));
      plot.title = node.string_or("title", plot.y + " against " + plot.x);
      if (node.has("series")) {
        for (const ConfigNode& key : node.at("series").elements(true)) plot.series.push_back(key.string());
      }
      if (node.has("where"))
        plot.where = node.at("where").located([&] { return Condition(node.at("where").string()); });
      plot.log_x = node.boolean_or("log_x", false);
      plot.log_y = node.boolean_or("log_y", false);
      if (plot.name.find_first_of("/\\") != std::string::npos) node.at("name").fail("expected a file name");
      plan.plots.push_back(plot);
    }
  }
  if (!plan.backends) {
    plan.figures = plan.pipeline->figures;
    plan.figures.emplace_back("curves");
  }
  if (root.has("output")) {
    const ConfigNode node = root.at("output");
    node.accept_keys(config_section("[output]").names());
    if (node.has("columns")) plan.columns = node.at("columns").strings();
    if (node.has("pivot")) {
      for (const ConfigNode& request : node.at("pivot").elements()) plan.pivots.push_back(read_pivot(request));
    }
    if (node.has("figures")) {
      plan.figures = node.at("figures").strings();
      std::vector<std::string> names = plan.pipeline->figures;
      names.insert(names.end(), {"history", "curves"});
      for (const ConfigNode& figure : node.at("figures").elements()) {
        if (std::find(names.begin(), names.end(), figure.string()) == names.end()) {
          figure.fail(fmt::format("pipeline '{}' has no figure \"{}\"; expected \"{}\"", plan.pipeline->name,
                                  figure.string(), fmt::join(names, "\", \"")));
        }
      }
    }
    if (node.has("rates")) {
      for (const ConfigNode& rate : node.at("rates").children()) plan.rates.emplace_back(rate.name(), rate.string());
    }
    const auto count = [&](const char* key, int fallback) {
      if (!node.has(key)) return fallback;
      const std::int64_t value = node.at(key).integer();
      if (value < 0 || value > 1000) node.at(key).fail("expected an integer from 0 to 1000");
      return static_cast<int>(value);
    };
    plan.max_panels = count("max_panels", plan.max_panels);
    plan.max_frames = count("max_frames", plan.max_frames);
    plan.panel_columns = count("panel_columns", plan.panel_columns);
    const std::string colour = node.string_or("colour", "logarithmic");
    if (colour != "logarithmic" && colour != "linear") node.at("colour").fail("expected \"logarithmic\" or \"linear\"");
    plan.logarithmic = colour == "logarithmic";
    if (node.has("camera")) plan.camera = read_camera(node.at("camera"));
  }
  check_keys(root, plan);
  return plan;
}

Config point_config(const Config& config, const Plan& plan, int point, Row& values) {
  Config result = config;
  const int variants = plan.backends ? static_cast<int>(plan.backends->variants.size()) : 1;
  const int problem = point / variants;
  for (const auto& [key, value] : plan.sweep.values(problem)) {
    result.set(key, value);
    values.set(key, as_value(value));
  }
  if (plan.backends) {
    const BackendVariant& variant = plan.backends->variants[static_cast<std::size_t>(point % variants)];
    apply(variant, result);
    values.set(kBackendKey, variant.name);
  }
  if (!plan.sweep.seed_keys().empty()) {
    const std::int64_t seed = plan.sweep.seed(problem);
    for (const std::string& key : plan.sweep.seed_keys()) result.set(key, ConfigValue{seed, 0});
    values.set("seed", seed);
  }
  for (const std::string& key : kRunnerKeys) result.erase(key);
  return result;
}

void check_points(const Config& config, const Plan& plan) {
  if (!plan.pipeline->check) return;
  for (int point = 0; point < plan.point_count(); ++point) {
    Row ignored;
    Config at = point_config(config, plan, point, ignored);
    if (plan.bisection) at.set(plan.bisection->key, ConfigValue{plan.bisection->low, 0});
    plan.pipeline->check(at);
    if (!plan.bisection) continue;
    at.set(plan.bisection->key, ConfigValue{plan.bisection->high, 0});
    plan.pipeline->check(at);
  }
}

std::string group_text(const Row& row, const std::vector<std::string>& keys, int digits) {
  std::vector<std::string> parts;
  for (const std::string& key : keys) {
    const Value* const value = row.find(key);
    if (value == nullptr) continue;
    const std::string name = key.substr(key.rfind('.') == std::string::npos ? 0 : key.rfind('.') + 1);
    parts.push_back(std::holds_alternative<std::string>(*value)
                        ? to_text(*value)
                        : fmt::format("{} = {}", name, to_text(*value, digits)));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

}  // namespace variform
