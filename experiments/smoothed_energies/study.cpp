// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/smoothed_energies/study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "energies/energies.h"
#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/domain/quality.h"
#include "framework/experiment/known_keys.h"
#include "framework/form/problem_objective.h"
#include "framework/operators/distortion.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Energies below, per measure, are rounding (squares of 1e-12).
constexpr double kRoundingEnergy = 1e-24;
constexpr double kRise = 1e-13;  // of the energy: smaller ones are rounding

const std::vector<Parameter> kNormParameters = {{.name = "beta",
                                                 .value = 0.0,
                                                 .doc = "regularization weight, or \"auto\": see [norm.auto]",
                                                 .min = 0.0,
                                                 .max = 1.0,
                                                 .max_open = true},
                                                {.name = "facet_weight",
                                                 .value = std::string("facet_measure"),
                                                 .doc = "weight of residual jumps",
                                                 .choices = facet_weight_names()},
                                                {.name = "regularizer",
                                                 .value = std::string("energy_smoothness"),
                                                 .doc = "what beta weighs",
                                                 .choices = {"energy_smoothness", "tikhonov"}}};

const std::vector<Parameter> kAutoParameters = {
    {.name = "method",
     .value = std::string("smallest"),
     .doc = "smallest beta that fulfils `until`, or the corner of the L-curve of energy and energy_R",
     .choices = {"smallest", "l_curve"}},
    {.name = "until", .value = std::string("flipped == 0"), .doc = "condition on metrics"},
    {.name = "start", .value = 0.05, .doc = "first positive value tried", .min = 1e-12, .max = 1.0, .max_open = true},
    {.name = "tolerance", .value = 0.05, .doc = "width of the bracket, relative to beta", .min = 1e-12, .max = 1.0},
    {.name = "low", .value = 1e-3, .doc = "l_curve: smallest value", .min = 1e-12, .max = 1.0, .max_open = true},
    {.name = "high", .value = 0.999, .doc = "largest value tried", .min = 1e-12, .max = 1.0, .max_open = true},
    {.name = "count", .value = std::int64_t{13}, .doc = "l_curve: number of values", .min = 3.0, .max = 1000.0},
    {.name = "warm_start",
     .value = false,
     .doc = "nonlinear runs go on from the last trial's result; results may depend on the path"}};

std::vector<Parameter> solver_parameters(const std::vector<std::string>& starts) {
  return {
      {.name = "linear", .value = std::string("auto"), .doc = "linear backend", .choices = linear_backends().names()},
      {.name = "nonlinear",
       .value = std::string("local_global"),
       .doc = "nonlinear backend",
       .choices = nonlinear_backends().names()},
      {.name = "tolerance", .value = 1e-6, .doc = "largest step at convergence, relative to the diameter", .min = 0.0},
      {.name = "gradient_tolerance",
       .value = NonlinearOptions().gradient_tolerance,
       .doc = "largest gradient at convergence, in the 1-norm times diameter by energy; alternations ignore it",
       .min = 0.0},
      {.name = "max_iterations", .value = std::int64_t{500}, .doc = "of the nonlinear backend", .min = 1.0, .max = 1e9},
      {.name = "start", .value = starts.front(), .doc = "where nonlinear backends start", .choices = starts},
      {.name = "start_energy",
       .value = std::string(),
       .doc = "start = \"regularized\": energy whose minimizer is the start; default arap, arap_parametrization"},
      {.name = "start_beta",
       .value = 0.3,
       .doc = "start = \"regularized\": its regularization weight",
       .min = 0.0,
       .max = 1.0,
       .max_open = true}};
}

// A parameter list without one of its entries: for a key whose value may be of another type.
std::vector<Parameter> without(const std::vector<Parameter>& parameters, const std::string& name) {
  std::vector<Parameter> rest;
  for (const Parameter& parameter : parameters) {
    if (parameter.name != name) rest.push_back(parameter);
  }
  return rest;
}

// Metrics of every trial of a search, beside those of the pipeline.
const std::vector<std::string> kTrialMetrics = {"energy",           "energy_R",    "energy_W",   "energy_mean",
                                                "local_energy_max", "soft_error",  "hard_error", "iterations",
                                                "converged",        "energy_rises"};

