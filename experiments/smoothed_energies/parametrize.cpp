// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "energies/energies.h"
#include "energies/parametrization/parametrization.h"
#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/operators/distortion.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Nonlinear energies start from the initial map.
const std::vector<std::string> kStarts = {"initial", "lscm", "tutte", "regularized"};

const std::vector<Parameter> kMapParameters = {
    {.name = "initial",
     .value = std::string("lscm"),
     .doc = "map in which pins are held unless they say otherwise: free LSCM, Tutte, or (x, y) of the surface",
     .choices = {"lscm", "tutte", "projection"}},
    {.name = "boundary",
     .value = std::string("circle"),
     .doc = "convex shape of the boundary of Tutte maps",
     .choices = {"circle", "square"}},
    {.name = "weights",
     .value = std::string("mean_value"),
     .doc = "of Tutte maps",
     .choices = {"uniform", "mean_value"}}};

Parameters read_map(const Config& config) {
  if (!config.root().has("parametrization")) return Parameters(kMapParameters);
  return config.root().at("parametrization").parameters(kMapParameters);
}

// Metrics of a result that depend on what u is.
std::vector<Metric> own_metrics() {
  return distortion_metrics(
      {{{"start_flipped", "flipped at start"}, "nonlinear energies: triangles that the start has mirrored"},
       {{"displacement"}, "largest change of a coordinate from the initial map, by the diameter of the surface"},
       {{"boundary_crossings", "crossings"}, "pairs of boundary edges that cross in the map"}});
}

void check(const Config& config) {
  check_domain(config.root().at("domain"));
  read_energy(config.root().at("energy"), false);
  read_norm(config, own_metrics());
  read_solver(config, kStarts);
  check_constraints(constraint_tables(config));
  read_map(config);
}

// Free-boundary least-squares conformal map, turned and scaled to nothing but the area of the surface.
Matrix lscm_map(const Domain& domain) {
  const EnergyEntry& entry = energies().find("lscm");
  const auto lscm = entry.make(Parameters(entry.parameters));
  const auto linear = make_linear_backend("auto");
  const Matrix U = Problem(domain, *lscm, {}, default_pins(domain)).solve(*linear);
  const double ratio = distortion(domain, U).area_ratio;
  if (!(ratio > 0.0)) throw DataError("the free least-squares conformal map has no positive area; start from tutte");
  return U / std::sqrt(ratio);
}

Matrix named_map(const std::string& name, const Domain& domain, const Parameters& map) {
  if (name == "lscm") return lscm_map(domain);
  if (name == "projection") return domain.positions().leftCols(2);
  const auto linear = make_linear_backend("auto");
  return tutte_map(domain, map.string("boundary") == "square" ? TutteBoundary::square : TutteBoundary::circle,
                   map.string("weights") == "uniform" ? TutteWeights::uniform : TutteWeights::mean_value, *linear);
}

// The pins of a map without any: two vertices for linear energies, whose minimizer would be a point with fewer, one for
// nonlinear ones, which know the size.
void pin(const Domain& domain, const Matrix& initial, bool linear, LoadedConstraints& loaded) {
  const Constraints defaults = default_pins(domain);
  const std::size_t count = linear ? 2 : 1;
  for (std::size_t i = 0; i < count; ++i) {
    const Index v = defaults.fixed()[i].vertex;
    loaded.constraints.fix(v, initial.row(v));
    loaded.fixed.push_back(v);
  }
}

// With a single pin the whole map goes there: to move one vertex alone could flip the triangles at it.
void move_to_only_pin(const Constraints& constraints, Matrix& map) {
  if (constraints.fixed().size() != 1 || !constraints.soft().empty() || !constraints.equalities().empty()) return;
  const Constraints::Value& pin = constraints.fixed().front();
  const Eigen::RowVectorXd shift = pin.value - map.row(pin.vertex);
  map.rowwise() += shift;
}

bool holds_two_points(const Constraints& constraints) {
  std::vector<Eigen::RowVectorXd> values;
  for (const auto& fixed : constraints.fixed()) values.push_back(fixed.value);
  for (const auto& soft : constraints.soft()) values.push_back(soft.value);
  for (const auto& value : values) {
    if (value != values.front()) return true;
  }
  return !constraints.equalities().empty();
}

