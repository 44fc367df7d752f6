// SPDX-License-Identifier: BSD-3-Clause
// The Poisson form by multigrid, simpler preconditioners and Cholesky, over the number of unknowns. Every row runs in a
// process of its own, so that its memory is its own.
#include <fmt/format.h>
#include <malloc.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>

#include "energies/gradient/poisson.h"
#include "experiments/benchmarks/scene.h"
#include "framework/domain/generators.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

struct Measured {
  double unknowns;
  double setup;  // seconds: analysis and factorization
  double analyze;
  double solve;
  double iterations;
  double nnz_factor;
  double bytes;  // of the process at its peak, less what it had with the matrix and right-hand side there
  double residual;
};

/// The matrix of the Poisson form with the boundary fixed, on a jittered square or cube.
SparseMatrix poisson_matrix(int dimension, Index unknowns) {
  const double h = std::pow(static_cast<double>(unknowns), -1.0 / dimension);
  const Domain domain(dimension == 2 ? rectangle_mesh({.width = 1.0, .height = 1.0, .h = h, .jitter = 0.2, .seed = 1})
                                     : bar_tet_mesh(1.0, 1.0, 1.0, h, 0.2));
  const auto energy = make_poisson(Eigen::MatrixXd(Vector::Unit(dimension, 0)));
  const int d = 1;
  Constraints constraints(domain.vertex_count(), d);
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const auto x = domain.positions().row(v).array();
    if ((x < 1e-9 || x > 1.0 - 1e-9).any()) constraints.fix(v, Eigen::RowVectorXd::Zero(d));
  }
  Problem problem(domain, *energy, {.beta = 0.0}, constraints);
  return problem.reduced_matrix();
}

double resident() {
  std::array<long, 2> pages{};
  if (FILE* file = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(file, "%ld %ld", &pages[0], &pages[1]) != 2) pages[1] = 0;
    std::fclose(file);
  }
  return static_cast<double>(pages[1]) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

// The peak so far is forgotten where the kernel allows it.
void forget_peak() {
  if (FILE* file = std::fopen("/proc/self/clear_refs", "w")) {
    std::fputs("5", file);
    std::fclose(file);
  }
}

Measured measure(const SparseMatrix& K, const std::string& name, const Parameters& parameters) {
  // What a library allocates once is not the method's.
  const auto backend = make_linear_backend(name, parameters);
  const Vector b = Vector::Ones(K.rows());
  malloc_trim(0);
  forget_peak();
  const double before = resident();
  backend->factorize(K, MatrixKind::spd);
  benchmark::DoNotOptimize(backend->solve(b));
  const LinearReport& report = backend->report();
  std::ifstream status("/proc/self/status");
  double peak = 0.0;
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) == 0) peak = 1024.0 * std::atof(line.c_str() + 6);
  }
  return {static_cast<double>(K.rows()),
          report.analyze_seconds + report.factorize_seconds,
          report.analyze_seconds,
          report.solve_seconds,
          static_cast<double>(report.iterations),
          static_cast<double>(report.nnz_factor),
          peak - before,
          report.residual};
}

// What function returns, computed in a process of its own; NaN where that fails.
template <class Function>
Measured in_child(const Function& function) {
  std::array<int, 2> ends{};
  Measured result{};
  result.unknowns = std::nan("");
  if (pipe(ends.data()) != 0) return result;
  const pid_t child = fork();
  if (child == 0) {
    try {
      const Measured measured = function();
      const bool written = write(ends[1], &measured, sizeof(measured)) == sizeof(measured);
      _exit(written ? 0 : 1);
    } catch (const std::exception& error) {
      fmt::print(stderr, "{}\n", error.what());
    }
    _exit(1);
  }
  close(ends[1]);
  if (read(ends[0], &result, sizeof(result)) != sizeof(result)) result.unknowns = std::nan("");
  close(ends[0]);
  waitpid(child, nullptr, 0);
  return result;
}

