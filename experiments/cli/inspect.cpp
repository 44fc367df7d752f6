// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "energies/energies.h"
#include "experiments/cli/commands.h"
#include "experiments/pipelines.h"
#include "framework/domain/check.h"
#include "framework/domain/generators.h"
#include "framework/domain/mesh_io.h"
#include "framework/domain/quality.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/domain_source.h"
#include "framework/experiment/viewer.h"
#include "framework/form/problem_objective.h"
#include "integrators/ode/ode_backends.h"
#include "solvers/eigen/eigen_backends.h"
#include "solvers/linear/blas.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

// GPL as soon as a backend that is GPL is linked in.
std::string effective_licence() {
  const auto gpl = [](const auto& entry) {
    return entry.available && entry.licence.find("GPL-2.0") != std::string::npos &&
           entry.licence.find("LGPL") == std::string::npos;
  };
  if (std::ranges::any_of(linear_backends().entries(), gpl) ||
      std::ranges::any_of(nonlinear_backends().entries(), gpl)) {
    return "GPL-2.0-or-later (GPL parts of SuiteSparse are linked in, by a backend or by PETSc; the sources of "
           "variform are BSD-3-Clause)";
  }
  return "BSD-3-Clause (no SuiteSparse; Eigen is MPL-2.0)";
}

std::string blas_text(const BlasInfo& blas) {
  return fmt::format("{}, core {}, {} thread{}", blas.implementation, blas.core, blas.threads,
                     blas.threads == 1 ? "" : "s");
}

void list_parameters(const std::vector<Parameter>& parameters) {
  for (const Parameter& p : parameters) {
    std::string accepted = type_name(p.value);
    if (!p.choices.empty()) accepted = fmt::format("{}", fmt::join(p.choices, " | "));
    fmt::print("      {} = {}    {} ({})\n", p.name, to_string(p.value), p.doc, accepted);
  }
}

// ARAP on a strip whose ends are pulled apart, with each nonlinear backend.
bool try_nonlinear_backends() {
  const Domain domain(rectangle_mesh({.width = 1.0, .height = 0.5, .h = 0.25}));
  const EnergyEntry& arap = energies().find("arap");
  const auto energy = arap.make(Parameters(arap.parameters));
  Constraints constraints(domain.vertex_count(), 2);
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const double x = domain.positions()(v, 0);
    if (x == 0.0 || x == 1.0) constraints.fix(v, domain.positions().row(v) + Eigen::RowVector2d(0.3 * x, 0.2 * x));
  }
  bool well = true;
  for (const NonlinearBackendEntry& entry : nonlinear_backends().entries()) {
    if (!entry.available) {
      fmt::print("{}: not in this build; install {} and configure again\n", entry.name, entry.package);
      well = false;
      continue;
    }
    try {
      Problem problem(domain, *energy, {.beta = 0.2}, constraints);
      const auto linear = make_linear_backend("eigen.ldlt");
      ProblemObjective objective(problem, *linear);
      const auto backend = make_nonlinear_backend(entry.name);
      backend->minimize(objective, closest_feasible(constraints, domain.positions()), {.max_iterations = 5000});
      const NonlinearReport& report = backend->report();
      fmt::print("{}: {} ({} iterations, {})\n", entry.name, report.converged ? "works" : "FAILS", report.iterations,
                 report.reason);
      well = well && report.converged;
    } catch (const Error& error) {
      fmt::print("{}: FAILS: {}\n", entry.name, error.what());
      well = false;
    }
  }
  return well;
}

// A diagonal matrix, whose eigenvalues are known, with each eigen backend.
bool try_eigen_backends() {
  bool well = true;
  for (const EigenBackendEntry& entry : eigen_backends().entries()) {
    if (!entry.available) {
      fmt::print("{}: not in this build; install {} and configure again\n", entry.name, entry.package);
      well = false;
      continue;
    }
    SparseMatrix K(50, 50);
    K.setIdentity();
    for (Index i = 0; i < 50; ++i) K.valuePtr()[i] = 1.0 + i;
    try {
      const auto backend = make_eigen_backend(entry.name);
      const EigenPairs pairs = backend->solve(K, SparseMatrix(), 3);
      fmt::print("{}: works (error {:.1e})\n", entry.name, (pairs.values - Eigen::Vector3d(1.0, 2.0, 3.0)).norm());
    } catch (const Error& error) {
      fmt::print("{}: FAILS: {}\n", entry.name, error.what());
      well = false;
    }
  }
  return well;
}

// Half a turn around the origin.
class Turn final : public OdeField {
 public:
  Index size() const override { return 2; }
  int point_size() const override { return 2; }
  void velocity(double, const Vector& y, Vector& dy) override { dy << -kPi * y[1], kPi * y[0]; }

 private:
  static constexpr double kPi = 3.14159265358979323846;
};

