// SPDX-License-Identifier: BSD-3-Clause
#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iostream>

#include "energies/energies.h"
#include "experiments/pipelines.h"
#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/domain/check.h"
#include "framework/domain/mesh_io.h"
#include "framework/domain/quality.h"
#include "framework/experiment/domain_source.h"
#include "framework/experiment/runner.h"
#include "framework/experiment/viewer.h"
#include "solvers/eigen/eigen_backends.h"
#include "solvers/linear/blas.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

std::atomic<bool> interrupted{false};

// The first signal stops at the next point; a second one stops at once.
void on_interrupt(int signal) {
  interrupted = true;
  std::signal(signal, SIG_DFL);
}

// GPL as soon as a backend that is GPL is linked in.
std::string effective_licence() {
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    if (entry.available && entry.licence.find("GPL-2.0") != std::string::npos &&
        entry.licence.find("LGPL") == std::string::npos) {
      return "GPL-2.0-or-later (GPL parts of SuiteSparse are linked in, by a backend or by PETSc; the sources of "
             "variform are BSD-3-Clause)";
    }
  }
  return "BSD-3-Clause (no SuiteSparse; Eigen is MPL-2.0)";
}

std::string blas_text(const BlasInfo& blas) {
  return fmt::format("{}, core {}, {} thread{}", blas.implementation, blas.core, blas.threads,
                     blas.threads == 1 ? "" : "s");
}

std::vector<std::pair<std::string, std::string>> provenance() {
  const BlasInfo blas = probe_blas();
  return {{"variform", VARIFORM_VERSION},
          {"licence of this binary", effective_licence()},
          {"BLAS", fmt::format("{}, {:.1f} Gflop/s", blas_text(blas), blas.gflops)}};
}

// Progress bar on a terminal, nothing otherwise.
class ProgressBar {
 public:
  explicit ProgressBar(bool quiet) : shown_(!quiet && isatty(STDERR_FILENO) != 0) {}

  bool operator()(int done, int total) const {
    if (shown_ && total > 0) {
      constexpr int kWidth = 40;
      const int filled = kWidth * done / total;
      const double left = done > 0 ? watch_.seconds() / done * (total - done) : 0.0;
      fmt::print(stderr, "\r[{}{}] {}/{}  {:.0f} s left ", std::string(filled, '#'), std::string(kWidth - filled, '.'),
                 done, total, left);
      if (done == total) fmt::print(stderr, "\r{}\r", std::string(kWidth + 40, ' '));
      std::fflush(stderr);
    }
    return !interrupted;
  }

 private:
  bool shown_;
  Stopwatch watch_;
};

struct RunArguments {
  std::string config;
  std::string out;
  std::vector<std::string> set;
  std::vector<std::string> grid;
  bool resume = false;
  bool no_figures = false;
  bool quiet = false;
};

void print_warnings(const Record& record) {
  for (const std::string& warning : record.warnings) fmt::print(stderr, "warning: {}\n", warning);
}

// The columns of the printed table: those that the config names, or a readable choice; swept keys first.
std::vector<std::string> shown_columns(const Record& record, const Config& config) {
  std::vector<std::string> columns = record.swept;
  if (const ConfigNode root = config.root(); root.has("output") && root.at("output").has("columns")) {
    const std::vector<std::string> chosen = root.at("output").at("columns").strings();
    columns.insert(columns.end(), chosen.begin(), chosen.end());
  } else {
    const bool searched = std::any_of(record.rows.begin(), record.rows.end(),
                                      [](const Row& row) { return row.find("beta_found") != nullptr; });
    if (searched) columns.insert(columns.end(), {"beta", "beta_found"});
    columns.insert(columns.end(), {"vertices", "cells", "energy", "energy_R", "energy_W", "flipped", "min_det",
                                   "local_energy_max", "iterations", "converged", "solver_residual"});
  }
  return columns;
}

Config configured(const RunArguments& arguments) {
  Config config = Config::load(arguments.config);
  for (const std::string& assignment : arguments.set) {
    const std::string key = config.set(assignment);
    // A value given by hand stands: neither it nor anything inside it is swept any more.
    if (key.rfind("sweep", 0) == 0 || !config.root().has("sweep")) continue;
    std::vector<std::string> swept;
    for (const ConfigNode& child : config.root().at("sweep").children()) swept.push_back(child.path().substr(6));
    for (const std::string& name : swept) {
      if (name == key || name.rfind(key + ".", 0) == 0) config.erase("sweep.\"" + name + "\"");
    }
    if (key.find('"') == std::string::npos) config.erase("sweep." + key);
  }
  for (const std::string& assignment : arguments.grid) {
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos) throw UsageError(fmt::format("--grid {}: expected key=[values]", assignment));
    config.set("sweep.\"" + assignment.substr(0, equals) + "\"" + assignment.substr(equals));
  }
  return config;
}