using Settings = std::vector<std::pair<std::string, std::string>>;

void poisson(benchmark::State& state, int dimension, const std::string& name, const Settings& settings) {
  const SparseMatrix K = poisson_matrix(dimension, static_cast<Index>(state.range(0)));
  Parameters parameters(linear_backends().find(name).parameters);
  for (const auto& [key, value] : settings) parameters.set(key, value);
  Samples samples;
  Measured last{};
  for (auto _ : state) {
    last = in_child([&] { return measure(K, name, parameters); });
    if (!(last.unknowns > 0.0)) {
      state.SkipWithError("failed");
      return;
    }
    samples.add("setup", last.setup);
    samples.add("solve", last.solve);
    state.SetIterationTime(last.setup + last.solve);
  }
  samples.report(state);
  state.counters["unknowns"] = last.unknowns;
  state.counters["iterations"] = last.iterations;
  state.counters["MB"] = last.bytes / 1e6;
  state.counters["residual"] = last.residual;
}

void plane(benchmark::internal::Benchmark* benchmark) {
  for (const int unknowns : {10000, 30000, 100000, 300000, 1000000}) benchmark->Arg(unknowns);
  benchmark->ArgName("unknowns")->Iterations(1)->UseManualTime()->Unit(benchmark::kMillisecond);
}

void space(benchmark::internal::Benchmark* benchmark) {
  for (const int unknowns : {10000, 30000, 100000, 250000}) benchmark->Arg(unknowns);
  benchmark->ArgName("unknowns")->Iterations(1)->UseManualTime()->Unit(benchmark::kMillisecond);
}

// hypre's manual: a larger threshold of strong connections in space.
const Settings kBoomerAmgPlane = {{"preconditioner", "amg"}};
const Settings kBoomerAmgSpace = {{"preconditioner", "amg"},
                                  {"multigrid_options", "-pc_hypre_boomeramg_strong_threshold 0.5"}};
const Settings kGamg = {{"preconditioner", "amg"}, {"multigrid", "gamg"}};
const Settings kIncomplete = {{"preconditioner", "incomplete_cholesky"}};

BENCHMARK_CAPTURE(poisson, plane_cg_boomeramg, 2, "eigen.cg", kBoomerAmgPlane)->Apply(plane);
BENCHMARK_CAPTURE(poisson, plane_cg_gamg, 2, "eigen.cg", kGamg)->Apply(plane);
BENCHMARK_CAPTURE(poisson, plane_petsc, 2, "petsc", Settings{})->Apply(plane);
BENCHMARK_CAPTURE(poisson, plane_cg_incomplete_cholesky, 2, "eigen.cg", kIncomplete)->Apply(plane);
BENCHMARK_CAPTURE(poisson, plane_cg_diagonal, 2, "eigen.cg", Settings{})->Apply(plane);
BENCHMARK_CAPTURE(poisson, plane_cholmod_supernodal, 2, "cholmod.supernodal", Settings{})->Apply(plane);
BENCHMARK_CAPTURE(poisson, space_cg_boomeramg, 3, "eigen.cg", kBoomerAmgSpace)->Apply(space);
BENCHMARK_CAPTURE(poisson, space_cg_gamg, 3, "eigen.cg", kGamg)->Apply(space);
BENCHMARK_CAPTURE(poisson, space_petsc, 3, "petsc", Settings{})->Apply(space);
BENCHMARK_CAPTURE(poisson, space_cg_incomplete_cholesky, 3, "eigen.cg", kIncomplete)->Apply(space);
BENCHMARK_CAPTURE(poisson, space_cg_diagonal, 3, "eigen.cg", Settings{})->Apply(space);
BENCHMARK_CAPTURE(poisson, space_cholmod_supernodal, 3, "cholmod.supernodal", Settings{})->Apply(space);

}  // namespace
}  // namespace variform::benchmarks