BetaSearch read_search(const ConfigNode& norm, const std::vector<Metric>& own) {
  Parameters p(kAutoParameters);
  if (norm.has("auto")) p = norm.at("auto").parameters(kAutoParameters);
  BetaSearch search;
  search.l_curve = p.string("method") == "l_curve";
  const auto read_condition = [&] {
    if (p.string("until").empty()) throw UsageError("expected a condition on metrics");
    return Condition(p.string("until"));
  };
  const Condition until = norm.has("auto") && norm.at("auto").has("until")
                              ? norm.at("auto").at("until").located(read_condition)
                              : read_condition();
  if (norm.has("auto") && norm.at("auto").has("until")) {
    KnownKeys known;
    std::vector<std::string> keys = kTrialMetrics;
    for (const Metric& metric : own) keys.push_back(metric.column.key);
    known.add("metrics of a trial", keys);
    known.require(norm.at("auto").at("until"), until);
  }
  search.threshold = smallest_beta(until, p.number("start"), p.number("tolerance"), p.number("high"));
  search.threshold.key = "norm.beta";
  search.corner = {.residual = "energy",
                   .regularizer = "energy_R",
                   .low = p.number("low"),
                   .high = p.number("high"),
                   .count = static_cast<int>(p.integer("count"))};
  if (search.l_curve && !(search.corner.low < search.corner.high)) norm.at("auto").fail("expected low < high");
  if (!search.l_curve && p.number("start") > p.number("high")) norm.at("auto").fail("expected start <= high");
  search.warm_start = p.boolean("warm_start");
  return search;
}

struct Outcome {
  Matrix U;
  EnergyValue value;
  Matrix residual;
  bool converged = true;
  int iterations = 1;
  int rises = 0;
  Index undefined_targets = 0;
  std::vector<Curve> history;
  SolveTrace trace;
  std::string reason;
};

Outcome minimize(Problem& problem, SolverChoice& solver, const Matrix& start) {
  Outcome outcome;
  if (problem.traits().state == StateDependence::none) {
    outcome.U = problem.solve(*solver.linear);
  } else {
    ProblemObjective objective(problem, *solver.linear);
    outcome.U = solver.nonlinear->minimize(objective, start, solver.options);
    const NonlinearReport& report = solver.nonlinear->report();
    outcome.converged = report.converged;
    outcome.reason = report.reason;
    outcome.iterations = report.iterations;
    outcome.undefined_targets = objective.undefined_targets();
    Curve energies_curve{"E", {}, {}};
    Curve steps{"step", {}, {}};
    for (const NonlinearStep& step : report.history) {
      outcome.trace.energy.push_back(step.energy.objective());
      outcome.trace.seconds.push_back(step.seconds);
      energies_curve.x.push_back(step.iteration);
      energies_curve.y.push_back(step.energy.objective());
      if (step.iteration == 0) continue;
      const double before = energies_curve.y[energies_curve.y.size() - 2];
      if (step.energy.objective() > before * (1.0 + kRise)) ++outcome.rises;
      steps.x.push_back(step.iteration);
      steps.y.push_back(step.step);
    }
    outcome.history = {energies_curve, steps};
    problem.refresh_target(outcome.U);
  }
  outcome.value = problem.value(outcome.U);
  outcome.residual = problem.residual(outcome.U);
  return outcome;
}

void set_energies(const Problem& problem, const Outcome& outcome, Row& row) {
  row.set("energy", outcome.value.plain);
  row.set("energy_R", outcome.value.variation);
  row.set("energy_W", outcome.value.total);
  row.set("energy_mean", outcome.value.plain / problem.domain().total_measure());
  row.set("local_energy_max", outcome.residual.rowwise().squaredNorm().maxCoeff());
}

void set_constraint_errors(const Constraints& constraints, const Matrix& U, Row& row) {
  double soft_error = 0.0;
  for (const auto& soft : constraints.soft())
    soft_error = std::max(soft_error, (U.row(soft.vertex) - soft.value).norm());
  double hard_error = 0.0;
  for (const auto& fixed : constraints.fixed())
    hard_error = std::max(hard_error, (U.row(fixed.vertex) - fixed.value).norm());
  row.set("soft_error", soft_error);
  row.set("hard_error", hard_error);
}

}  // namespace

