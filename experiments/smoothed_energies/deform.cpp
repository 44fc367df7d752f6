// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "energies/energies.h"
#include "energies/gradient/poisson.h"
#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/operators/distortion.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"

namespace variform {
namespace {

const std::vector<std::string> kStarts = {"rest", "larap", "poisson", "regularized"};

const std::vector<Parameter> kProbeParameters = {{.name = "lattice",
                                                  .value = std::int64_t{0},
                                                  .doc = "probe points per side of the bounding box, for [compare]",
                                                  .min = 0.0,
                                                  .max = 1000.0}};

Index read_lattice(const Config& config) {
  if (!config.root().has("probe")) return 0;
  return static_cast<Index>(config.root().at("probe").parameters(kProbeParameters).integer("lattice"));
}

// Metrics of a result that depend on what u is.
std::vector<Metric> own_metrics() {
  return distortion_metrics(
      {{{"displacement"}, "largest change of a coordinate by the diameter"},
       {{"spike"}, "largest distance of a moved vertex from the mean of its neighbours"},
       {{"boundary_crossings", "crossings"}, "planar: pairs of boundary edges that cross in the result"}});
}

void check(const Config& config) {
  check_domain(config.root().at("domain"));
  read_energy(config.root().at("energy"), false);
  read_norm(config, own_metrics());
  read_solver(config, kStarts);
  check_constraints(constraint_tables(config));
  read_lattice(config);
}

// How far moved vertices stick out: the largest distance of one from the mean of its neighbours.
double spike_height(const Domain& domain, const Matrix& U, const std::vector<Index>& moved) {
  if (moved.empty()) return 0.0;
  std::map<Index, std::set<Index>> neighbours;
  for (const Index v : moved) neighbours[v];
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < domain.cell_size(); ++i) {
      const auto found = neighbours.find(domain.cells()(t, i));
      if (found == neighbours.end()) continue;
      for (int j = 0; j < domain.cell_size(); ++j) {
        if (j != i) found->second.insert(domain.cells()(t, j));
      }
    }
  }
  double height = 0.0;
  for (const auto& [vertex, around] : neighbours) {
    Eigen::RowVectorXd mean = Eigen::RowVectorXd::Zero(U.cols());
    for (const Index v : around) mean += U.row(v) / static_cast<double>(around.size());
    height = std::max(height, (U.row(vertex) - mean).norm());
  }
  return height;
}

// The gradients that the coordinates have at rest: I, less the normal part on surfaces.
std::unique_ptr<Energy> poisson_at_rest(const Domain& domain) {
  const int p = domain.ambient_dimension();
  Matrix guidance(domain.cell_count(), p * p);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::MatrixXd F = deformation(domain, t, domain.positions());
    guidance.row(t) = Eigen::Map<const Eigen::RowVectorXd>(F.data(), F.size());
  }
  return make_poisson(guidance, p);
}

Matrix start_state(const Study& study, double beta) {
  if (study.solver.start == "rest") return study.domain.positions();
  if (study.solver.start == "regularized") return regularized_start(study, "arap", study.domain.positions());
  const EnergyEntry& larap = energies().find("larap");
  const auto start =
      study.solver.start == "larap" ? larap.make(Parameters(larap.parameters)) : poisson_at_rest(study.domain);
  NormOptions norm = study.norm.options;
  norm.beta = beta;
  const auto linear = make_linear_backend("auto");
  return Problem(study.domain, *start, norm, study.constraints).solve(*linear);
}

PointResult run(const Config& config) {
  const ConfigNode root = config.root();
  const LoadedDomain loaded = load_domain(root.at("domain"), config.folder());
  const Domain& domain = loaded.domain;
  const auto energy = read_energy(root.at("energy"), false);
  const EnergyTraits traits = root.at("energy").at("type").located([&] { return energy->traits(domain); });
  if (traits.dimension() != domain.ambient_dimension()) {
    root.at("energy").at("type").fail(
        fmt::format("this energy maps a {} mesh to dimension {}: no deformation (see pipeline parametrize)",
                    to_string(domain.kind()), traits.dimension()));
  }
  const NormChoice norm = read_norm(config, own_metrics());
  SolverChoice solver = read_solver(config, kStarts);
  adapt_to_barrier(traits, "regularized", solver);
  const LoadedConstraints constraints = load_constraints(constraint_tables(config), loaded);
  const Index lattice = read_lattice(config);
  if (lattice > 0 && domain.kind() != DomainKind::planar) {
    root.at("probe").at("lattice").fail("probe points are for planar meshes");
  }

  std::vector<Index> moved = constraints.moved;
  moved.insert(moved.end(), constraints.soft.begin(), constraints.soft.end());
  PointResult result;
  result.warnings = loaded.warnings;
  set_sizes(domain, result.metrics);
  Study study{domain, *energy, norm, constraints.constraints, solver, {}, {}};
  study.measure = [&](const Matrix& U, Row& row) {
    set_distortion(domain, U, row);
    row.set("displacement", (U - domain.positions()).cwiseAbs().maxCoeff() / domain.diameter());
    row.set("spike", spike_height(domain, U, moved));
    if (domain.kind() == DomainKind::planar) {
      row.set("boundary_crossings", static_cast<std::int64_t>(boundary_crossings(domain, U)));
    }
  };
  study.start = [&](double beta) { return start_state(study, beta); };
  Vector local;
  const Matrix U = run_study(study, result, local);

  result.mesh = loaded.as_input(U);
  const CellDistortion cells = cell_distortion(domain, U);
  Matrix displacement = Matrix::Zero(U.rows(), 3);
  displacement.leftCols(U.cols()) = U - domain.positions();
  result.fields = {local_energy_field(loaded, local),
                   {"isometric_distortion", MeshField::On::cells, cells.isometric},
                   {"displacement", MeshField::On::vertices, loaded.values_as_input(displacement)}};
  result.figures = {study_figure("deformed", U, domain, local, constraints, cells.flipped)};
  if (domain.kind() == DomainKind::planar) {
    if (lattice > 0) result.probes = lattice_images(domain, U, lattice);
    result.probe_scale = domain.diameter();
  }
  return result;
}

std::vector<Metric> metrics() {
  const std::vector<Metric> compared = {
      {{"map_difference"}, "with [compare]: largest distance of probe images from the reference, by the diameter"},
      {{"map_difference_mean"}, "with [compare]: their mean"}};
  std::vector<Metric> all = study_metrics(own_metrics());
  all.insert(all.end(), compared.begin(), compared.end());
  return all;
}

std::vector<Section> sections() {
  std::vector<Section> all = study_sections(kStarts);
  all.push_back({"probe", kProbeParameters});
  return all;
}

}  // namespace

PipelineEntry describe_deform() {
  return {.name = "deform",
          .doc =
              "deforms a planar, surface or tetrahedral mesh by a regularized energy under constraints (Martinez "
              "Esturo 2013, sec. 7.4.1 to 7.4.3)",
          .sections = {"domain", "energy", "norm", "constraint", "solver", "probe"},
          .parameters = sections(),
          .metrics = metrics(),
          .figures = {"deformed"},
          .run = run,
          .inputs = study_inputs,
          .check = check};
}

}  // namespace variform