Record run_config(const Config& config, const RunArguments& arguments) {
  if (arguments.out.empty()) throw UsageError("--out: expected a folder");
  return run_experiment(config, pipelines(),
                        {.folder = arguments.out,
                         .figures = !arguments.no_figures,
                         .resume = arguments.resume,
                         .provenance = provenance(),
                         .progress = ProgressBar(arguments.quiet)});
}

ExitCode run(const RunArguments& arguments) {
  const Config config = configured(arguments);
  const Record record = run_config(config, arguments);
  print_warnings(record);
  if (!arguments.quiet) {
    fmt::print("{}\n", record_table(record, shown_columns(record, config)).markdown());
    if (!record.verdicts.empty()) fmt::print("{}\n", claims_table(record.verdicts).markdown());
    fmt::print("Report: {}\n", (fs::absolute(arguments.out) / "report.html").lexically_normal().string());
  }
  return ExitCode::done;
}

ExitCode sweep(const RunArguments& arguments) {
  if (const Config config = configured(arguments); !config.root().has("sweep")) {
    throw UsageError(
        fmt::format("{}: nothing to sweep: the config has no [sweep]; give --grid key=[values]", arguments.config));
  }
  return run(arguments);
}

fs::path shipped_experiments() {
  // Installed programs may have been moved together with their data.
  std::error_code unknown;
  const fs::path program = fs::read_symlink("/proc/self/exe", unknown);
  const fs::path beside = (program.parent_path() / VARIFORM_RELATIVE_EXPERIMENTS).lexically_normal();
  for (const fs::path& place : {beside, fs::path(VARIFORM_SOURCE_EXPERIMENTS)}) {
    if (fs::is_directory(place)) return place;
  }
  throw DataError("the shipped experiments are not there; name config files or folders");
}

std::vector<fs::path> find_configs(const std::vector<std::string>& places) {
  std::vector<fs::path> roots(places.begin(), places.end());
  if (roots.empty()) roots.push_back(shipped_experiments());
  std::vector<fs::path> configs;
  for (const fs::path& root : roots) {
    if (fs::is_directory(root)) {
      for (const auto& entry : fs::recursive_directory_iterator(root)) {
        if (entry.path().extension() == ".toml") configs.push_back(entry.path());
      }
    } else if (fs::exists(root)) {
      configs.push_back(root);
    } else {
      throw UsageError(fmt::format("{}: no such config or folder", root.string()));
    }
  }
  std::sort(configs.begin(), configs.end());
  if (configs.empty()) throw UsageError("no configs found");
  return configs;
}

// Configs whose inputs are not on this machine say so by `requires`.
std::string missing_input(const Config& config) {
  if (!config.root().has("requires")) return {};
  for (const std::string& file : config.root().at("requires").strings()) {
    try {
      find_input(file, config.folder());
    } catch (const DataError&) {
      return file;
    }
  }
  return {};
}