std::unique_ptr<Energy> read_energy(const ConfigNode& node, bool velocities) {
  const ConfigNode type = node.at("type");
  const EnergyEntry& entry = type.located([&]() -> const EnergyEntry& { return energies().find(type.string()); });
  if (entry.velocities != velocities) {
    type.fail(velocities ? fmt::format("energy '{}' is not one of velocity fields", entry.name)
                         : fmt::format("energy '{}' is one of velocity fields: see pipeline vector_field", entry.name));
  }
  const Parameters parameters = node.parameters(entry.parameters, {"type"});
  return node.located([&] { return entry.make(parameters); });
}

NormChoice read_norm(const Config& config, const std::vector<Metric>& own) {
  if (!config.root().has("norm")) return {};
  const ConfigNode node = config.root().at("norm");
  NormChoice choice;
  const bool searches = node.has("beta") && std::holds_alternative<std::string>(node.at("beta").value().data);
  if (searches && node.at("beta").string() != "auto") node.at("beta").fail("expected a number in [0, 1) or \"auto\"");
  const Parameters p =
      node.parameters(searches ? without(kNormParameters, "beta") : kNormParameters,
                      searches ? std::vector<std::string>{"beta", "auto"} : std::vector<std::string>{"auto"});
  choice.options = {0.0, facet_weight_from(p.string("facet_weight")),
                    p.string("regularizer") == "tikhonov" ? Regularizer::tikhonov : Regularizer::energy_smoothness};
  const BetaSearch search = read_search(node, own);  // checked, whether it is used or not
  if (searches) {
    choice.search = search;
  } else {
    choice.options.beta = p.number("beta");
  }
  return choice;
}

SolverChoice read_solver(const Config& config, const std::vector<std::string>& starts) {
  const std::vector<Parameter> declared = solver_parameters(starts);
  Parameters p(declared);
  std::optional<ConfigNode> node;
  if (config.root().has("solver")) {
    node = config.root().at("solver");
    p = node->parameters(declared, {"linear_options", "nonlinear_options"});
  }
  const auto options_of = [&](const char* key, const std::vector<Parameter>& parameters) {
    return node && node->has(key) ? node->at(key).parameters(parameters) : Parameters(parameters);
  };
  const LinearBackendEntry& linear = linear_backends().find(p.string("linear"));
  const Parameters linear_options = options_of("linear_options", linear.parameters);
  const NonlinearBackendEntry& nonlinear = nonlinear_backends().find(p.string("nonlinear"));
  SolverChoice solver;
  const auto make_linear = [&] { return make_linear_backend(linear.name, linear_options); };
  solver.linear = node && node->has("linear") ? node->at("linear").located(make_linear) : make_linear();
  const Parameters nonlinear_options = options_of("nonlinear_options", nonlinear.parameters);
  const auto make_nonlinear = [&] { return nonlinear.make(nonlinear_options); };
  solver.nonlinear = node && node->has("nonlinear") ? node->at("nonlinear").located(make_nonlinear) : make_nonlinear();
  solver.options = {.tolerance = p.number("tolerance"),
                    .max_iterations = static_cast<int>(p.integer("max_iterations")),
                    .gradient_tolerance = p.number("gradient_tolerance")};
  solver.start = p.string("start");
  solver.start_energy = p.string("start_energy");
  solver.start_beta = p.number("start_beta");
  solver.backend_named = node && node->has("nonlinear");
  solver.start_named = node && node->has("start");
  if (!solver.start_energy.empty()) {
    node->at("start_energy").located([&] { energies().find(solver.start_energy); });
  }
  return solver;
}

void adapt_to_barrier(const EnergyTraits& traits, const std::string& start, SolverChoice& solver) {
  if (!traits.barrier) return;
  if (!solver.backend_named) solver.nonlinear = make_nonlinear_backend("newton");
  if (!solver.start_named) solver.start = start;
}

