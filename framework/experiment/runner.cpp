// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/runner.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/utsname.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <sstream>
#include <thread>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/experiment/checkpoint.h"
#include "framework/experiment/claim.h"
#include "framework/experiment/figure.h"
#include "framework/experiment/known_keys.h"
#include "framework/experiment/search.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kRunnerKeys = {"title",  "source",  "pipeline", "requires", "sweep",
                                              "bisect", "compare", "claim",    "plot",     "output"};

struct SweptKey {
  std::string key;
  std::vector<ConfigValue> values;
};

struct PlotRequest {
  std::string name, title, x, y;
  std::vector<std::string> series;
  Condition where;
  bool log_x = false;
  bool log_y = false;
};

// The runner's share of a config, checked.
struct Plan {
  const PipelineEntry* pipeline = nullptr;
  std::string title, source;
  std::vector<SweptKey> sweep;
  std::optional<ThresholdSearch> bisection;
  std::string reference;  // [compare]
  std::vector<Claim> claims;
  std::vector<PlotRequest> plots;
  std::vector<std::string> figures;
  std::vector<std::string> columns;
  std::vector<std::pair<std::string, std::string>> rates;
  int max_panels = 24;
  int panel_columns = 0;
  bool logarithmic = true;
  Camera camera;

  std::vector<std::string> swept_keys() const {
    std::vector<std::string> keys;
    for (const SweptKey& swept : sweep) keys.push_back(swept.key);
    return keys;
  }
  bool is_swept(const std::string& key) const {
    return std::any_of(sweep.begin(), sweep.end(), [&](const SweptKey& swept) { return swept.key == key; });
  }
  int point_count() const {
    int count = 1;
    for (const SweptKey& swept : sweep) count *= static_cast<int>(swept.values.size());
    return count;
  }
};

constexpr int kMaxPoints = 100000;

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
  if (plan.is_swept(key)) place.fail(fmt::format("'{}' is swept already", key));
  place.located([&] {
    Config changed = config;
    changed.set(key, value);
    return 0;
  });
}

void read_sweep(const ConfigNode& node, const std::string& prefix, const Config& config, Plan& plan) {
  for (const ConfigNode& child : node.children()) {
    // The last part of the path as it stands: keys such as "energy.type" may be quoted or nested tables.
    const std::string name = child.path().substr(node.path().size() + 1);
    const std::string key = prefix.empty() ? name : prefix + "." + name;
    if (child.value().is_table()) {
      read_sweep(child, key, config, plan);
      continue;
    }
    SweptKey swept{key, {}};
    for (const ConfigNode& element : child.elements()) swept.values.push_back(element.value());
    if (swept.values.empty()) child.fail("expected at least one value");
    if (swept.values.size() > static_cast<std::size_t>(kMaxPoints / plan.point_count())) {
      child.fail(fmt::format("the sweep has more than {} points", kMaxPoints));
    }
    check_key(child, key, swept.values.front(), config, plan);
    plan.sweep.push_back(swept);
  }
}

Camera read_camera(const ConfigNode& node) {
  node.accept_keys({"direction", "up", "zoom", "projection"});
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
  std::vector<std::string> own = {"mesh"};
  if (plan.bisection) own.insert(own.end(), kBisectionKeys.begin(), kBisectionKeys.end());
  if (!plan.reference.empty()) own.insert(own.end(), {"map_difference", "probe_points"});
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
  if (output.has("rates")) {
    for (const ConfigNode& rate : output.at("rates").children()) {
      known.require(rate, rate.name());
      known.require(rate, rate.string());
    }
  }
}

