// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/backend_comparison.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <numeric>
#include <optional>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/drawing.h"
#include "framework/experiment/performance_profile.h"
#include "framework/experiment/plan.h"
#include "framework/experiment/points.h"

namespace variform {
namespace {

constexpr int kMaxRuns = 1000;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinite = std::numeric_limits<double>::infinity();
// Energies this far below that of the start are rounding: the minimum is zero.
constexpr double kRoundingEnergy = 1e-20;

BackendVariant read_variant(const ConfigNode& node) {
  node.accept_keys(config_section("[[backends.variant]]").names());
  BackendVariant variant;
  std::vector<std::string> names;
  for (const char* backend : {"nonlinear", "linear"}) {
    const std::string options = std::string(backend) + "_options";
    if (node.has(backend)) {
      names.push_back(node.at(backend).string());
      variant.settings.emplace_back(backend, node.at(backend).value());
    }
    if (!node.has(options)) continue;
    if (!node.at(options).value().is_table()) node.at(options).fail("expected a table");
    variant.settings.emplace_back(options, node.at(options).value());
  }
  if (variant.settings.empty()) node.fail("expected at least one of linear, nonlinear and their options");
  variant.name = node.string_or("name", fmt::format("{}", fmt::join(names, ", ")));
  if (variant.name.empty()) node.fail("expected a name, as there is no backend to name it after");
  return variant;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

// Of this program: getrusage counts what the process was before it became this program, too.
double peak_memory_mib() {
  std::ifstream status("/proc/self/status");
  std::string word;
  double kib = kNone;
  while (status >> word) {
    if (word == "VmHWM:") status >> kib;
  }
  return kib / 1024.0;
}

double number(const Row& row, const std::string& key) {
  const Value* const value = row.find(key);
  return value == nullptr ? kNone : to_number(*value);
}

// The rows of one problem, by their numbers, and what their energies are measured against.
struct Problem {
  std::vector<std::size_t> rows;
  std::string name;
  double lowest = kInfinite;  // objective
  double scale = 1.0;         // of differences of objectives
};

bool converged(const Row& row) {
  const Value* const value = row.find("converged");
  return succeeded(row) && (value == nullptr || to_text(*value) == "true");
}

double excess(const Problem& problem, double energy) { return (energy - problem.lowest) / problem.scale; }

// Factor by which the excess of the energy shrinks in an iteration: the mean over the last half of those whose energy
// still differs from the lowest one by more than rounding.
double convergence_rate(const Problem& problem, const std::vector<double>& energies) {
  constexpr double kVisible = 1e-12;
  std::vector<double> logarithms;
  for (const double energy : energies) {
    const double share = excess(problem, energy);
    if (!(share > kVisible)) break;
    logarithms.push_back(std::log(share));
  }
  if (logarithms.size() < 3) return kNone;
  const std::size_t first = (logarithms.size() - 1) / 2;
  return std::exp((logarithms.back() - logarithms[first]) / static_cast<double>(logarithms.size() - 1 - first));
}

// The solution that others are compared with: that of the named variant, else of the lowest energy among those that
// converged; of linear problems, whose energies are equal, that of the smallest residual.
std::optional<std::size_t> reference_row(const Plan& plan, const Problem& problem, const std::vector<Point>& points,
                                         const std::vector<Row>& rows) {
  std::optional<std::size_t> best;
  double best_measure = kInfinite;
  for (const std::size_t i : problem.rows) {
    if (!succeeded(rows[i]) || points[i].result.trace.solution.size() == 0) continue;
    if (!plan.backends->reference.empty()) {
      if (to_text(*rows[i].find(kBackendKey)) == plan.backends->reference) return i;
      continue;
    }
    const bool nonlinear = !points[i].result.trace.energy.empty();
    double measure = number(rows[i], nonlinear ? "objective" : "solver_residual");
    if (!converged(rows[i]) || std::isnan(measure)) measure = kInfinite;
    if (!best || measure < best_measure) {
      best = i;
      best_measure = measure;
    }
  }
  return best;
}

double difference(const SolveTrace& a, const SolveTrace& b) {
  if (a.solution.size() == 0 || a.solution.rows() != b.solution.rows() || a.solution.cols() != b.solution.cols()) {
    return kNone;
  }
  return (a.solution - b.solution).cwiseAbs().maxCoeff() / a.length_scale;
}

Table difference_table(const Problem& problem, const std::vector<Point>& points, const std::vector<Row>& rows) {
  Table table{fmt::format("Largest difference of solutions by the diameter{}{}", problem.name.empty() ? "" : ": ",
                          problem.name),
              {{kBackendKey}},
              {}};
  for (const std::size_t i : problem.rows) {
    if (!succeeded(rows[i])) continue;
    const std::string name = to_text(*rows[i].find(kBackendKey));
    table.columns.push_back({.key = name, .digits = 2});
    Row row;
    row.set(kBackendKey, name);
    for (const std::size_t j : problem.rows) {
      if (j == i) break;
      if (!succeeded(rows[j])) continue;
      row.set(to_text(*rows[j].find(kBackendKey)), difference(points[i].result.trace, points[j].result.trace));
    }
    table.rows.push_back(row);
  }
  table.columns.pop_back();  // the last one has no entries
  return table;
}

void draw_convergence(const Problem& problem, std::size_t number, const std::vector<Point>& points,
                      const std::vector<Row>& rows, const std::filesystem::path& folder, Record& record) {
  const std::string suffix = problem.name.empty() ? "" : ": " + problem.name;
  LinePlot iterations{
      "Energy above the lowest one against iterations" + suffix, "iteration", "(E - E*) / E*", false, true, {}};
  LinePlot time{"Energy above the lowest one against time" + suffix, "seconds", "(E - E*) / E*", true, true, {}};
  LinePlot residuals{"Residuals of linear solves" + suffix, "iteration", "relative residual", false, true, {}};
  for (const std::size_t i : problem.rows) {
    const SolveTrace& trace = points[i].result.trace;
    const std::string name = to_text(*rows[i].find(kBackendKey));
    Curve by_iteration{name, {}, {}};
    Curve by_time{name, {}, {}};
    for (std::size_t k = 0; k < trace.energy.size(); ++k) {
      const double share = excess(problem, trace.energy[k]);
      if (!(share > 1e-16)) continue;  // the lowest one itself has no place on a logarithmic axis
      by_iteration.x.push_back(static_cast<double>(k));
      by_iteration.y.push_back(share);
      if (trace.seconds[k] <= 0.0) continue;
      by_time.x.push_back(trace.seconds[k]);
      by_time.y.push_back(share);
    }
    if (!by_iteration.x.empty()) iterations.curves.push_back(by_iteration);
    if (!by_time.x.empty()) time.curves.push_back(by_time);
    if (trace.linear_residuals.empty()) continue;
    Curve curve{name, {}, {}};
    for (std::size_t k = 0; k < trace.linear_residuals.size(); ++k) {
      curve.x.push_back(static_cast<double>(k));
      curve.y.push_back(trace.linear_residuals[k]);
    }
    residuals.curves.push_back(curve);
  }
  const std::string place = fmt::format("-{}", number + 1);
  if (!iterations.curves.empty()) add_plot(iterations, "energy-iterations" + place, folder, record);
  if (!time.curves.empty()) add_plot(time, "energy-time" + place, folder, record);
  if (!residuals.curves.empty()) add_plot(residuals, "residuals" + place, folder, record);
}

void draw_profile(const Plan& plan, const std::vector<Problem>& problems, const std::filesystem::path& folder,
                  Record& record) {
  std::vector<SolverCosts> solvers;
  for (const BackendVariant& variant : plan.backends->variants) solvers.push_back({variant.name, {}});
  for (const Problem& problem : problems) {
    for (SolverCosts& solver : solvers) {
      double cost = kInfinite;
      for (const std::size_t i : problem.rows) {
        const Row& row = record.rows[i];
        if (to_text(*row.find(kBackendKey)) != solver.solver || to_text(*row.find("solved")) != "true") continue;
        cost = number(row, "seconds_total");
      }
      solver.costs.push_back(cost);
    }
  }
  LinePlot plot{
      fmt::format("Performance profile of {} problems", problems.size()),
      "log2 of the factor",
      "share of the problems",
      false,
      false,
      {}};
  try {
    plot.curves = performance_profile(solvers);
    add_plot(plot, "profile", folder, record);
  } catch (const UsageError& error) {  // a pipeline without times, which is no reason to lose the results
    record.warnings.emplace_back(error.what());
  }
}

std::vector<Problem> problems_of(const Plan& plan, const std::vector<Point>& points, const std::vector<Row>& rows) {
  std::vector<std::string> keys = plan.sweep.keys();
  keys.emplace_back("seed");
  const auto variant = [&](std::size_t i) { return to_text(*rows[i].find(kBackendKey)); };
  std::vector<Problem> problems;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::string name = group_text(rows[i], keys);
    // Rows of a problem are next to each other; a sampled sweep may have equal problems.
    const auto repeats = [&](std::size_t other) { return variant(other) == variant(i); };
    if (problems.empty() || problems.back().name != name ||
        std::any_of(problems.back().rows.begin(), problems.back().rows.end(), repeats)) {
      problems.push_back({.rows = {}, .name = name});
    }
    problems.back().rows.push_back(i);
  }
  for (Problem& problem : problems) {
    double start = 0.0;
    for (const std::size_t i : problem.rows) {
      const std::vector<double>& energy = points[i].result.trace.energy;
      const double own = points[i].result.trace.objective;
      if (std::isfinite(own)) problem.lowest = std::min(problem.lowest, own);
      if (!energy.empty() && std::isfinite(energy.front())) start = std::max(start, energy.front());
    }
    const double size = std::abs(problem.lowest);
    problem.scale = size > kRoundingEnergy * start && std::isfinite(size) ? size : std::max(start, 1e-300);
  }
  return problems;
}

// The stopping criterion in words: the values of [solver] that all variants share; rows have those that are swept.
std::string criterion(const Plan& plan, const Config& config) {
  std::vector<std::string> parts;
  for (const Section& section : plan.pipeline->parameters) {
    if (section.name != "solver") continue;
    for (const Parameter& parameter : section.parameters) {
      if (parameter.name != "tolerance" && parameter.name != "gradient_tolerance" && parameter.name != "max_iterations")
        continue;
      std::string value = to_string(parameter.value);
      if (config.root().has("solver") && config.root().at("solver").has(parameter.name)) {
        value = config.root().at("solver").at(parameter.name).value().text();
      }
      const std::string key = "solver." + parameter.name;
      if (plan.sweep.has(key) || plan.sweep.has("solver")) value = "as swept";
      parts.push_back(fmt::format("{} = {}", parameter.name, value));
    }
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

}  // namespace

BackendComparison read_backends(const ConfigNode& node) {
  node.accept_keys(config_section("[backends]").names());
  BackendComparison backends;
  const auto count = [&](const char* key, int fallback, int least) {
    if (!node.has(key)) return fallback;
    const std::int64_t value = node.at(key).integer();
    if (value < least || value > kMaxRuns) node.at(key).fail(fmt::format("expected {} to {}", least, kMaxRuns));
    return static_cast<int>(value);
  };
  backends.repeats = count("repeats", backends.repeats, 1);
  backends.warm_up = count("warm_up", backends.warm_up, 0);
  backends.accuracy = node.number_or("accuracy", backends.accuracy);
  if (!(backends.accuracy > 0.0)) node.at("accuracy").fail("expected a positive number");
  for (const ConfigNode& variant : node.at("variant").elements()) {
    backends.variants.push_back(read_variant(variant));
    const std::string& name = backends.variants.back().name;
    const auto equal = [&](const BackendVariant& other) { return other.name == name; };
    if (std::count_if(backends.variants.begin(), backends.variants.end(), equal) > 1) {
      variant.fail(fmt::format("'{}' is there already; give a name", name));
    }
  }
  if (backends.variants.empty()) node.at("variant").fail("expected at least one");
  if (node.has("reference")) {
    backends.reference = node.at("reference").string();
    const auto named = [&](const BackendVariant& variant) { return variant.name == backends.reference; };
    if (std::none_of(backends.variants.begin(), backends.variants.end(), named)) {
      std::vector<std::string> names;
      for (const BackendVariant& variant : backends.variants) names.push_back(variant.name);
      node.at("reference").fail(fmt::format("no variant of this name; expected one of {}", fmt::join(names, ", ")));
    }
  }
  return backends;
}

void apply(const BackendVariant& variant, Config& config) {
  for (const auto& [key, value] : variant.settings) {
    if (key != "linear" && key != "nonlinear") continue;
    const ConfigNode root = config.root();
    const bool same =
        root.has("solver") && root.at("solver").has(key) && root.at("solver").at(key).value().text() == value.text();
    if (!same) config.erase("solver." + key + "_options");
  }
  for (const auto& [key, value] : variant.settings) config.set("solver." + key, value);
}

PointResult run_repeatedly(const PipelineEntry& pipeline, const Config& config, const BackendComparison& backends) {
  for (int run = 0; run < backends.warm_up; ++run) pipeline.run(config);
  PointResult result;
  std::vector<Row> rows;
  for (int run = 0; run < backends.repeats; ++run) {
    result = pipeline.run(config);
    rows.push_back(result.metrics);
  }
  for (const Metric& metric : pipeline.metrics) {
    if (metric.column.unit != "s" || result.metrics.find(metric.column.key) == nullptr) continue;
    std::vector<double> seconds;
    for (const Row& row : rows) seconds.push_back(number(row, metric.column.key));
    result.metrics.set(metric.column.key, median(seconds));
    if (metric.column.key != "seconds_total") continue;
    result.metrics.set("seconds_min", *std::min_element(seconds.begin(), seconds.end()));
    result.metrics.set("seconds_max", *std::max_element(seconds.begin(), seconds.end()));
  }
  const std::vector<double>& seconds = result.trace.seconds;
  if (seconds.size() > 1) {
    const double all = seconds.back() - seconds.front();
    result.metrics.set("seconds_per_iteration", all / static_cast<double>(seconds.size() - 1));
  }
  result.metrics.set("peak_memory", peak_memory_mib());
  return result;
}

std::vector<Metric> comparison_metrics() {
  return {
      {{kBackendKey}, "variant of [backends]"},
      {{"objective", "E"}, "what was minimized, at the end: regularized energy and penalties"},
      {{"excess", "(E - E*)/E*", "", 2}, "how far that is above the lowest one found for the problem"},
      {{"difference", "", "", 2}, "largest difference of a coordinate from the reference solution, by the diameter"},
      {{"solved"}, "converged, with an excess of at most backends.accuracy"},
      {{"rate", "", "", 2}, "factor by which the excess shrinks in an iteration, over the last half of them"},
      {{"seconds_min", "min", "s", 3}, "shortest total time of the repeated runs"},
      {{"seconds_max", "max", "s", 3}, "longest one"},
      {{"seconds_per_iteration", "per iteration", "s", 3}, "of the nonlinear backend, last run"},
      {{"peak_memory", "memory", "MiB", 3}, "largest resident memory of the process that ran the backend"}};
}

std::vector<std::string> comparison_columns() {
  return {"status",
          "converged",
          "solved",
          "objective",
          "excess",
          "difference",
          "iterations",
          "rate",
          "seconds_total",
          "seconds_min",
          "seconds_max",
          "seconds_analyze",
          "seconds_factorize",
          "seconds_solve",
          "seconds_per_iteration",
          "peak_memory",
          "nnz_L",
          "solver_residual"};
}

void compare_backends(const Plan& plan, const Config& config, const std::vector<Point>& points, bool figures,
                      const std::filesystem::path& folder, Record& record) {
  std::vector<Problem> problems = problems_of(plan, points, record.rows);
  for (std::size_t p = 0; p < problems.size(); ++p) {
    const Problem& problem = problems[p];
    for (const std::size_t i : problem.rows) {
      Row& row = record.rows[i];
      row.set("solved", false);
      if (!succeeded(row)) continue;
      const SolveTrace& trace = points[i].result.trace;
      row.set("objective", trace.objective);
      row.set("excess", excess(problem, trace.objective));
      if (!trace.energy.empty()) row.set("rate", convergence_rate(problem, trace.energy));
      row.set("solved", converged(row) && excess(problem, trace.objective) <= plan.backends->accuracy);
    }
    if (const auto reference = reference_row(plan, problem, points, record.rows)) {
      for (const std::size_t i : problem.rows) {
        if (!succeeded(record.rows[i])) continue;
        record.rows[i].set("difference", difference(points[i].result.trace, points[*reference].result.trace));
      }
    }
    constexpr std::size_t kMostColumns = 12;
    const auto solutions = std::count_if(problem.rows.begin(), problem.rows.end(),
                                         [&](std::size_t i) { return succeeded(record.rows[i]); });
    if (solutions > 1 && problem.rows.size() <= kMostColumns) {
      record.tables.push_back(difference_table(problem, points, record.rows));
    }
    if (figures) draw_convergence(problem, p, points, record.rows, folder, record);
  }
  if (figures && problems.size() > 1) draw_profile(plan, problems, folder, record);
  record.provenance.emplace_back(
      "comparison",
      fmt::format("{} timed runs of each after {}; solved: converged, energy at most {:g} above the lowest",
                  plan.backends->repeats, plan.backends->warm_up, plan.backends->accuracy));
  record.provenance.emplace_back("stopping criterion of all", criterion(plan, config));
}

}  // namespace variform