PointResult run(const Config& config) {
  const ConfigNode root = config.root();
  const LoadedDomain loaded = load_domain(root.at("domain"), config.folder());
  const Domain& domain = loaded.domain;
  const auto energy = read_energy(root.at("energy"), false);
  const EnergyTraits traits = root.at("energy").at("type").located([&] { return energy->traits(domain); });
  if (domain.kind() == DomainKind::tetrahedral || traits.dimension() != 2) {
    root.at("energy").at("type").fail(fmt::format("this energy maps a {} mesh to dimension {}: no parametrization",
                                                  to_string(domain.kind()), traits.dimension()));
  }
  const NormChoice norm = read_norm(config, own_metrics());
  SolverChoice solver = read_solver(config, kStarts);
  const Parameters map = read_map(config);
  const bool linear = traits.state == StateDependence::none;

  PointResult result;
  result.warnings = loaded.warnings;
  const Matrix initial = named_map(map.string("initial"), domain, map);
  LoadedConstraints constraints = load_constraints(constraint_tables(config), loaded, {.state = initial});
  if (constraint_tables(config).empty()) {
    pin(domain, initial, linear, constraints);
    // With beta > 0 the alternation turns the map about a single pin for ever.
    if (!solver.backend_named) solver.nonlinear = make_nonlinear_backend("gauss_newton");
  }
  adapt_to_barrier(traits, "tutte", solver);
  if (linear && !holds_two_points(constraints.constraints)) {
    throw DataError("a linear parametrization needs two pins at different places: with fewer it shrinks to a point");
  }

  set_sizes(domain, result.metrics);
  Study study{domain, *energy, norm, constraints.constraints, solver, {}, {}};
  study.measure = [&](const Matrix& U, Row& row) {
    set_distortion(domain, U, row);
    row.set("displacement", (U - initial).cwiseAbs().maxCoeff() / domain.diameter());
    row.set("boundary_crossings", static_cast<std::int64_t>(boundary_crossings(domain, U)));
  };
  Matrix start;
  if (!linear) {
    const bool regularized = solver.start == "regularized";
    start = solver.start == "initial" ? initial : named_map(regularized ? "tutte" : solver.start, domain, map);
    move_to_only_pin(constraints.constraints, start);
    if (regularized) start = regularized_start(study, "arap_parametrization", start);
    result.metrics.set("start_flipped", static_cast<std::int64_t>(distortion(domain, start).flipped.size()));
    study.start = [&](double) { return start; };
  }
  Vector local;
  const Matrix U = run_study(study, result, local);

  const CellDistortion cells = cell_distortion(domain, U);
  result.mesh = loaded.uncut();
  result.uv = U;
  result.uv_cells = domain.cells();
  result.fields = {{"local_energy", MeshField::On::cells, on_cells(domain, local)},
                   {"isometric_distortion", MeshField::On::cells, cells.isometric},
                   {"conformal_ratio", MeshField::On::cells, cells.conformal_ratio},
                   {"determinant", MeshField::On::cells, cells.determinant}};
  const MeshFigure plane = study_figure("uv", U, domain, local, constraints, cells.flipped);
  MeshFigure texture = plane;
  texture.name = "texture";
  texture.mesh = {domain.positions(), domain.cells()};
  texture.uv = U;
  texture.edges = false;
  result.figures = {plane, texture};
  return result;
}

std::vector<Metric> metrics() { return study_metrics(own_metrics()); }

std::vector<Section> sections() {
  std::vector<Section> all = study_sections(kStarts);
  all.push_back({"parametrization", kMapParameters});
  return all;
}

}  // namespace

PipelineEntry describe_parametrize() {
  return {.name = "parametrize",
          .doc =
              "maps a surface to the plane by a regularized energy, with pins anywhere (Martinez Esturo 2013, sec. "
              "7.4.5)",
          .sections = {"domain", "energy", "norm", "constraint", "solver", "parametrization"},
          .parameters = sections(),
          .metrics = metrics(),
          .figures = {"uv", "texture"},
          .run = run,
          .inputs = study_inputs,
          .check = check};
}

}  // namespace variform
