// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "energies/energies.h"
#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/domain/quality.h"
#include "framework/experiment/constraint_source.h"
#include "framework/experiment/domain_source.h"
#include "framework/experiment/pipeline.h"
#include "framework/form/problem.h"
#include "framework/operators/distortion.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

const std::vector<std::string> kRegularizers = {"energy_smoothness", "tikhonov"};
const std::vector<std::string> kStarts = {"rest", "larap", "poisson"};

const std::vector<Parameter> kNormParameters = {
    {.name = "beta", .value = 0.0, .doc = "regularization weight", .min = 0.0, .max = 1.0, .max_open = true},
    {.name = "facet_weight",
     .value = std::string("facet_measure"),
     .doc = "weight of residual jumps",
     .choices = facet_weight_names()},
    {.name = "regularizer",
     .value = std::string("energy_smoothness"),
     .doc = "what beta weighs",
     .choices = kRegularizers}};

std::vector<Parameter> solver_parameters() {
  return {
      {.name = "linear", .value = std::string("auto"), .doc = "linear backend", .choices = linear_backends().names()},
      {.name = "nonlinear",
       .value = std::string("local_global"),
       .doc = "nonlinear backend",
       .choices = nonlinear_backends().names()},
      {.name = "tolerance", .value = 1e-6, .doc = "largest step at convergence, relative to the diameter", .min = 0.0},
      {.name = "max_iterations", .value = std::int64_t{500}, .doc = "of the nonlinear backend", .min = 1.0, .max = 1e9},
      {.name = "start", .value = std::string("rest"), .doc = "where nonlinear backends start", .choices = kStarts}};
}

const std::vector<Parameter> kProbeParameters = {{.name = "lattice",
                                                  .value = std::int64_t{0},
                                                  .doc = "probe points per side of the bounding box, for [compare]",
                                                  .min = 0.0,
                                                  .max = 1000.0}};

std::unique_ptr<Energy> read_energy(const ConfigNode& node) {
  const ConfigNode type = node.at("type");
  const EnergyEntry& entry = type.located([&]() -> const EnergyEntry& { return energies().find(type.string()); });
  const Parameters parameters = node.parameters(entry.parameters, {"type"});
  return node.located([&] { return entry.make(parameters); });
}

NormOptions read_norm(const Config& config) {
  if (!config.root().has("norm")) return {};
  const Parameters p = config.root().at("norm").parameters(kNormParameters);
  return {p.number("beta"), facet_weight_from(p.string("facet_weight")),
          p.string("regularizer") == "tikhonov" ? Regularizer::tikhonov : Regularizer::energy_smoothness};
}

struct Solver {
  std::unique_ptr<LinearBackend> linear;
  std::unique_ptr<NonlinearBackend> nonlinear;
  NonlinearOptions options;
  std::string start;
};

Solver read_solver(const Config& config) {
  Parameters p(solver_parameters());
  Parameters linear_options;
  const ConfigNode root = config.root();
  std::optional<ConfigNode> node;
  if (root.has("solver")) {
    node = root.at("solver");
    p = node->parameters(solver_parameters(), {"linear_options"});
  }
  const LinearBackendEntry& entry = linear_backends().find(p.string("linear"));
  linear_options = Parameters(entry.parameters);
  if (node && node->has("linear_options")) linear_options = node->at("linear_options").parameters(entry.parameters);
  Solver solver;
  const auto make_linear = [&] { return make_linear_backend(entry.name, linear_options); };
  solver.linear = node && node->has("linear") ? node->at("linear").located(make_linear) : make_linear();
  solver.nonlinear = make_nonlinear_backend(p.string("nonlinear"));
  solver.options = {p.number("tolerance"), static_cast<int>(p.integer("max_iterations"))};
  solver.start = p.string("start");
  return solver;
}

std::vector<ConfigNode> constraint_tables(const Config& config) {
  return config.root().has("constraint") ? config.root().at("constraint").elements() : std::vector<ConfigNode>();
}

