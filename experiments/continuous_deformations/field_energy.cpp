// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/form/problem.h"

namespace variform {
namespace {

constexpr int kShown = 24;  // tessellations whose energies are metrics of their own

std::vector<ConfigNode> tessellations(const Config& config) {
  return config.root().has("tessellation") ? config.root().at("tessellation").elements() : std::vector<ConfigNode>();
}

NormOptions read_norm(const Config& config) {
  const Parameters p = section_of(config, "norm", velocity_norm_parameters());
  return {p.number("beta"), facet_weight_from(p.string("facet_weight"))};
}

// Unit normals at the vertices, means over the incident triangles by area.
Matrix vertex_normals(const Domain& domain) {
  Matrix normals = Matrix::Zero(domain.vertex_count(), 3);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) {
      normals.row(domain.cells()(t, i)) += domain.cell_measures()[t] * domain.normals().row(t);
    }
  }
  normals.rowwise().normalize();
  return normals;
}

void check(const Config& config) {
  read_energy(config.root().at("energy"), true);
  read_norm(config);
  if (tessellations(config).size() < 2) throw UsageError("field_energy: expected two [[tessellation]] tables or more");
  for (const ConfigNode& node : tessellations(config)) check_domain(node);
}

PointResult run(const Config& config) {
  const auto energy = read_energy(config.root().at("energy"), true);
  PointResult result;
  std::vector<double> values;
  for (const ConfigNode& node : tessellations(config)) {
    const LoadedDomain loaded = load_domain(node, config.folder());
    const Domain& domain = loaded.domain;
    if (domain.kind() != DomainKind::surface) node.fail("the normal field needs a surface");
    Constraints all(domain.vertex_count(), 3);
    for (Index v = 0; v < domain.vertex_count(); ++v) all.fix(v, Eigen::RowVector3d::Zero());
    const Problem problem(domain, *energy, read_norm(config), std::move(all));
    values.push_back(problem.value(vertex_normals(domain)).total * domain.cell_count());
    if (values.size() <= kShown) result.metrics.set(fmt::format("energy_{}", values.size()), values.back());
  }
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  double mean = 0.0;
  for (const double value : values) mean += value / static_cast<double>(values.size());
  double variance = 0.0;
  for (const double value : values) {
    variance += (value - mean) * (value - mean) / static_cast<double>(values.size() - 1);
  }
  result.metrics.set("tessellations", static_cast<std::int64_t>(values.size()));
  result.metrics.set("max_by_min", *high / *low);
  result.metrics.set("variation", std::sqrt(variance) / mean);
  return result;
}

std::vector<Metric> metrics() {
  std::vector<Metric> all = {
      {{"tessellations"}, "number of them"},
      {{"max_by_min", "max/min"}, "of energy times cells over the tessellations"},
      {{"variation", "coefficient of variation"}, "standard deviation by mean of energy times cells"}};
  for (int i = 1; i <= kShown; ++i) {
    all.push_back({{fmt::format("energy_{}", i)}, "energy of the field times the number of cells, by tessellation"});
  }
  return all;
}

std::vector<std::filesystem::path> inputs(const Config& config) {
  std::vector<std::filesystem::path> files;
  for (const ConfigNode& node : tessellations(config)) {
    if (node.has("mesh")) files.push_back(find_input(node.at("mesh").string(), config.folder()));
  }
  return files;
}

}  // namespace

PipelineEntry describe_field_energy() {
  return {.name = "field_energy",
          .doc =
              "energy of the field of unit normals on several tessellations of a surface (Martinez Esturo 2013, "
              "Figure 16a)",
          .sections = {"energy", "norm", "tessellation"},
          .parameters = {{"norm", velocity_norm_parameters()}},
          .metrics = metrics(),
          .figures = {},
          .run = run,
          .inputs = inputs,
          .check = check};
}

}  // namespace variform