ExitCode reproduce(const std::vector<std::string>& places, const RunArguments& arguments) {
  std::vector<Verdict> all;
  int failed = 0;
  int broken = 0;
  ExitCode worst = ExitCode::done;
  Table overview{"Claims", {{"experiment"}, {"statement"}, {"published"}, {"ours"}, {"verdict"}}, {}};
  for (const fs::path& path : find_configs(places)) {
    if (interrupted) break;
    const std::string name = fs::absolute(path).parent_path().filename().string() + "/" + path.stem().string();
    const auto add = [&](const std::string& statement, const std::string& published, const std::string& ours,
                         const std::string& verdict) {
      Row row;
      row.set("experiment", name);
      row.set("statement", statement);
      row.set("published", published);
      row.set("ours", ours);
      row.set("verdict", verdict);
      overview.rows.push_back(row);
    };
    try {
      RunArguments at = arguments;
      at.config = path.string();
      at.out = (fs::path(arguments.out) / name).string();
      const Config config = configured(at);
      if (const std::string missing = missing_input(config); !missing.empty()) {
        if (!arguments.quiet) fmt::print(stderr, "{}: skipped, '{}' is not on this machine\n", name, missing);
        add("(not run)", "", fmt::format("input '{}' is not there", missing), "skipped");
        continue;
      }
      if (!arguments.quiet) fmt::print(stderr, "{} ...\n", name);
      const Record record = run_config(config, at);
      for (const Verdict& verdict : record.verdicts) {
        add(verdict.text, verdict.published, verdict.ours.empty() ? verdict.reason : verdict.ours,
            to_string(verdict.outcome));
        failed += verdict.outcome != Verdict::Outcome::holds;
      }
      all.insert(all.end(), record.verdicts.begin(), record.verdicts.end());
    } catch (const Error& error) {
      fmt::print(stderr, "error: {}: {}\n", name, error.what());
      add("(did not run)", "", error.what(), "error");
      ++broken;
      worst = static_cast<int>(error.exit_code()) > static_cast<int>(worst) ? error.exit_code() : worst;
    }
  }
  std::error_code error;
  fs::create_directories(arguments.out, error);
  if (error) throw DataError(fmt::format("{}: cannot be created: {}", arguments.out, error.message()));
  write_file(fs::path(arguments.out) / "claims.md", overview.markdown());
  write_file(fs::path(arguments.out) / "claims.csv", overview.csv());
  fmt::print("{}\n{} claims, {} of them not held; {} experiments with errors\n", overview.markdown(), all.size(),
             failed, broken);
  if (worst != ExitCode::done) return worst;
  return failed > 0 ? ExitCode::claim_failed : ExitCode::done;
}

void list_parameters(const std::vector<Parameter>& parameters) {
  for (const Parameter& p : parameters) {
    std::string accepted = type_name(p.value);
    if (!p.choices.empty()) accepted = fmt::format("{}", fmt::join(p.choices, " | "));
    fmt::print("      {} = {}    {} ({})\n", p.name, to_string(p.value), p.doc, accepted);
  }
}

