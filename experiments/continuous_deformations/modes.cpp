// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/continuous_deformations/segmentation.h"
#include "experiments/smoothed_energies/study.h"
#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/form/spectrum.h"
#include "solvers/eigen/eigen_backends.h"

namespace variform {
namespace {

constexpr std::size_t kMostRegions = 9;  // all their matches with segments are tried
constexpr int kShown = 12;               // eigenvalues that are metrics of their own

const std::vector<Parameter> kModesParameters = {
    {.name = "count", .value = std::int64_t{20}, .doc = "smallest eigenpairs", .min = 7.0, .max = 1000.0},
    {.name = "backend", .value = std::string("spectra.shift_invert"), .doc = "eigen backend"},
    {.name = "mass",
     .value = std::string("identity"),
     .doc = "identity: as published, depends on the mesh; consistent: weighted by area or volume",
     .choices = {"identity", "consistent"}},
    {.name = "segments", .value = std::int64_t{0}, .doc = "most segments tried; 0: none", .min = 0.0, .max = 9.0},
    {.name = "graph",
     .value = std::string("similarity"),
     .doc = "vertices that a segmentation joins: those of an edge, or also those of similar features",
     .choices = {"edges", "similarity"}},
    {.name = "shown",
     .value = std::int64_t{6},
     .doc = "which mode beyond the zero modes the figure shows",
     .min = 1.0}};

std::unique_ptr<EigenBackend> make_backend(const Config& config) {
  const std::string name = section_of(config, "modes", kModesParameters).string("backend");
  const auto make = [&] { return make_eigen_backend(name); };
  const bool named = config.root().has("modes") && config.root().at("modes").has("backend");
  return named ? config.root().at("modes").at("backend").located(make) : make();
}

std::vector<ConfigNode> region_tables(const Config& config) {
  return config.root().has("segment") ? config.root().at("segment").elements() : std::vector<ConfigNode>();
}

// Label of every vertex by the boxes of the [[segment]] tables, the last one that holds it; -1: none.
std::vector<int> reference_labels(const Config& config, const Domain& domain) {
  const int d = domain.ambient_dimension();
  std::vector<int> labels(static_cast<std::size_t>(domain.vertex_count()), -1);
  int label = 0;
  for (const ConfigNode& node : region_tables(config)) {
    node.accept_keys({"region"});
    const std::vector<double> box = node.at("region").numbers();
    if (box.size() != static_cast<std::size_t>(2 * d)) {
      node.at("region").fail(fmt::format("expected {} numbers on this mesh", 2 * d));
    }
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      bool inside = true;
      for (int c = 0; c < d; ++c) {
        const double x = domain.positions()(v, c);
        inside = inside && x >= box[static_cast<std::size_t>(c)] && x <= box[static_cast<std::size_t>(d + c)];
      }
      if (inside) labels[static_cast<std::size_t>(v)] = label;
    }
    ++label;
  }
  label = 0;
  for (const ConfigNode& node : region_tables(config)) {
    if (std::find(labels.begin(), labels.end(), label++) == labels.end()) {
      node.at("region").fail("no vertex is in it, or later tables have them all");
    }
  }
  return labels;
}

// The spectrum is that of the free shape; a problem wants to be held all the same.
Constraints held_somewhere(const Domain& domain) {
  Constraints constraints(domain.vertex_count(), domain.ambient_dimension());
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    constraints.fix(v, Eigen::RowVectorXd::Zero(domain.ambient_dimension()));
  }
  return constraints;
}

std::vector<Metric> metrics() {
  std::vector<Metric> all = {
      {{"vertices"}, "vertices of the mesh"},
      {{"cells"}, "triangles or tetrahedra"},
      {{"measure_ratio", "measure max/min"}, "largest by smallest cell measure"},
      {{"radius_ratio", "radius ratio"}, "largest circumradius by inradius of a cell"},
      {{"beta"}, "regularization weight"},
      {{"lambda_max"}, "bound of the largest eigenvalue (largest absolute row sum, by the smallest mass)"},
      {{"zero_modes", "zero modes"}, "eigenvalues below 1e-10 lambda_max"},
      {{"gap"}, "first eigenvalue beyond the zero modes by lambda_max"},
      {{"rigid_residual"}, "part of the rigid motions outside the span of the zero modes"},
      {{"eigen_residual"}, "largest residual of a pair"},
      {{"operations"}, "solves with the shifted matrix"},
      {{"descriptor_ratio"}, "mean stiffness descriptor of the first [[segment]] by that of the last"},
      {{"segments"}, "chosen number of segments"},
      {{"agreement"}, "share of the vertices in [[segment]] tables that the segments match"},
      {{"agreement_known"}, "the same with as many segments as there are [[segment]] tables"},
      {{"seconds_total", "total", "s"}, "of the point"}};
  for (int i = 1; i <= kShown; ++i) all.push_back({{fmt::format("lambda_{}", i)}, "eigenvalue"});
  return all;
}