// The turn with each ODE backend.
bool try_ode_backends() {
  bool well = true;
  for (const OdeBackendEntry& entry : ode_backends().entries()) {
    if (!entry.available) {
      fmt::print("{}: not in this build; install {} and configure again\n", entry.name, entry.package);
      well = false;
      continue;
    }
    try {
      Turn turn;
      const auto backend = make_ode_backend(entry.name);
      const Vector y = backend->integrate(turn, Eigen::Vector2d(1.0, 0.0), 0.0, 1.0, {});
      const OdeReport& report = backend->report();
      const double error = (y - Eigen::Vector2d(-1.0, 0.0)).norm();
      const bool works = report.completed && error < 0.2;  // of Euler's method: 0.1
      fmt::print("{}: {} (error {:.1e}, {} steps, {} evaluations)\n", entry.name, works ? "works" : "FAILS", error,
                 report.steps, report.evaluations);
      well = well && works;
    } catch (const Error& error) {
      fmt::print("{}: FAILS: {}\n", entry.name, error.what());
      well = false;
    }
  }
  return well;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> provenance() {
  const BlasInfo blas = probe_blas();
  return {{"variform", VARIFORM_VERSION},
          {"licence of this binary", effective_licence()},
          {"BLAS", fmt::format("{}, {:.1f} Gflop/s", blas_text(blas), blas.gflops)}};
}

ExitCode list(const std::string& what) {
  const auto wanted = [&](const std::string& kind) { return what.empty() || what == kind; };
  if (wanted("energies")) {
    fmt::print("energies ([energy] type)\n");
    for (const EnergyEntry& e : energies().entries()) {
      fmt::print("  {:<37}{} [{}]\n", e.name, e.doc, e.domains);
      list_parameters(e.parameters);
    }
  }
  if (wanted("backends")) {
    fmt::print("linear backends ([solver] linear)\n");
    for (const LinearBackendEntry& e : linear_backends().entries()) {
      fmt::print("  {:<23} {}{}\n", e.name, e.doc,
                 e.available ? "" : fmt::format(" (not in this build: needs {})", e.package));
      list_parameters(e.parameters);
    }
    fmt::print("nonlinear backends ([solver] nonlinear)\n");
    for (const NonlinearBackendEntry& e : nonlinear_backends().entries()) {
      fmt::print("  {:<23} {}{}\n", e.name, e.doc,
                 e.available ? "" : fmt::format(" (not in this build: needs {})", e.package));
      list_parameters(e.parameters);
    }
    fmt::print("eigen backends (no config uses them yet)\n");
    for (const EigenBackendEntry& e : eigen_backends().entries()) {
      fmt::print("  {:<23} {}{}\n", e.name, e.doc,
                 e.available ? "" : fmt::format(" (not in this build: needs {})", e.package));
      list_parameters(e.parameters);
    }
    fmt::print("ODE backends\n");
    for (const OdeBackendEntry& e : ode_backends().entries()) {
      fmt::print("  {:<23} {}{}\n", e.name, e.doc,
                 e.available ? "" : fmt::format(" (not in this build: needs {})", e.package));
      list_parameters(e.parameters);
    }
  }
  if (wanted("generators")) {
    fmt::print("generators ([domain] generator)\n");
    for (const GeneratorEntry& e : generators().entries()) {
      fmt::print("  {:<23} {}\n", e.name, e.doc);
      list_parameters(e.parameters);
    }
    fmt::print("changes of the mesh\n");
    for (const DomainModifier& e : domain_modifiers()) {
      fmt::print("  {:<23} {}\n", fmt::format("[domain.{}]", e.name), e.doc);
      list_parameters(e.parameters);
    }
  }
  if (wanted("norms")) {
    fmt::print("facet weights ([norm] facet_weight)\n");
    for (const std::string& name : facet_weight_names()) fmt::print("  {}\n", name);
  }
  if (wanted("pipelines") || wanted("metrics")) {
    fmt::print("pipelines\n");
    for (const PipelineEntry& e : pipelines().entries()) {
      fmt::print("  {:<23} {}\n    sections: {}\n", e.name, e.doc, fmt::join(e.sections, ", "));
      for (const Section& section : e.parameters) {
        fmt::print("    [{}]\n", section.name);
        list_parameters(section.parameters);
      }
      if (!wanted("metrics")) continue;
      fmt::print("    metrics:\n");
      for (const Metric& metric : e.metrics) fmt::print("      {:<21} {}\n", metric.column.key, metric.doc);
    }
  }
  if (wanted("config")) {
    fmt::print("sections of every config\n");
    for (const ConfigSection& section : config_sections()) {
      fmt::print("  {:<23} {}\n", section.header, section.doc);
      for (const ConfigKey& key : section.keys) fmt::print("      {:<21} {}\n", key.name, key.doc);
    }
  }
  return ExitCode::done;
}

ExitCode info(const std::string& file, bool triangulate) {
  const MeshFile read = read_mesh(file, {.triangulate_polygons = triangulate});
  for (const std::string& warning : read.warnings) fmt::print(stderr, "warning: {}\n", warning);
  fmt::print("{}: {} vertices, {} {}\n", file, read.mesh.vertex_count(), read.mesh.cell_count(),
             read.mesh.cells.cols() == 4 ? "tetrahedra" : "triangles");
  const Mesh mesh = flattened(read.mesh);
  const std::vector<Defect> defects = check_mesh(mesh);
  for (const Defect& defect : defects) fmt::print("defect: {}\n", defect.message);
  const MeshRepair repaired = repair_mesh(mesh);
  if (!defects.empty()) {
    for (const std::string& warning : repaired.warnings) fmt::print("repair: {}\n", warning);
    if (const std::vector<Defect> left = check_mesh(repaired.mesh); !left.empty()) {
      throw DataError(fmt::format("{}: not usable as it is: {}", file, left.front().message));
    }
  }
  const Domain domain(repaired.mesh);
  const MeshQuality quality = mesh_quality(domain);
  const Index edges = domain.intrinsic_dimension() == 2
                          ? domain.facet_count() + static_cast<Index>(domain.boundary_facets().rows())
                          : 0;
  fmt::print("domain: {}, {} component{}, {} interior facets, {} boundary facets\n", to_string(domain.kind()),
             domain.component_count(), domain.component_count() == 1 ? "" : "s", domain.facet_count(),
             domain.boundary_facets().rows());
  if (edges > 0) fmt::print("Euler characteristic: {}\n", domain.vertex_count() - edges + domain.cell_count());
  const Eigen::RowVectorXd low = domain.positions().colwise().minCoeff();
  const Eigen::RowVectorXd high = domain.positions().colwise().maxCoeff();
  fmt::print("bounding box: ({}) to ({})\n", fmt::join(low.data(), low.data() + low.size(), ", "),
             fmt::join(high.data(), high.data() + high.size(), ", "));
  fmt::print("measure: {:.6g}; cells {:.3g} to {:.3g} (ratio {:.3g})\n", domain.total_measure(), quality.min_measure,
             quality.max_measure, quality.measure_ratio);
  fmt::print("edges: {:.3g} to {:.3g}, mean {:.3g}\n", quality.min_edge, quality.max_edge, quality.mean_edge);
  fmt::print("angles: {:.1f} to {:.1f} degrees; circumradius / inradius up to {:.3g}; mean ratio from {:.3g}\n",
             quality.min_angle, quality.max_angle, quality.max_radius_ratio, quality.min_mean_ratio);
  return ExitCode::done;
}

ExitCode doctor() {
  const BlasInfo blas = probe_blas();
  fmt::print("variform {}\nlicence of this binary: {}\n", VARIFORM_VERSION, effective_licence());
  fmt::print("BLAS: {}: {:.1f} Gflop/s in a 512 x 512 product\n", blas_text(blas), blas.gflops);
  bool well = true;
  if (const std::string advice = blas_core_advice(blas); !advice.empty()) {
    fmt::print("  advice: {}\n", advice);
    well = false;
  }
  if (blas.threads != 1)
    fmt::print("  note: numbers repeat to the last digit only without OPENBLAS_NUM_THREADS, or with 1\n");
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    if (!entry.available) {
      fmt::print("{}: not in this build; install {} and configure again\n", entry.name, entry.package);
      well = false;
      continue;
    }
    // A small definite (or general, or overdetermined) system with known solution.
    const Index n = 50;
    std::vector<Eigen::Triplet<double, Index>> triplets;
    for (Index i = 0; i < n; ++i) {
      triplets.emplace_back(i, i, 2.5);
      if (i + 1 < n) triplets.emplace_back(i + 1, i, -1.0);
      if (i + 1 < n && !entry.capabilities.spd) triplets.emplace_back(i, i + 1, -1.0);
    }
    SparseMatrix A(n, n);
    A.setFromTriplets(triplets.begin(), triplets.end());
    const MatrixKind kind = entry.capabilities.spd       ? MatrixKind::spd
                            : entry.capabilities.general ? MatrixKind::general
                                                         : MatrixKind::least_squares;
    try {
      const auto backend = make_linear_backend(entry.name);
      backend->factorize(A, kind);
      backend->solve(Eigen::MatrixXd::Ones(n, 2));
      fmt::print("{}: works (residual {:.1e})\n", entry.name, backend->report().residual);
    } catch (const Error& error) {
      fmt::print("{}: FAILS: {}\n", entry.name, error.what());
      well = false;
    }
  }
  well = try_nonlinear_backends() && well;
  well = try_eigen_backends() && well;
  well = try_ode_backends() && well;
  const bool plots = std::system("command -v gnuplot > /dev/null 2>&1") ==
                     0;  // NOLINT(bugprone-command-processor,cert-env33-c): fixed text
  fmt::print("gnuplot: {}\n", plots ? "found" : "not found: line plots are left out (package gnuplot-nox)");
  const fs::path viewer = viewer_library();
  fmt::print("three.js: {}\n",
             viewer.empty() ? "not found: reports have no interactive view (package libjs-three)" : viewer.string());
  if (const char* data = std::getenv("VARIFORM_DATA")) fmt::print("VARIFORM_DATA: {}\n", data);
  fmt::print("{}\n", well && plots ? "all well" : "see above");
  return ExitCode::done;
}

ExitCode version() {
  fmt::print("variform {}\nlicence of this binary: {}\nBLAS: {}\n", VARIFORM_VERSION, effective_licence(),
             blas_text(probe_blas()));
  return ExitCode::done;
}

}  // namespace variform