void list(const std::string& what) {
  const auto wanted = [&](const std::string& kind) { return what.empty() || what == kind; };
  if (wanted("energies")) {
    fmt::print("energies ([energy] type)\n");
    for (const EnergyEntry& e : energies().entries()) {
      fmt::print("  {:<22}{} [{}]\n", e.name, e.doc, e.domains);
      list_parameters(e.parameters);
    }
  }
  if (wanted("backends")) {
    fmt::print("linear backends ([solver] linear)\n");
    for (const LinearBackendEntry& e : linear_backends().entries()) {
      fmt::print("  {:<22}{}{}\n", e.name, e.doc,
                 e.available ? "" : fmt::format(" (not in this build: needs {})", e.package));
      list_parameters(e.parameters);
    }
    fmt::print("nonlinear backends ([solver] nonlinear)\n");
    for (const NonlinearBackendEntry& e : nonlinear_backends().entries()) {
      fmt::print("  {:<22}{}\n", e.name, e.doc);
      list_parameters(e.parameters);
    }
    fmt::print("eigen backends (no config uses them yet)\n");
    for (const EigenBackendEntry& e : eigen_backends().entries()) {
      fmt::print("  {:<22}{}{}\n", e.name, e.doc,
                 e.available ? "" : fmt::format(" (not in this build: needs {})", e.package));
      list_parameters(e.parameters);
    }
  }
  if (wanted("generators")) {
    fmt::print("generators ([domain] generator)\n");
    for (const GeneratorEntry& e : generators().entries()) {
      fmt::print("  {:<22}{}\n", e.name, e.doc);
      list_parameters(e.parameters);
    }
    fmt::print("changes of the mesh\n");
    for (const DomainModifier& e : domain_modifiers()) {
      fmt::print("  {:<22}{}\n", fmt::format("[domain.{}]", e.name), e.doc);
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
      fmt::print("  {:<22}{}\n    sections: {}\n", e.name, e.doc, fmt::join(e.sections, ", "));
      for (const Section& section : e.parameters) {
        fmt::print("    [{}]\n", section.name);
        list_parameters(section.parameters);
      }
      if (!wanted("metrics")) continue;
      fmt::print("    metrics:\n");
      for (const Metric& metric : e.metrics) fmt::print("      {:<20}{}\n", metric.column.key, metric.doc);
    }
  }
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
  for (const EigenBackendEntry& entry : eigen_backends().entries()) {
    if (!entry.available) {
      fmt::print("{}: not in this build; install {} and configure again\n", entry.name, entry.package);
      well = false;
      continue;
    }
    // Diagonal: the eigenvalues are known.
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

int main_checked(int argc, char** argv) {
  CLI::App app(
      "Solver research framework for variational geometry processing.\n"
      "Exit codes: 0 done, 1 a claim failed under reproduce, 2 bad usage or config, 3 bad input data, 4 a solver "
      "failed.");
  app.require_subcommand(0, 1);
  bool version = false;
  app.add_flag("--version", version, "version, effective licence and BLAS");
  RunArguments arguments;
  const auto add_run_options = [&](CLI::App* command) {
    command->add_option("--set", arguments.set, "replace a value of the config: key=value, for example norm.beta=0.3")
        ->take_all();
    command->add_flag("--resume", arguments.resume, "take finished points of an earlier run in the same folder");
    command->add_flag("--no-figures", arguments.no_figures, "no pictures");
    command->add_flag("--quiet", arguments.quiet, "no progress and no table");
  };
  CLI::App* run_command = app.add_subcommand("run", "run a config");
  run_command->add_option("config", arguments.config, "TOML file")->required();
  run_command->add_option("--out", arguments.out, "folder for the results")->required();
  add_run_options(run_command);
  CLI::App* sweep_command = app.add_subcommand("sweep", "run a config over a grid of values");
  sweep_command->add_option("config", arguments.config, "TOML file")->required();
  sweep_command->add_option("--out", arguments.out, "folder for the results")->required();
  sweep_command
      ->add_option("--grid", arguments.grid, "key=[values], for example norm.beta=[0,0.2,0.4]; several make a grid")
      ->take_all();
  add_run_options(sweep_command);
  std::vector<std::string> places;
  CLI::App* reproduce_command = app.add_subcommand("reproduce", "run experiments and check their claims");
  reproduce_command->add_option("configs", places, "TOML files or folders (default: all shipped experiments)");
  reproduce_command->add_option("--out", arguments.out, "folder for the results")->default_val("runs/reproduce");
  add_run_options(reproduce_command);
  std::string what;
  CLI::App* list_command = app.add_subcommand("list", "what there is to choose from, with parameters and defaults");
  list_command->add_option("what", what, "only this kind")
      ->check(CLI::IsMember({"energies", "backends", "generators", "norms", "pipelines", "metrics"}));
  std::string mesh;
  bool triangulate = false;
  CLI::App* info_command = app.add_subcommand("info", "facts about a mesh file");
  info_command->add_option("mesh", mesh, "mesh file")->required();
  info_command->add_flag("--triangulate", triangulate, "split polygons into triangles");
  CLI::App* doctor_command = app.add_subcommand("doctor", "check this build and machine");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? static_cast<int>(ExitCode::done) : static_cast<int>(ExitCode::usage);
  }
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
  // Several BLAS threads would make the last digits depend on the load of the machine.
  if (std::getenv("OPENBLAS_NUM_THREADS") == nullptr) set_blas_threads(1);
  ExitCode code = ExitCode::done;
  if (version) {
    fmt::print("variform {}\nlicence of this binary: {}\nBLAS: {}\n", VARIFORM_VERSION, effective_licence(),
               blas_text(probe_blas()));
  } else if (run_command->parsed()) {
    code = run(arguments);
  } else if (sweep_command->parsed()) {
    code = sweep(arguments);
  } else if (reproduce_command->parsed()) {
    code = reproduce(places, arguments);
  } else if (list_command->parsed()) {
    list(what);
  } else if (info_command->parsed()) {
    code = info(mesh, triangulate);
  } else if (doctor_command->parsed()) {
    code = doctor();
  } else {
    fmt::print("{}", app.help());
    return static_cast<int>(ExitCode::usage);
  }
  return interrupted ? 128 + SIGINT : static_cast<int>(code);
}

}  // namespace
}  // namespace variform

int main(int argc, char** argv) {
  try {
    return variform::main_checked(argc, argv);
  } catch (const variform::Error& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return static_cast<int>(error.exit_code());
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "error: out of memory\n");
    return static_cast<int>(variform::ExitCode::solver);
  } catch (const std::exception& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return static_cast<int>(variform::ExitCode::data);
  }
}