Matrix regularized_start(const Study& study, const std::string& energy, const Matrix& from) {
  const EnergyEntry& entry = energies().find(study.solver.start_energy.empty() ? energy : study.solver.start_energy);
  const auto other = entry.make(Parameters(entry.parameters));
  const EnergyTraits traits = other->traits(study.domain);
  if (entry.velocities || traits.barrier || traits.dimension() != study.constraints.dimension()) {
    throw UsageError(
        fmt::format("solver.start_energy: energy '{}' gives no start here: expected one of maps to "
                    "dimension {} without a barrier",
                    entry.name, study.constraints.dimension()));
  }
  const NormOptions norm{study.solver.start_beta, study.norm.options.facet_weight};
  Problem problem(study.domain, *other, norm, study.constraints);
  const auto linear = make_linear_backend("auto");
  if (traits.state == StateDependence::none) return problem.solve(*linear);
  ProblemObjective objective(problem, *linear);
  return make_nonlinear_backend("gauss_newton")
      ->minimize(objective, closest_feasible(study.constraints, from), study.solver.options);
}

std::vector<Section> study_sections(const std::vector<std::string>& starts) {
  return {{"norm", kNormParameters}, {"norm.auto", kAutoParameters}, {"solver", solver_parameters(starts)}};
}

std::vector<ConfigNode> constraint_tables(const Config& config) {
  return config.root().has("constraint") ? config.root().at("constraint").elements() : std::vector<ConfigNode>();
}

std::vector<std::filesystem::path> study_inputs(const Config& config) {
  const ConfigNode domain = config.root().at("domain");
  if (!domain.has("mesh")) return {};
  return {find_input(domain.at("mesh").string(), config.folder())};
}

Matrix run_study(Study& study, PointResult& result, Vector& local_energy) {
  const Stopwatch total;
  if (study.domain.facet_count() == 0 && (study.norm.options.beta > 0.0 || study.norm.search))
    result.warnings.emplace_back("the mesh has no interior facets: beta has no effect");
  Problem problem(study.domain, study.energy, study.norm.options, study.constraints);
  Outcome outcome;
  double beta = study.norm.options.beta;
  Matrix last;
  int limited = 0;
  const auto at = [&](double value) {
    beta = value;
    problem.set_beta(value);
    Matrix start;
    if (problem.traits().state != StateDependence::none) {
      start = last.size() > 0 ? last : closest_feasible(study.constraints, study.start(value));
    }
    outcome = minimize(problem, study.solver, start);
    if (study.norm.search && study.norm.search->warm_start) last = outcome.U;
    limited += outcome.converged ? 0 : 1;
    Row row;
    set_energies(problem, outcome, row);
    study.measure(outcome.U, row);
    set_constraint_errors(study.constraints, outcome.U, row);
    row.set("iterations", static_cast<std::int64_t>(outcome.iterations));
    row.set("converged", outcome.converged);
    row.set("energy_rises", static_cast<std::int64_t>(outcome.rises));
    return row;
  };
  Row measured;
  std::optional<Trials> trials;
  if (!study.norm.search) {
    measured = at(beta);
  } else {
    const BetaSearch& search = *study.norm.search;
    // The answer's own result is kept: with warm starts another run might end elsewhere.
    std::optional<Outcome> answer;
    double answer_beta = 0.0;
    Row answer_row;
    const auto keep = [&](const Row& row) {
      answer = outcome;
      answer_beta = beta;
      answer_row = row;
    };
    if (search.l_curve) {
      LCurveSearch corner = search.corner;
      corner.floor = kRoundingEnergy * study.domain.total_measure();
      trials = l_curve(corner, at);
      keep(at(trials->found ? trials->value : 0.0));
      if (!trials->found) {
        result.warnings.emplace_back("the L-curve has no corner; this is the result without regularization");
      }
    } else {
      const Condition& until = search.threshold.until;
      trials = find_threshold(search.threshold, [&](double value) {
        Row row = at(value);
        const bool better = until.holds(row) && (!answer || !until.holds(answer_row) || value < answer_beta);
        if (better || !answer || (!until.holds(answer_row) && value > answer_beta)) keep(row);
        return row;
      });
      if (!trials->found) {
        result.warnings.push_back(fmt::format("no beta up to {} fulfils '{}'", trials->high, until.text()));
      }
    }
    if (limited > 0) {
      trials->metrics.emplace_back("converged");
      trials->remarks.push_back(
          fmt::format("{} of {} runs ended at the iteration limit", limited, trials->rows.size()));
    }
    for (const std::string& remark : trials->remarks) result.warnings.push_back("search for beta: " + remark);
    outcome = *answer;
    beta = answer_beta;
    measured = answer_row;
  }
  if (!outcome.converged) {
    const std::string& backend = study.solver.nonlinear->report().backend;
    const bool other = backend != "gauss_newton" && backend != "newton";
    result.warnings.push_back(fmt::format("not converged: {}; see solver.max_iterations{}", outcome.reason,
                                          other ? ", or try solver.nonlinear = \"gauss_newton\"" : ""));
  }
  result.history = outcome.history;
  result.trace = std::move(outcome.trace);
  result.trace.solution = outcome.U;
  result.trace.length_scale = study.domain.diameter();
  result.trace.objective = outcome.value.objective();
  result.trace.linear_residuals = study.solver.linear->report().residual_history;

  Row& row = result.metrics;
  row.set("beta", beta);
  row.set("facet_weight", to_string(study.norm.options.facet_weight));
  if (trials) {
    row.set("beta_found", trials->found);
    row.set("beta_low", trials->low);
    row.set("beta_high", trials->high);
    row.set("beta_trials", static_cast<std::int64_t>(trials->rows.size()));
    row.set("analyses", static_cast<std::int64_t>(study.solver.linear->report().analyses));
    result.trials.push_back(std::move(*trials));
  }
  for (const auto& [key, value] : measured.entries()) row.set(key, value);
  row.set("undefined_targets", static_cast<std::int64_t>(outcome.undefined_targets));
  row.set("nonlinear", problem.traits().state == StateDependence::none ? "" : study.solver.nonlinear->report().backend);
  const LinearReport& linear = study.solver.linear->report();
  row.set("solver", linear.backend);
  row.set("solver_residual", linear.residual);
  row.set("linear_iterations", static_cast<std::int64_t>(linear.iterations));
  set_system(linear, row);
  set_times(problem.times(), total.seconds(), row);
  local_energy = outcome.residual.rowwise().squaredNorm();
  return outcome.U;
}