Index read_lattice(const Config& config) {
  if (!config.root().has("probe")) return 0;
  return static_cast<Index>(config.root().at("probe").parameters(kProbeParameters).integer("lattice"));
}

void check(const Config& config) {
  check_domain(config.root().at("domain"));
  read_energy(config.root().at("energy"));
  read_norm(config);
  read_solver(config);
  check_constraints(constraint_tables(config));
  read_lattice(config);
}

std::vector<std::filesystem::path> inputs(const Config& config) {
  const ConfigNode domain = config.root().at("domain");
  if (!domain.has("mesh")) return {};
  return {find_input(domain.at("mesh").string(), config.folder())};
}

// Images of a lattice of points of the bounding box under the map, NaN outside the domain.
Matrix probe(const Domain& domain, const Matrix& U, Index lattice) {
  Matrix images = Matrix::Constant(lattice * lattice, 2, std::nan(""));
  if (lattice == 0) return images;
  const Eigen::RowVector2d low = domain.positions().colwise().minCoeff();
  const Eigen::RowVector2d extent = domain.positions().colwise().maxCoeff() - Eigen::RowVectorXd(low);
  const auto cell_range = [&](double from, double to, int axis) {
    const double step = extent[axis] / lattice;
    const auto first = static_cast<Index>(std::ceil((from - low[axis]) / step - 0.5 - 1e-9));
    const auto last = static_cast<Index>(std::floor((to - low[axis]) / step - 0.5 + 1e-9));
    return std::pair(std::max<Index>(first, 0), std::min<Index>(last, lattice - 1));
  };
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::Matrix<double, 3, 2> x;
    Eigen::Matrix<double, 3, 2> u;
    for (int i = 0; i < 3; ++i) {
      x.row(i) = domain.positions().row(domain.cells()(t, i));
      u.row(i) = U.row(domain.cells()(t, i));
    }
    const auto [i0, i1] = cell_range(x.col(0).minCoeff(), x.col(0).maxCoeff(), 0);
    const auto [j0, j1] = cell_range(x.col(1).minCoeff(), x.col(1).maxCoeff(), 1);
    const auto G = domain.gradient(t);
    for (Index i = i0; i <= i1; ++i) {
      for (Index j = j0; j <= j1; ++j) {
        const Eigen::RowVector2d point =
            low + Eigen::RowVector2d((i + 0.5) * extent[0] / lattice, (j + 0.5) * extent[1] / lattice);
        Eigen::RowVector3d barycentric = (point - x.row(0)) * G;
        barycentric[0] += 1.0;
        if (barycentric.minCoeff() >= -1e-12) images.row(i * lattice + j) = barycentric * u;
      }
    }
  }
  return images;
}