void check(const Config& config) {
  check_domain(config.root().at("domain"));
  read_energy(config.root().at("energy"), true);
  section_of(config, "norm", velocity_norm_parameters());
  if (section_of(config, "modes", kModesParameters).integer("segments") == 1) {
    config.root().at("modes").at("segments").fail("expected 0, or 2 and more");
  }
  make_backend(config);
  const std::vector<ConfigNode> regions = region_tables(config);
  if (regions.size() > kMostRegions) {
    regions.back().fail(fmt::format("expected at most {} [[segment]] tables", kMostRegions));
  }
  for (const ConfigNode& node : regions) {
    node.accept_keys({"region"});
    node.at("region").numbers();
  }
}

PointResult run(const Config& config) {
  const Stopwatch watch;
  const LoadedDomain loaded = load_domain(config.root().at("domain"), config.folder());
  const Domain& domain = loaded.domain;
  const auto energy = read_energy(config.root().at("energy"), true);
  const EnergyTraits traits = config.root().at("energy").at("type").located([&] { return energy->traits(domain); });
  if (traits.columns != 1) {
    config.root().at("energy").at("type").fail("coordinates decouple here: its modes are functions, not velocities");
  }
  const std::vector<int> reference = reference_labels(config, domain);
  const Parameters norm = section_of(config, "norm", velocity_norm_parameters());
  const Parameters p = section_of(config, "modes", kModesParameters);
  const int d = domain.ambient_dimension();
  Problem problem(domain, *energy, {norm.number("beta"), facet_weight_from(norm.string("facet_weight"))},
                  held_somewhere(domain));
  const auto backend = make_backend(config);
  const auto count = static_cast<Index>(p.integer("count"));
  const bool weighted = p.string("mass") == "consistent";
  const EigenPairs modes =
      spectrum(problem, *backend, count, weighted ? SpectrumMetric::mass : SpectrumMetric::identity);
  const SparseMatrix& H = problem.normal_matrix();

  PointResult result;
  result.warnings = loaded.warnings;
  Row& row = result.metrics;
  set_sizes(domain, row);
  row.set("beta", norm.number("beta"));
  // Gershgorin; consistent masses are at least those of the smallest cell over its corners' count.
  Vector sums = Vector::Zero(H.rows());
  for (Index j = 0; j < H.outerSize(); ++j) {
    for (SparseMatrix::InnerIterator entry(H, j); entry; ++entry) {
      sums[j] += std::abs(entry.value());
      if (entry.row() != j) sums[entry.row()] += std::abs(entry.value());
    }
  }
  double largest = sums.maxCoeff();
  if (weighted) {
    const int corners = domain.cell_size();
    largest /= domain.cell_measures().minCoeff() / (corners * (corners + 1));
  }
  Index zeros = 0;
  while (zeros < count && modes.values[zeros] < 1e-10 * largest) ++zeros;
  row.set("lambda_max", largest);
  row.set("zero_modes", static_cast<std::int64_t>(zeros));
  row.set("gap", zeros < count ? Value(modes.values[zeros] / largest) : Value());
  const Eigen::MatrixXd rigid = kernel_basis({.unknowns = d, .kernel = Kernel::rigid_motions}, domain);
  const Eigen::MatrixXd V = modes.vectors.leftCols(zeros);
  if (zeros > 0) {
    const Eigen::MatrixXd rest = rigid - V * (V.transpose() * V).ldlt().solve(V.transpose() * rigid);
    row.set("rigid_residual", rest.norm() / rigid.norm());
  }
  row.set("eigen_residual", backend->report().residual);
  row.set("operations", backend->report().operations);
  for (int i = 0; i < std::min<int>(kShown, static_cast<int>(count)); ++i) {
    row.set(fmt::format("lambda_{}", i + 1), modes.values[i]);
  }

  const Matrix features = mode_features(modes, zeros, d);
  const Vector descriptor = stiffness_descriptor(features);
  const auto tables = static_cast<int>(region_tables(config).size());
  if (tables >= 2) {
    const auto mean = [&](int label) {
      double sum = 0.0;
      int vertices = 0;
      for (std::size_t v = 0; v < reference.size(); ++v) {
        if (reference[v] != label) continue;
        sum += descriptor[static_cast<Index>(v)];
        ++vertices;
      }
      return sum / vertices;
    };
    row.set("descriptor_ratio", mean(0) / mean(tables - 1));
  }
  const auto picture = [&](const std::string& name, const Matrix& X, const Vector& values, const std::string& label) {
    MeshFigure figure;
    figure.name = name;
    figure.mesh = {X, domain.cells()};
    figure.cell_values = on_cells(domain, values);
    figure.scale.label = label;
    result.figures.push_back(std::move(figure));
  };
  picture("descriptor", domain.positions(), descriptor, "stiffness descriptor");
  // A mode, its largest velocity a tenth of the diameter.
  const Index shown = std::min<Index>(zeros + static_cast<Index>(p.integer("shown")) - 1, count - 1);
  const Eigen::Map<const Matrix> velocity(modes.vectors.col(shown).data(), domain.vertex_count(), d);
  const double length = velocity.rowwise().norm().maxCoeff();
  picture("mode", domain.positions() + (0.1 * domain.diameter() / length) * velocity,
          Vector(velocity.rowwise().norm() / length), "speed");
  result.mesh = loaded.as_input(domain.positions());
  result.fields = {{"stiffness_descriptor", MeshField::On::vertices, loaded.values_as_input(descriptor)}};
  Matrix in_space = Matrix::Zero(domain.vertex_count(), 3);
  for (Index i = 0; i < std::min<Index>(count, kShown); ++i) {
    in_space.leftCols(d) = Eigen::Map<const Matrix>(modes.vectors.col(i).data(), domain.vertex_count(), d);
    result.fields.push_back({fmt::format("mode_{}", i + 1), MeshField::On::vertices, loaded.values_as_input(in_space)});
  }
  if (p.integer("segments") >= 2) {
    const auto graph_backend = make_backend(config);
    const Segmentation parts =
        segment(domain, features, static_cast<int>(p.integer("segments")),
                p.string("graph") == "edges" ? SegmentGraph::edges : SegmentGraph::similarity, *graph_backend);
    const std::vector<int>& labels = parts.labels[static_cast<std::size_t>(parts.segments - 2)];
    row.set("segments", static_cast<std::int64_t>(parts.segments));
    if (tables > 0) row.set("agreement", agreement(labels, reference));
    if (tables >= 2 && tables - 2 < static_cast<int>(parts.labels.size())) {
      row.set("agreement_known", agreement(parts.labels[static_cast<std::size_t>(tables - 2)], reference));
    }
    Vector values(domain.vertex_count());
    for (Index v = 0; v < domain.vertex_count(); ++v) values[v] = labels[static_cast<std::size_t>(v)];
    picture("segments", domain.positions(), values, "segment");
    result.fields.push_back({"segment", MeshField::On::vertices, loaded.values_as_input(values)});
    Curve cuts{"normalized cut by segments", {}, parts.cut};
    for (std::size_t k = 0; k < parts.cut.size(); ++k) cuts.x.push_back(static_cast<double>(k) + 2.0);
    result.history = {cuts};
  }
  row.set("seconds_total", watch.seconds());
  return result;
}

}  // namespace

PipelineEntry describe_modes() {
  return {.name = "modes",
          .doc =
              "smallest eigenpairs of a free shape's energy of velocities, stiffness descriptor, segmentation "
              "(Martinez Esturo 2013, sec. 4.4)",
          .sections = {"domain", "energy", "norm", "modes", "segment"},
          .parameters = {{"norm", velocity_norm_parameters()}, {"modes", kModesParameters}},
          .metrics = metrics(),
          .figures = {"mode", "descriptor", "segments"},
          .run = run,
          .inputs = study_inputs,
          .check = check};
}

}  // namespace variform