std::vector<Metric> study_metrics(const std::vector<Metric>& own) {
  std::vector<Metric> metrics = {
      {{"vertices"}, "vertices of the mesh"},
      {{"cells"}, "triangles or tetrahedra"},
      {{"measure_ratio", "measure max/min"}, "largest by smallest cell measure at rest"},
      {{"radius_ratio", "radius ratio"}, "largest circumradius by inradius of a cell at rest"},
      {{"beta"}, "regularization weight of the row"},
      {{"facet_weight", "facet weight"}, "weight of residual jumps of the row"},
      {{"beta_found"}, "with beta = \"auto\": whether the search found what it looked for"},
      {{"beta_low"}, "with beta = \"auto\": lower end of the bracket"},
      {{"beta_high"}, "with beta = \"auto\": upper end of the bracket"},
      {{"beta_trials"}, "with beta = \"auto\": values tried"},
      {{"analyses"}, "with beta = \"auto\": symbolic analyses for all trials"},
      {{"energy", "E_P"}, "unregularized energy, sum of A_t |r_t|^2"},
      {{"energy_R", "E_R"},
       "what beta weighs: variation of the residual, sum of b_f |r_l - r_r|^2 (tikhonov: integral of |grad u|^2)"},
      {{"energy_W", "E_W"}, "regularized energy ||r||^2_W"},
      {{"energy_mean", "E_P / measure"}, "unregularized energy by rest measure"},
      {{"local_energy_max", "max |r|²"}, "largest |r_t|^2"}};
  metrics.insert(metrics.end(), own.begin(), own.end());
  const std::vector<Metric> rest = {
      {{"soft_error", "soft error"}, "largest distance of a softly constrained vertex from its target"},
      {{"hard_error", "hard error"}, "largest distance of a fixed vertex from its target"},
      {{"iterations"}, "of the nonlinear backend; 1 for linear energies"},
      {{"converged"}, "whether the stopping rule held (an iteration limit is not convergence)"},
      {{"energy_rises", "rises"},
       "iterations in which the objective rose by more than rounding; 0 for linear energies"},
      {{"undefined_targets"}, "cells, summed over all evaluated states, whose closest rotation was undefined"},
      {{"nonlinear"}, "nonlinear backend; none for linear energies"},
      {{"solver"}, "linear backend that did the work"},
      {{"solver_residual", "residual", "", 2}, "relative residual of the last solve"},
      {{"linear_iterations", "linear iterations"}, "of the last solve; 0 for direct backends"},
      {{"unknowns"}, "of the linear system"},
      {{"nnz_H"}, "entries of its lower triangle"},
      {{"nnz_L"}, "entries of the factor"},
      {{"flops", "flops", "", 3}, "of one factorization"},
      {{"seconds_declare", "declare", "s", 3}, "time to declare E, c and W"},
      {{"seconds_pattern", "pattern", "s", 3}, "time for the sparsity pattern"},
      {{"seconds_refill", "refill", "s", 3}, "time to fill in values"},
      {{"seconds_analyze", "analyze", "s", 3}, "time of the symbolic analysis"},
      {{"seconds_factorize", "factorize", "s", 3}, "time of the numeric factorization"},
      {{"seconds_solve", "solve", "s", 3}, "time of right-hand sides and solves"},
      {{"seconds_total", "total", "s", 3}, "wall time of the point"}};
  metrics.insert(metrics.end(), rest.begin(), rest.end());
  return metrics;
}