PointResult run(const Config& config) {
  const Stopwatch total;
  const ConfigNode root = config.root();
  LoadedDomain loaded = load_domain(root.at("domain"), config.folder());
  const Domain& domain = loaded.domain;
  if (domain.kind() != DomainKind::planar) {
    throw DataError(fmt::format("{}: pipeline 'deform.planar' needs a planar triangle mesh, this one is {}",
                                root.at("domain").string_or("mesh", root.at("domain").string_or("generator", "")),
                                to_string(domain.kind())));
  }
  const auto energy = read_energy(root.at("energy"));
  const NormOptions norm = read_norm(config);
  Solver solver = read_solver(config);
  LoadedConstraints constraints = load_constraints(constraint_tables(config), loaded);
  const Index lattice = read_lattice(config);

  PointResult result;
  result.warnings = loaded.warnings;
  if (domain.facet_count() == 0 && norm.beta > 0.0)
    result.warnings.emplace_back("the mesh has no interior facets: beta has no effect");
  Problem problem(domain, *energy, norm, constraints.constraints);
  Matrix U = domain.positions();
  Index kept_targets = 0;
  bool converged = true;
  int iterations = 1;
  if (problem.traits().state == StateDependence::none) {
    U = problem.solve(*solver.linear);
  } else {
    if (solver.start != "rest") {
      const EnergyEntry& entry = energies().find(solver.start);
      const auto start = entry.make(Parameters(entry.parameters));
      U = Problem(domain, *start, norm, constraints.constraints).solve(*solver.linear);
    } else {
      for (const auto& fixed : constraints.constraints.fixed()) U.row(fixed.vertex) = fixed.value;
    }
    ProblemObjective objective(problem, *solver.linear);
    U = solver.nonlinear->minimize(objective, U, solver.options);
    const NonlinearReport& report = solver.nonlinear->report();
    converged = report.converged;
    iterations = report.iterations;
    kept_targets = objective.undefined_targets();
    if (!converged) result.warnings.push_back("not converged: " + report.reason);
    Curve energies_curve{"E", {}, {}};
    Curve steps{"step", {}, {}};
    for (const NonlinearStep& step : report.history) {
      energies_curve.x.push_back(step.iteration);
      energies_curve.y.push_back(step.energy.total);
      if (step.iteration == 0) continue;
      steps.x.push_back(step.iteration);
      steps.y.push_back(step.step);
    }
    result.history = {energies_curve, steps};
    problem.refresh_target(U);
  }

  const EnergyValue value = problem.value(U);
  const Matrix R = problem.residual(U);
  const Vector local = R.rowwise().squaredNorm();
  const Distortion errors = distortion(domain, U);
  const LinearReport& linear = solver.linear->report();
  const auto integer = [](auto n) { return static_cast<std::int64_t>(n); };
  Row& row = result.metrics;
  row.set("vertices", integer(domain.vertex_count()));
  row.set("cells", integer(domain.cell_count()));
  row.set("beta", norm.beta);
  row.set("facet_weight", to_string(norm.facet_weight));
  const MeshQuality quality = mesh_quality(domain);
  row.set("measure_ratio", quality.measure_ratio);
  row.set("radius_ratio", quality.max_radius_ratio);
  row.set("energy", value.plain);
  row.set("energy_R", residual_variation(domain, norm.facet_weight, R));
  row.set("energy_W", value.total);
  row.set("energy_mean", value.plain / domain.total_measure());
  row.set("local_energy_max", local.maxCoeff());
  row.set("flipped", integer(errors.flipped.size()));
  row.set("min_det", errors.min_determinant);
  row.set("area_ratio", errors.area_ratio);
  row.set("E_isom", errors.isometric);
  row.set("E_conf", errors.conformal);
  row.set("E_auth", errors.authalic);
  row.set("E_metr", errors.metric);
  row.set("displacement", (U - domain.positions()).cwiseAbs().maxCoeff() / domain.diameter());
  row.set("boundary_crossings", integer(boundary_crossings(domain, U)));
  double soft_error = 0.0;
  for (const auto& soft : constraints.constraints.soft())
    soft_error = std::max(soft_error, (U.row(soft.vertex) - soft.value).norm());
  row.set("soft_error", soft_error);
  row.set("iterations", integer(iterations));
  row.set("converged", converged);
  row.set("undefined_targets", integer(kept_targets));
  row.set("solver", linear.backend);
  row.set("solver_residual", linear.residual);
  row.set("unknowns", integer(linear.columns));
  row.set("nnz_H", integer(linear.nnz_matrix));
  row.set("nnz_L", linear.nnz_factor >= 0 ? Value(integer(linear.nnz_factor)) : Value());
  row.set("flops", linear.flops >= 0.0 ? Value(linear.flops) : Value());
  const ProblemTimes& times = problem.times();
  row.set("seconds_declare", times.declare);
  row.set("seconds_pattern", times.pattern);
  row.set("seconds_refill", times.refill);
  row.set("seconds_analyze", times.analyze);
  row.set("seconds_factorize", times.factorize);
  row.set("seconds_solve", times.solve);
  row.set("seconds_total", total.seconds());

  result.mesh = loaded.as_input(U);
  result.fields = {{"local_energy", MeshField::On::cells, local}};
  Matrix displacement = Matrix::Zero(U.rows(), 3);
  displacement.leftCols(2) = U - domain.positions();
  result.fields.push_back({"displacement", MeshField::On::vertices, loaded.values_as_input(displacement)});
  MeshFigure figure;
  figure.name = "deformed";
  figure.caption = "Deformed mesh, cells coloured by their energy |r|².";
  figure.mesh = {U, domain.cells()};
  figure.cell_values = local;
  figure.fixed_vertices = constraints.fixed;
  figure.moved_vertices = constraints.moved;
  figure.soft_vertices = constraints.soft;
  figure.flipped_cells = errors.flipped;
  result.figures = {figure};
  result.probes = probe(domain, U, lattice);
  result.probe_scale = domain.diameter();
  return result;
}

}  // namespace