Plan read_plan(const Config& config, const Registry<PipelineEntry>& pipelines) {
  const ConfigNode root = config.root();
  Plan plan;
  const ConfigNode pipeline = root.at("pipeline");
  plan.pipeline = &pipeline.located([&]() -> const PipelineEntry& { return pipelines.find(pipeline.string()); });
  std::vector<std::string> accepted = kRunnerKeys;
  accepted.insert(accepted.end(), plan.pipeline->sections.begin(), plan.pipeline->sections.end());
  root.accept_keys(accepted);
  plan.title = root.string_or("title", fs::path(config.file()).stem().string());
  plan.source = root.string_or("source", "");
  if (root.has("requires")) root.at("requires").strings();
  if (root.has("sweep")) read_sweep(root.at("sweep"), "", config, plan);
  if (root.has("bisect")) {
    const ConfigNode node = root.at("bisect");
    node.accept_keys({"key", "low", "high", "tolerance", "until"});
    ThresholdSearch bisection;
    bisection.key = node.at("key").string();
    bisection.low = node.at("low").number();
    bisection.high = node.at("high").number();
    bisection.absolute_tolerance = node.number_or("tolerance", 1e-3);
    bisection.max_trials = std::numeric_limits<int>::max();
    bisection.until = node.at("until").located([&] { return Condition(node.at("until").string()); });
    check_key(node.at("key"), bisection.key, ConfigValue{bisection.low, 0}, config, plan);
    if (!(bisection.low < bisection.high && std::isfinite(bisection.high - bisection.low))) {
      node.fail("expected low < high");
    }
    if (!(bisection.absolute_tolerance > 0.0)) node.at("tolerance").fail("expected a positive number");
    plan.bisection = bisection;
  }
  if (root.has("compare")) {
    const ConfigNode node = root.at("compare");
    node.accept_keys({"reference"});
    plan.reference = node.at("reference").string();
    const Condition reference = node.at("reference").located([&] { return Condition(plan.reference); });
    for (const std::string& key : reference.keys()) {
      if (!plan.is_swept(key)) node.at("reference").fail(fmt::format("'{}' is not swept", key));
    }
    if (plan.reference.empty()) node.at("reference").fail("expected a condition on swept keys");
  }
  if (root.has("claim")) {
    for (const ConfigNode& node : root.at("claim").elements()) plan.claims.push_back(read_claim(node));
  }
  if (root.has("plot")) {
    for (const ConfigNode& node : root.at("plot").elements()) {
      node.accept_keys({"name", "title", "x", "y", "series", "where", "log_x", "log_y"});
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
  plan.figures = plan.pipeline->figures;
  if (root.has("output")) {
    const ConfigNode node = root.at("output");
    node.accept_keys({"columns", "figures", "rates", "max_panels", "panel_columns", "colour", "camera"});
    if (node.has("columns")) plan.columns = node.at("columns").strings();
    if (node.has("figures")) {
      plan.figures = node.at("figures").strings();
      std::vector<std::string> names = plan.pipeline->figures;
      names.emplace_back("history");
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
    plan.panel_columns = count("panel_columns", plan.panel_columns);
    const std::string colour = node.string_or("colour", "logarithmic");
    if (colour != "logarithmic" && colour != "linear") node.at("colour").fail("expected \"logarithmic\" or \"linear\"");
    plan.logarithmic = colour == "logarithmic";
    if (node.has("camera")) plan.camera = read_camera(node.at("camera"));
  }
  check_keys(root, plan);
  return plan;
}

Value as_value(const ConfigValue& value) {
  if (const auto* flag = std::get_if<bool>(&value.data)) return *flag;
  if (const auto* integer = std::get_if<std::int64_t>(&value.data)) return *integer;
  if (const auto* number = std::get_if<double>(&value.data)) return *number;
  if (const auto* text = std::get_if<std::string>(&value.data)) return *text;
  return value.text();
}

// A point's config: the swept values in their places, the runner's sections gone.
Config point_config(const Config& config, const Plan& plan, int point, Row& swept_values) {
  Config result = config;
  int rest = point;
  int block = plan.point_count();
  for (const SweptKey& swept : plan.sweep) {
    block /= static_cast<int>(swept.values.size());
    const ConfigValue& value = swept.values[static_cast<std::size_t>(rest / block)];
    rest %= block;
    result.set(swept.key, value);
    swept_values.set(swept.key, as_value(value));
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

// The result is that of the upper end of the bracket; without one, of the last value tried.
PointResult bisect(const PipelineEntry& pipeline, const Config& config, const ThresholdSearch& search) {
  std::optional<PointResult> best;
  bool best_held = false;
  Trials trials = find_threshold(search, [&](double value) {
    Config point = config;
    point.set(search.key, ConfigValue{value, 0});
    PointResult result = pipeline.run(point);
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

std::string assignments(const Row& swept) {
  std::vector<std::string> parts;
  for (const auto& [key, value] : swept.entries()) parts.push_back(fmt::format("{} = {}", key, to_text(value)));
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::string panel_title(const Row& swept) {
  std::vector<std::string> parts;
  for (const auto& [key, value] : swept.entries()) {
    const std::string name = key.substr(key.rfind('.') == std::string::npos ? 0 : key.rfind('.') + 1);
    parts.push_back(std::holds_alternative<std::string>(value) ? to_text(value)
                                                               : fmt::format("{} = {}", name, to_text(value)));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::string group_text(const Row& row, const std::vector<std::string>& keys) {
  Row chosen;
  for (const std::string& key : keys) {
    if (const Value* value = row.find(key)) chosen.set(key, *value);
  }
  return panel_title(chosen);
}

// Largest distance of images of probe points between each row and the reference row of its group.
void compare_probes(const Plan& plan, const std::vector<PointResult>& results, Record& record) {
  const Condition reference(plan.reference);
  const std::vector<std::string> keys = reference.keys();
  std::vector<std::string> others;
  for (const std::string& key : plan.swept_keys()) {
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) others.push_back(key);
  }
  std::map<std::string, std::size_t> references;
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (reference.holds(record.rows[i])) references.emplace(group_text(record.rows[i], others), i);
  }
  if (references.empty()) record.warnings.push_back(fmt::format("compare: no row fulfils '{}'", plan.reference));
  for (std::size_t i = 0; i < results.size(); ++i) {
    double largest = std::nan("");
    std::int64_t common = 0;
    const auto found = references.find(group_text(record.rows[i], others));
    if (found != references.end()) {
      const Matrix& a = results[i].probes;
      const Matrix& b = results[found->second].probes;
      for (Eigen::Index k = 0; k < std::min(a.rows(), b.rows()); ++k) {
        const double distance = (a.row(k) - b.row(k)).norm() / results[i].probe_scale;
        if (!std::isfinite(distance)) continue;
        largest = std::isnan(largest) ? distance : std::max(largest, distance);
        ++common;
      }
    }
    record.rows[i].set("map_difference", largest);
    record.rows[i].set("probe_points", common);
  }
}

LinePlot line_plot(const PlotRequest& request, const std::vector<Row>& rows) {
  LinePlot plot{request.title, request.x, request.y, request.log_x, request.log_y, {}};
  for (const Row& row : rows) {
    if (!request.where.holds(row)) continue;
    const Value* x = row.find(request.x);
    const Value* y = row.find(request.y);
    if (x == nullptr || y == nullptr) continue;
    const std::string label = group_text(row, request.series);
    auto curve = std::find_if(plot.curves.begin(), plot.curves.end(), [&](const Curve& c) { return c.label == label; });
    if (curve == plot.curves.end()) curve = plot.curves.insert(plot.curves.end(), Curve{label, {}, {}});
    curve->x.push_back(to_number(*x));
    curve->y.push_back(to_number(*y));
  }
  for (Curve& curve : plot.curves) {
    std::vector<std::pair<double, double>> points;
    for (std::size_t i = 0; i < curve.x.size(); ++i) points.emplace_back(curve.x[i], curve.y[i]);
    std::stable_sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t i = 0; i < points.size(); ++i) std::tie(curve.x[i], curve.y[i]) = points[i];
  }
  return plot;
}

void add_plot(const LinePlot& plot, const std::string& name, const fs::path& folder, Record& record) {
  if (const auto missing = draw_plot(plot, folder / "figures" / name))
    record.warnings.push_back(*missing);
  else
    record.figures.push_back({plot.title, "figures/" + name});
}

// What a reader needs to know of the marks that occur in a picture.
std::string legend(const std::vector<MeshFigure>& panels) {
  const auto any = [&panels](auto member) {
    return std::any_of(panels.begin(), panels.end(), [member](const MeshFigure& f) { return !(f.*member).empty(); });
  };
  std::vector<std::string> parts;
  if (any(&MeshFigure::fixed_vertices)) parts.emplace_back("squares: fixed vertices");
  if (any(&MeshFigure::moved_vertices)) parts.emplace_back("discs: moved ones");
  if (any(&MeshFigure::soft_vertices)) parts.emplace_back("open circles: soft constraints");
  if (any(&MeshFigure::flipped_cells)) parts.emplace_back("red outlines: flipped cells");
  if (parts.empty()) return {};
  std::string text = fmt::format(" {}.", fmt::join(parts, "; "));
  text[1] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[1])));
  return text;
}

// One picture of the figures of a name, a panel for each point.
void draw_figure(const Plan& plan, const std::string& name, std::vector<PointResult>& results, const fs::path& folder,
                 Record& record) {
  std::vector<MeshFigure> panels;
  std::vector<Vector> values;
  for (std::size_t i = 0; i < results.size(); ++i) {
    for (MeshFigure& figure : results[i].figures) {
      if (figure.name != name) continue;
      if (static_cast<int>(panels.size()) >= plan.max_panels) {
        record.warnings.push_back(
            fmt::format("the figure '{}' shows the first {} results only (output.max_panels)", name, plan.max_panels));
        i = results.size() - 1;
        break;
      }
      panels.push_back(std::move(figure));
      MeshFigure& panel = panels.back();
      panel.title = group_text(record.rows[i], plan.swept_keys());
      const auto flipped = panel.flipped_cells.size();
      if (flipped > 0) panel.title += fmt::format("{}{} flipped", panel.title.empty() ? "" : ", ", flipped);
      if (panel.uv.size() == 0) values.push_back(panel.cell_values);
    }
  }
  if (panels.empty()) return;
  const std::string given = panels.front().scale.label;
  const ColourScale scale = common_scale(values, plan.logarithmic, given.empty() ? "cell energy" : given);
  for (MeshFigure& panel : panels) panel.scale = scale;
  draw_meshes(panels, folder / "figures" / name, plan.panel_columns, plan.camera);
  std::string caption = panels.front().caption;
  if (caption.empty()) {
    caption = panels.front().uv.size() > 0 ? fmt::format("Figure '{}': image of a checkerboard.", name)
                                           : fmt::format("Figure '{}'; cells are coloured by: {}.", name, scale.label);
  }
  record.figures.push_back({caption + legend(panels), "figures/" + name});
  const double check_size = common_check_size(panels);
  for (MeshFigure& panel : panels) {
    if (!panel.is_spatial()) continue;
    if (panel.check_size == 0.0) panel.check_size = check_size;
    record.spatial.push_back(std::move(panel));
  }
}

// Steps over two decades and more are seen on a logarithmic axis only. Values that are not positive have no place
// there; of the searched key, that is the lower end 0.
bool is_logarithmic(const std::vector<Curve>& curves, std::vector<double> Curve::*values, bool zeros) {
  double low = std::numeric_limits<double>::infinity();
  double high = 0.0;
  for (const Curve& curve : curves) {
    for (const double value : curve.*values) {
      if (value < 0.0 || (value == 0.0 && !zeros)) return false;
      if (!(value > 0.0) || !std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  return high >= 100.0 * low;
}

// Searches of the same kind share a table and a plot for each metric of interest.
void add_searches(const Plan& plan, const std::vector<PointResult>& results, Record& record) {
  for (std::size_t i = 0; i < results.size(); ++i) {
    const std::string point = group_text(record.rows[i], plan.swept_keys());
    for (const Trials& trials : results[i].trials) {
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

void draw_searches(const fs::path& folder, Record& record) {
  struct Group {
    const Trials* first;
    std::string metric;
    LinePlot plot;
  };
  std::vector<Group> groups;
  for (const auto& [point, trials] : record.searches) {
    const std::string& x = trials.against.empty() ? trials.key : trials.against;
    for (const std::string& metric : trials.metrics) {
      auto group = std::find_if(groups.begin(), groups.end(), [&trials = trials, &metric](const Group& g) {
        return g.first->aim == trials.aim && g.metric == metric;
      });
      if (group == groups.end()) {
        LinePlot plot{.title = "Search: " + trials.aim, .x_label = x, .y_label = metric};
        group = groups.insert(groups.end(), Group{&trials, metric, std::move(plot)});
      }
      std::vector<std::pair<double, double>> points;
      for (const Row& row : trials.rows) {
        const Value* const at = row.find(x);
        const Value* const value = row.find(metric);
        if (at == nullptr || value == nullptr) continue;
        points.emplace_back(to_number(*at), to_number(*value));
        const double tried = to_number(*row.find(trials.key));
        const bool is_mark =
            trials.against.empty() ? tried == trials.low || tried == trials.high : tried == trials.value;
        if (trials.found && is_mark) group->plot.marks.push_back(to_number(*at));
      }
      std::stable_sort(points.begin(), points.end());
      Curve curve{.label = point.empty() ? metric : point};
      for (const auto& [at, value] : points) {
        curve.x.push_back(at);
        curve.y.push_back(value);
      }
      group->plot.curves.push_back(std::move(curve));
    }
  }
  for (std::size_t i = 0; i < groups.size(); ++i) {
    LinePlot& plot = groups[i].plot;
    plot.log_x = is_logarithmic(plot.curves, &Curve::x, true);
    plot.log_y = is_logarithmic(plot.curves, &Curve::y, false);
    add_plot(plot, fmt::format("search-{}", i + 1), folder, record);
    if (plot.marks.empty() || record.figures.empty()) continue;
    std::string& caption = record.figures.back().caption;
    if (caption == plot.title) {
      caption += groups[i].first->against.empty() ? ". Dashed: ends of the bracket." : ". Dashed: the corner.";
    }
  }
}

void draw_figures(const Plan& plan, std::vector<PointResult>& results, const fs::path& folder, Record& record) {
  const auto wanted = [&](const std::string& name) {
    return std::find(plan.figures.begin(), plan.figures.end(), name) != plan.figures.end();
  };
  const std::vector<std::string> swept = plan.swept_keys();
  for (const std::string& name : plan.pipeline->figures) {
    if (wanted(name)) draw_figure(plan, name, results, folder, record);
  }
  if (wanted("history")) {
    LinePlot plot{"Convergence", "iteration", "E (regularized energy); relative step", false, true, {}};
    for (std::size_t i = 0; i < results.size(); ++i) {
      for (const Curve& curve : results[i].history) {
        const std::string group = group_text(record.rows[i], swept);
        plot.curves.push_back({group.empty() ? curve.label : curve.label + ", " + group, curve.x, curve.y});
      }
    }
    if (!plot.curves.empty()) add_plot(plot, "history", folder, record);
  }
  draw_searches(folder, record);
  for (const PlotRequest& request : plan.plots) {
    try {
      const LinePlot plot = line_plot(request, record.rows);
      if (plot.curves.empty())
        record.warnings.push_back(
            fmt::format("plot '{}': no row has both '{}' and '{}'", request.name, request.x, request.y));
      else
        add_plot(plot, request.name, folder, record);
    } catch (const UsageError& error) {  // a condition that rows cannot decide must not cost the results
      record.warnings.push_back(fmt::format("plot '{}': {}", request.name, error.what()));
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

// What a finished point depends on: its config, the bisection, the content of its input files, the program.
std::string checkpoint_key(const Config& config, const Plan& plan, const Config& at, const RunOptions& options) {
  std::string key = at.text();
  if (plan.bisection) key += config.root().at("bisect").value().text();
  for (const auto& [name, fact] : options.provenance) {
    if (name == "variform") key += fmt::format("\n# version {}", fact);
  }
  if (!plan.pipeline->inputs) return key;
  for (const fs::path& file : plan.pipeline->inputs(at)) {
    if (!fs::is_regular_file(file)) continue;  // reading the mesh says what is wrong with it
    std::ifstream stream(file, std::ios::binary);
    const std::string content((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
    std::uint64_t hash = 0xcbf29ce484222325ULL;  // FNV-1a
    for (const char c : content) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
    key += fmt::format("\n# {}: {} bytes, {:016x}", file.string(), content.size(), hash);
  }
  return key;
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
  record.provenance = options.provenance;
  for (const Metric& metric : plan.pipeline->metrics) record.columns.push_back(metric.column);

  std::error_code failed;
  for (const char* sub : {"meshes", "figures", "points"}) {
    fs::create_directories(options.folder / sub, failed);
    if (failed)
      throw DataError(fmt::format("{}: cannot be created: {}", (options.folder / sub).string(), failed.message()));
  }
  // A record there is one of an earlier run: it must not pass for this one, should this one fail.
  fs::remove(options.folder / "record.json", failed);
  if (failed) {
    throw DataError(
        fmt::format("{}: cannot be replaced: {}", (options.folder / "record.json").string(), failed.message()));
  }

  const int total = plan.point_count();
  std::vector<PointResult> results;
  for (int point = 0; point < total; ++point) {
    if (options.progress && !options.progress(point, total)) {
      record.warnings.push_back(
          fmt::format("interrupted after {} of {} points; --resume goes on from there", point, total));
      break;
    }
    Row row;
    const Config at = point_config(config, plan, point, row);
    const std::string key = checkpoint_key(config, plan, at, options);
    const std::string name = fmt::format("point-{:04}", point);
    const fs::path checkpoint = options.folder / "points" / (name + ".json");
    const std::string fields = "meshes/" + name + ".vtu";
    std::optional<PointResult> result;
    if (options.resume) result = load_point(checkpoint, key);
    // Only the mesh itself is not in the checkpoint.
    const Value* const written = result ? result->metrics.find("mesh") : nullptr;
    if (written != nullptr &&
        !(fs::exists(options.folder / to_text(*written)) && fs::exists(options.folder / fields))) {
      result.reset();
    }
    if (!result) {
      fs::remove(checkpoint, failed);  // it does not belong to the mesh that is written next
      try {
        result = plan.bisection ? bisect(*plan.pipeline, at, *plan.bisection) : plan.pipeline->run(at);
      } catch (const Error& error) {
        if (plan.sweep.empty()) throw;
        throw_error(error.exit_code(), fmt::format("{} (at {})", error.what(), assignments(row)));
      }
      if (result->mesh.cell_count() > 0) {
        const bool tetrahedra = result->mesh.cells.cols() == 4;
        const std::string mesh = "meshes/" + name + (tetrahedra ? ".mesh" : ".obj");
        if (result->uv.size() > 0) {
          write_obj_uv(options.folder / mesh, result->mesh, result->uv, result->uv_cells);
        } else if (mesh != fields) {
          write_mesh(options.folder / mesh, result->mesh);
        }
        write_mesh(options.folder / fields, result->mesh, result->fields);
        result->metrics.set("mesh", mesh);
      }
      save_point(checkpoint, key, *result);
    }
    for (const auto& [metric, value] : result->metrics.entries()) row.set(metric, value);
    for (const MeshFigure& figure : result->figures) {
      const std::vector<std::string>& names = plan.pipeline->figures;
      if (std::find(names.begin(), names.end(), figure.name) != names.end()) continue;
      result->warnings.push_back(
          fmt::format("pipeline '{}' made a figure '{}' that it does not declare", plan.pipeline->name, figure.name));
    }
    for (const std::string& warning : result->warnings) {
      const std::string where = group_text(row, plan.swept_keys());
      record.warnings.push_back(where.empty() ? warning : where + ": " + warning);
    }
    record.rows.push_back(row);
    // Meshes and fields are on disk: only what figures need is kept.
    result->mesh = {};
    result->fields.clear();
    results.push_back(std::move(*result));
  }
  if (options.progress) options.progress(static_cast<int>(results.size()), static_cast<int>(results.size()));

  if (!plan.reference.empty()) compare_probes(plan, results, record);
  for (const auto& [metric, size] : plan.rates) {
    record.tables.push_back(convergence_table(plan, metric, size, record.rows));
  }
  add_searches(plan, results, record);
  const bool complete = static_cast<int>(results.size()) == total;
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
  if (options.figures) draw_figures(plan, results, options.folder, record);
  add_provenance(config, watch.seconds(), record);
  std::vector<std::string> columns = plan.columns;
  if (!columns.empty()) columns.insert(columns.begin(), record.swept.begin(), record.swept.end());
  write_record(record, options.folder, columns);
  return record;
}

}  // namespace variform