std::vector<Metric> distortion_metrics(const std::vector<Metric>& more) {
  std::vector<Metric> metrics = {
      {{"flipped"}, "cells whose orientation is not positive relative to rest (surfaces in space: degenerate ones)"},
      {{"min_det", "min det"}, "smallest determinant of the deformation gradient"},
      {{"area_ratio", "area ratio"}, "signed measure by rest measure"},
      {{"E_isom"}, "isometric distortion, mean of sum (sigma_i - 1)^2"},
      {{"E_conf"}, "conformal distortion"},
      {{"E_auth"}, "authalic distortion"},
      {{"E_metr"}, "metric distortion"},
      {{"E_sdir"}, "symmetric Dirichlet energy, mean of sum sigma_i^2 + sigma_i^-2; infinite with flips"},
      {{"max_conf_ratio", "max σ₁/σ₂"}, "largest ratio of singular values; infinite with flips"}};
  metrics.insert(metrics.end(), more.begin(), more.end());
  return metrics;
}

Parameters section_of(const Config& config, const std::string& name, const std::vector<Parameter>& declared,
                      const std::vector<std::string>& others) {
  if (!config.root().has(name)) return Parameters(declared);
  return config.root().at(name).parameters(declared, others);
}

const std::vector<Parameter>& velocity_norm_parameters() {
  static const std::vector<Parameter> parameters = {
      {.name = "beta",
       .value = 0.0,
       .doc = "regularization weight; 1 where the energy has a regularizer of its own (omega of near_isometric)",
       .min = 0.0,
       .max = 1.0},
      {.name = "facet_weight",
       .value = std::string("facet_measure"),
       .doc = "weight of residual jumps",
       .choices = facet_weight_names()}};
  return parameters;
}

void set_system(const LinearReport& report, Row& row) {
  row.set("unknowns", static_cast<std::int64_t>(report.columns));
  row.set("nnz_H", static_cast<std::int64_t>(report.nnz_matrix));
  row.set("nnz_L", report.nnz_factor >= 0 ? Value(static_cast<std::int64_t>(report.nnz_factor)) : Value());
  row.set("flops", report.flops >= 0.0 ? Value(report.flops) : Value());
}

void set_times(const ProblemTimes& times, double total, Row& row) {
  row.set("seconds_declare", times.declare);
  row.set("seconds_pattern", times.pattern);
  row.set("seconds_refill", times.refill);
  row.set("seconds_analyze", times.analyze);
  row.set("seconds_factorize", times.factorize);
  row.set("seconds_solve", times.solve);
  row.set("seconds_total", total);
}

