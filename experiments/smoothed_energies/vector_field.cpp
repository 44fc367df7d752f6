// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/operators/distortion.h"

namespace variform {
namespace {

// The energies are linear: there is nothing to start from.
const std::vector<std::string> kStarts = {"rest"};

const std::vector<Parameter> kFlowParameters = {
    {.name = "step", .value = 1.0, .doc = "the figure and the distortion are of x + step v", .min = 0.0}};

double read_step(const Config& config) {
  if (!config.root().has("flow")) return 1.0;
  return config.root().at("flow").parameters(kFlowParameters).number("step");
}

// Metrics of a result that depend on what u is.
std::vector<Metric> own_metrics() {
  return distortion_metrics({{{"speed_max", "max |v|"}, "largest velocity of a vertex"}});
}

void check(const Config& config) {
  check_domain(config.root().at("domain"));
  read_energy(config.root().at("energy"), true);
  read_norm(config, own_metrics());
  read_solver(config, kStarts);
  check_constraints(constraint_tables(config), true);
  read_step(config);
}

PointResult run(const Config& config) {
  const ConfigNode root = config.root();
  const LoadedDomain loaded = load_domain(root.at("domain"), config.folder());
  const Domain& domain = loaded.domain;
  const auto energy = read_energy(root.at("energy"), true);
  root.at("energy").at("type").located([&] { return energy->traits(domain); });
  const NormChoice norm = read_norm(config, own_metrics());
  SolverChoice solver = read_solver(config, kStarts);
  const LoadedConstraints constraints = load_constraints(constraint_tables(config), loaded, {.velocities = true});
  const double step = read_step(config);

  PointResult result;
  result.warnings = loaded.warnings;
  set_sizes(domain, result.metrics);
  Study study{domain, *energy, norm, constraints.constraints, solver, {}, {}};
  study.measure = [&](const Matrix& V, Row& row) {
    set_distortion(domain, domain.positions() + step * V, row);
    row.set("speed_max", V.rowwise().norm().maxCoeff());
  };
  Vector local;
  const Matrix V = run_study(study, result, local);

  const Matrix moved = domain.positions() + step * V;
  result.mesh = loaded.as_input(moved);
  Matrix velocity = Matrix::Zero(V.rows(), 3);
  velocity.leftCols(V.cols()) = V;
  result.fields = {local_energy_field(loaded, local),
                   {"velocity", MeshField::On::vertices, loaded.values_as_input(velocity)}};
  result.figures = {study_figure("moved", moved, domain, local, constraints, cell_distortion(domain, moved).flipped)};
  return result;
}

std::vector<Metric> metrics() { return study_metrics(own_metrics()); }

std::vector<Section> sections() {
  std::vector<Section> all = study_sections(kStarts);
  all.push_back({"flow", kFlowParameters});
  return all;
}

}  // namespace

PipelineEntry describe_vector_field() {
  return {.name = "vector_field",
          .doc =
              "velocity field of least regularized energy for velocities at handles, one solve (Martinez Esturo 2013, "
              "sec. 7.4.4)",
          .sections = {"domain", "energy", "norm", "constraint", "solver", "flow"},
          .parameters = sections(),
          .metrics = metrics(),
          .figures = {"moved"},
          .run = run,
          .inputs = study_inputs,
          .check = check};
}

}  // namespace variform