PipelineEntry describe_deform_planar() {
  return {
      .name = "deform.planar",
      .doc =
          "deforms a planar mesh by a regularized energy under constraints (Martinez Esturo 2013, sec. 7.4.1, 7.4.2)",
      .sections = {"domain", "energy", "norm", "constraint", "solver", "probe"},
      .parameters = {{"norm", kNormParameters}, {"solver", solver_parameters()}, {"probe", kProbeParameters}},
      .metrics = {{{"vertices"}, "vertices of the mesh"},
                  {{"cells"}, "triangles"},
                  {{"beta"}, "regularization weight of the row"},
                  {{"facet_weight", "facet weight"}, "weight of residual jumps of the row"},
                  {{"measure_ratio", "area max/min"}, "largest by smallest cell area at rest"},
                  {{"radius_ratio", "radius ratio"}, "largest circumradius by inradius of a cell at rest"},
                  {{"energy", "E_P"}, "unregularized energy, sum of A_t |r_t|^2"},
                  {{"energy_R", "E_R"}, "variation of the residual, sum of b_f |r_l - r_r|^2"},
                  {{"energy_W", "E_W"}, "regularized energy ||r||^2_W"},
                  {{"energy_mean", "E_P / area"}, "unregularized energy by rest area"},
                  {{"local_energy_max", "max |r|²"}, "largest |r_t|^2"},
                  {{"flipped"}, "cells whose orientation is not positive relative to rest"},
                  {{"min_det", "min det"}, "smallest determinant of the deformation gradient"},
                  {{"area_ratio", "area ratio"}, "signed area by rest area"},
                  {{"E_isom"}, "isometric distortion, mean of sum (sigma_i - 1)^2"},
                  {{"E_conf"}, "conformal distortion"},
                  {{"E_auth"}, "authalic distortion"},
                  {{"E_metr"}, "metric distortion"},
                  {{"displacement"}, "largest change of a coordinate by the diameter"},
                  {{"boundary_crossings", "crossings"}, "pairs of boundary edges that cross in the result"},
                  {{"soft_error", "soft error"}, "largest distance of a softly constrained vertex from its target"},
                  {{"iterations"}, "of the nonlinear backend; 1 for linear energies"},
                  {{"converged"}, "whether the stopping rule held (an iteration limit is not convergence)"},
                  {{"undefined_targets"}, "cells, summed over iterations, whose closest rotation was undefined"},
                  {{"solver"}, "linear backend that did the work"},
                  {{"solver_residual", "residual", "", 2}, "relative residual of the last solve"},
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
                  {{"seconds_total", "total", "s", 3}, "wall time of the point"},
                  {{"map_difference"},
                   "with [compare]: largest distance of probe images from the reference, by the diameter"}},
      .figures = {"deformed"},
      .run = run,
      .inputs = inputs,
      .check = check};
}

}  // namespace variform