void set_sizes(const Domain& domain, Row& row) {
  row.set("vertices", static_cast<std::int64_t>(domain.vertex_count()));
  row.set("cells", static_cast<std::int64_t>(domain.cell_count()));
  const MeshQuality quality = mesh_quality(domain);
  row.set("measure_ratio", quality.measure_ratio);
  row.set("radius_ratio", quality.max_radius_ratio);
}

void set_distortion(const Domain& domain, const Matrix& U, Row& row) {
  const Distortion errors = distortion(domain, U);
  row.set("flipped", static_cast<std::int64_t>(errors.flipped.size()));
  row.set("min_det", errors.min_determinant);
  row.set("area_ratio", errors.area_ratio);
  row.set("E_isom", errors.isometric);
  row.set("E_conf", errors.conformal);
  row.set("E_auth", errors.authalic);
  row.set("E_metr", errors.metric);
  row.set("E_sdir", errors.symmetric_dirichlet);
  row.set("max_conf_ratio", errors.max_conformal_ratio);
}

MeshField local_energy_field(const LoadedDomain& loaded, const Vector& local_energy) {
  if (local_energy.size() == loaded.domain.cell_count()) {
    return {"local_energy", MeshField::On::cells, local_energy};
  }
  return {"local_energy", MeshField::On::vertices, loaded.values_as_input(local_energy)};
}

MeshFigure study_figure(const std::string& name, const Matrix& positions, const Domain& domain,
                        const Vector& local_energy, const LoadedConstraints& constraints,
                        const std::vector<Index>& flipped) {
  MeshFigure figure;
  figure.name = name;
  figure.mesh = {positions, domain.cells()};
  figure.cell_values = on_cells(domain, local_energy);
  figure.fixed_vertices = constraints.fixed;
  figure.moved_vertices = constraints.moved;
  figure.soft_vertices = constraints.soft;
  figure.flipped_cells = flipped;
  return figure;
}

Vector on_cells(const Domain& domain, const Vector& values) {
  if (values.size() == domain.cell_count()) return values;
  Vector result = Vector::Zero(domain.cell_count());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < domain.cell_size(); ++i) result[t] += values[domain.cells()(t, i)] / domain.cell_size();
  }
  return result;
}

Matrix lattice_images(const Domain& domain, const Matrix& U, Index lattice) {
  Matrix images = Matrix::Constant(lattice * lattice, U.cols(), std::nan(""));
  const auto plane = domain.positions().leftCols(2);
  const Eigen::RowVector2d low = plane.colwise().minCoeff();
  const Eigen::RowVector2d extent = plane.colwise().maxCoeff() - low;
  const auto cell_range = [&](double from, double to, int axis) {
    const double step = extent[axis] / lattice;
    const auto first = static_cast<Index>(std::ceil((from - low[axis]) / step - 0.5 - 1e-9));
    const auto last = static_cast<Index>(std::floor((to - low[axis]) / step - 0.5 + 1e-9));
    return std::pair(std::max<Index>(first, 0), std::min<Index>(last, lattice - 1));
  };
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::Matrix<double, 3, 2> x;
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, 3> u(3, U.cols());
    for (int i = 0; i < 3; ++i) {
      x.row(i) = plane.row(domain.cells()(t, i));
      u.row(i) = U.row(domain.cells()(t, i));
    }
    const auto [i0, i1] = cell_range(x.col(0).minCoeff(), x.col(0).maxCoeff(), 0);
    const auto [j0, j1] = cell_range(x.col(1).minCoeff(), x.col(1).maxCoeff(), 1);
    const auto G = domain.gradient(t);
    for (Index i = i0; i <= i1; ++i) {
      for (Index j = j0; j <= j1; ++j) {
        const Eigen::RowVector2d point =
            low + Eigen::RowVector2d((i + 0.5) * extent[0] / lattice, (j + 0.5) * extent[1] / lattice);
        Eigen::RowVector3d barycentric = (point - x.row(0)) * G.topRows(2);
        barycentric[0] += 1.0;
        if (barycentric.minCoeff() >= -1e-12) images.row(i * lattice + j) = barycentric * u;
      }
    }
  }
  return images;
}

}  // namespace variform
