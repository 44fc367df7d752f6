// SPDX-License-Identifier: BSD-3-Clause
// Whole methods on 100 000 vertices, from a mesh in memory, against the same written with plain Eigen.
#include <Eigen/Geometry>
#include <tbb/global_control.h>

#include <cmath>
#include <optional>

#include "energies/energies.h"
#include "experiments/benchmarks/plain_eigen.h"
#include "experiments/benchmarks/scene.h"
#include "framework/domain/generators.h"
#include "framework/form/problem_objective.h"
#include "framework/operators/operators.h"
#include "framework/operators/rotation.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform::benchmarks {
namespace {

constexpr int kIterations = 20;  // of a nonlinear method, after the set-up

// What is solved: an energy on a mesh with fixed vertices.
struct Task {
  std::string energy;
  Mesh mesh;
  Constraints constraints;
  Matrix start;  // of nonlinear methods
  double beta;
};

Mesh sheet() { return bump_mesh({.base = {.h = 1.0 / 316.0, .jitter = 0.2}}); }

Task lscm_grid(double beta) {
  Task task{"lscm", sheet(), {0, 2}, {}, beta};
  const Index last = task.mesh.vertex_count() - 1;
  task.constraints = Constraints(task.mesh.vertex_count(), 2);
  task.constraints.fix(0, Eigen::RowVector2d(0.0, 0.0));
  task.constraints.fix(last,
                       Eigen::RowVector2d((task.mesh.positions.row(last) - task.mesh.positions.row(0)).norm(), 0.0));
  return task;
}

// A cap held, the pole on the other side moved.
Task arap_sphere(double beta) {
  Task task{"arap", sphere_mesh(1.0, 0.01107), {0, 3}, {}, beta};
  const Matrix& x = task.mesh.positions;
  task.start = x;
  task.constraints = Constraints(task.mesh.vertex_count(), 3);
  Index top = 0;
  x.col(2).maxCoeff(&top);
  for (Index v = 0; v < x.rows(); ++v) {
    if (x(v, 2) < -0.9) task.constraints.fix(v, x.row(v));
  }
  task.constraints.fix(top, x.row(top) + Eigen::RowVector3d(0.3, 0.0, 0.3));
  return task;
}

Task arap_parametrization(double beta) {
  Task task{"arap_parametrization", sheet(), {0, 2}, {}, beta};
  task.start = task.mesh.positions.leftCols(2);
  task.constraints = Constraints(task.mesh.vertex_count(), 2);
  task.constraints.fix(0, task.start.row(0));
  return task;
}

// All that has to be there before the first solution, kept alive.
struct Setup {
  Domain domain;
  std::unique_ptr<Energy> energy;
  Problem problem;
  std::unique_ptr<LinearBackend> backend;

  explicit Setup(const Task& task)
      : domain(task.mesh),
        energy(energies().find(task.energy).make(Parameters(energies().find(task.energy).parameters))),
        problem(domain, *energy, {.beta = task.beta}, task.constraints),
        backend(make_linear_backend("cholmod.supernodal")) {}
};

// The same in plain Eigen: K = Z'E'WEZ and what its right-hand sides need.
struct PlainSetup {
  SparseMatrix weighted;  // E'W
  plain::Elimination elimination;
  Eigen::MatrixXd held;  // Z'H times the fixed values
  plain::Factorization factorization;
  SparseMatrix E;

  PlainSetup(const Task& task, Samples& samples) {
    const bool conformal = task.energy == "lscm";
    SparseMatrix K;
    samples.time("eigen_assemble", [&] {
      plain::Gradients gradients = conformal ? plain::conformal_defect(task.mesh) : plain::gradients(task.mesh);
      E = std::move(gradients.matrix);
      weighted = E.transpose() * plain::norm(task.mesh, gradients.areas, task.beta, 3);
      const SparseMatrix H = weighted * E;
      elimination = plain::elimination(task.constraints, conformal ? 2 : 1);
      const SparseMatrix ZH = elimination.Z.transpose() * H;
      held = ZH * elimination.fixed;
      K = ZH * elimination.Z;
    });
    samples.time("eigen_analyze", [&] { factorization.analyzePattern(K); });
    samples.time("eigen_factorize", [&] { factorization.factorize(K); });
  }

  // For targets c, 3|T| x columns.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& c) const {
    const Eigen::MatrixXd b = elimination.Z.transpose() * (weighted * c);
    return elimination.Z * factorization.solve(b - held) + elimination.fixed;
  }
};

// One local and one global step on positions U, as many columns as the image space has dimensions.
Eigen::MatrixXd plain_iteration(const Task& task, const PlainSetup& setup, const Eigen::MatrixXd& U) {
  Eigen::MatrixXd F = setup.E * U;  // 3|T| x d, becomes the targets
  for (Index t = 0; t < task.mesh.cell_count(); ++t) {
    const auto x = [&](int i) -> Eigen::Vector3d { return task.mesh.positions.row(task.mesh.cells(t, i)).transpose(); };
    const Eigen::Vector3d edge = (x(1) - x(0)).normalized();
    const Eigen::Vector3d n = edge.cross(x(2) - x(0)).normalized();
    Eigen::Matrix<double, 2, 3> B;
    B.row(0) = edge.transpose();
    B.row(1) = n.cross(edge).transpose();
    if (U.cols() == 3) {
      Matrix23 R;
      closest_orthonormal_rows(B * F.middleRows<3>(3 * t), R);
      F.middleRows<3>(3 * t) = B.transpose() * R;
    } else {
      Eigen::Matrix2d R;
      closest_rotation(Eigen::Matrix2d(B * F.middleRows<3>(3 * t)), R);
      F.middleRows<3>(3 * t) = B.transpose() * R;
    }
  }
  return setup.solve(F);
}

double relative_difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) { return (a - b).norm() / b.norm(); }

void report_phases(const Setup& setup, Samples& samples) {
  const ProblemTimes& times = setup.problem.times();
  samples.add("declare", times.declare);
  samples.add("pattern", times.pattern);
  samples.add("refill", times.refill);
  samples.add("analyze", times.analyze);
  samples.add("factorize", times.factorize);
  samples.add("solve", times.solve);
}

void report_factor(const Setup& setup, benchmark::State& state) {
  const LinearReport& report = setup.backend->report();
  state.SetLabel(report.backend + ", " + report.ordering);
  state.counters["K_entries"] = static_cast<double>(report.nnz_matrix);
  state.counters["L_entries"] = static_cast<double>(report.nnz_factor);
  state.counters["flops"] = report.flops;
}

// Time of the benchmark: all of it, from the mesh to the solution.
void linear(benchmark::State& state, const std::function<Task(double)>& make, double beta) {
  const Task task = make(beta);
  Samples samples;
  for (auto _ : state) {
    Matrix U;
    std::optional<Setup> setup;
    state.SetIterationTime(samples.time("total", [&] {
      setup.emplace(task);
      U = setup->problem.solve(*setup->backend);
    }));
    samples.time("domain", [&] { Domain(task.mesh); });
    report_phases(*setup, samples);
    report_factor(*setup, state);
    setup.reset();
    {
      const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
      samples.cpu_time("total_cpu", [&] {
        setup.emplace(task);
        benchmark::DoNotOptimize(setup->problem.solve(*setup->backend));
      });
    }
    Eigen::MatrixXd plain;
    samples.time("eigen_total", [&] {
      samples.cpu_time("eigen_cpu", [&] {
        const PlainSetup eigen(task, samples);
        samples.time("eigen_solve", [&] { plain = eigen.solve(Eigen::MatrixXd::Zero(eigen.E.rows(), 1)); });
      });
    });
    const double difference = relative_difference(plain.reshaped<Eigen::RowMajor>(U.rows(), U.cols()), U);
    state.counters["difference"] = difference;
    if (!(difference < 1e-6)) state.SkipWithError("the solutions differ");
  }
  samples.report(state);
  state.counters["eigen/ours"] = samples.ratio("eigen_total", "total");
  state.counters["eigen/ours_cpu"] = samples.ratio("eigen_cpu", "total_cpu");
}

// Time of the benchmark: one iteration. Set-up is everything before the first one.
void nonlinear(benchmark::State& state, const std::function<Task(double)>& make, double beta) {
  const Task task = make(beta);
  Samples samples;
  for (auto _ : state) {
    const NonlinearOptions options{.tolerance = 0.0, .max_iterations = kIterations};
    std::optional<Setup> setup;
    Matrix U;
    const double first = samples.time("setup_and_solve", [&] {
      setup.emplace(task);
      setup->problem.solve(*setup->backend);
    });
    samples.add("setup", first - setup->problem.times().solve);
    samples.time("domain", [&] { Domain(task.mesh); });
    report_phases(*setup, samples);
    report_factor(*setup, state);
    const auto iterate = [&] {
      ProblemObjective objective(setup->problem, *setup->backend);
      return make_nonlinear_backend("local_global")->minimize(objective, task.start, options);
    };
    const double all = samples.time("iterations", [&] { U = iterate(); });
    samples.add("iteration", all / kIterations);
    state.SetIterationTime(all / kIterations);
    samples.time("iteration_value", [&] { benchmark::DoNotOptimize(setup->problem.value(U)); });
    setup.reset();
    {
      const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
      const double cpu = samples.cpu_time("setup_and_solve_cpu", [&] {
        setup.emplace(task);
        setup->problem.solve(*setup->backend);
      });
      samples.add("setup_cpu", cpu - setup->problem.times().solve);
      samples.add("iteration_cpu", samples.cpu_time("iterations_cpu", iterate) / kIterations);
    }
    setup.reset();

    std::optional<PlainSetup> eigen;
    Eigen::MatrixXd plain = task.start;
    samples.time("eigen_setup", [&] { samples.cpu_time("eigen_setup_cpu", [&] { eigen.emplace(task, samples); }); });
    const double plain_all = samples.time("eigen_iterations", [&] {
      const double cpu = samples.cpu_time("eigen_iterations_cpu", [&] {
        for (int i = 0; i < kIterations; ++i) plain = plain_iteration(task, *eigen, plain);
      });
      samples.add("eigen_iteration_cpu", cpu / kIterations);
    });
    samples.add("eigen_iteration", plain_all / kIterations);
    const double difference = relative_difference(plain, U);
    state.counters["difference"] = difference;
    if (!(difference < 1e-6)) state.SkipWithError("the solutions differ");
  }
  samples.report(state);
  for (const char* what : {"setup", "iteration"}) {
    const std::string name = what;
    state.counters["eigen/ours_" + name] = samples.ratio("eigen_" + name, name);
    state.counters["eigen/ours_" + name + "_cpu"] = samples.ratio("eigen_" + name + "_cpu", name + "_cpu");
  }
}

// |L u|^2 in the inverse lumped mass, on the sheet with its boundary held at 0 and four inner vertices at 1.
void biharmonic(benchmark::State& state) {
  const Mesh mesh = sheet();
  Constraints constraints(mesh.vertex_count(), 1);
  {
    const Domain domain(mesh);
    Index inner = 0;
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (domain.boundary_vertices()[v]) {
        constraints.fix(v, Eigen::RowVectorXd::Zero(1));
      } else if (++inner % 20000 == 0) {
        constraints.fix(v, Eigen::RowVectorXd::Ones(1));
      }
    }
  }
  Samples samples;
  for (auto _ : state) {
    Eigen::MatrixXd U;
    Matrix u;
    std::unique_ptr<LinearBackend> backend;
    const auto ours = [&] {
      std::optional<Domain> domain;
      samples.time("domain", [&] { domain.emplace(mesh); });
      std::vector<Term> terms;
      samples.time("declare", [&] {
        const SparseMatrix L = cotangent_laplacian(*domain);
        Vector mass = Vector::Zero(domain->vertex_count());
        for (Index t = 0; t < domain->cell_count(); ++t) {
          for (int i = 0; i < 3; ++i) mass[domain->cells()(t, i)] += domain->cell_measures()[t] / 3.0;
        }
        terms.push_back(
            {Form::from_sparse(L, Eigen::MatrixXd::Zero(L.rows(), 1), 1), diagonal_norm(mass.cwiseInverse())});
      });
      std::optional<Assembly> assembly;
      std::optional<Reduction> reduction;
      samples.time("pattern", [&] {
        assembly.emplace(terms);
        reduction.emplace(assembly->matrix(), constraints, 1);
      });
      samples.time("refill", [&] {
        assembly->refill(terms);
        reduction->refill(assembly->matrix(), constraints);
        assembly->refill_targets(terms);
      });
      backend = make_linear_backend("cholmod.supernodal");
      backend->factorize(reduction->matrix(), MatrixKind::spd);
      samples.add("analyze", backend->report().analyze_seconds);
      samples.add("factorize", backend->report().factorize_seconds);
      samples.time("solve", [&] {
        const Eigen::MatrixXd b =
            reduction->right_hand_side(assembly->matrix(), assembly->right_hand_side(), constraints);
        u = reduction->expand(backend->solve(b), constraints, 1);
      });
    };
    state.SetIterationTime(samples.time("total", ours));
    {
      const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
      samples.cpu_time("total_cpu", ours);
    }
    const LinearReport& report = backend->report();
    state.SetLabel(report.backend + ", " + report.ordering);
    state.counters["L_entries"] = static_cast<double>(report.nnz_factor);
    state.counters["flops"] = report.flops;
    backend.reset();

    Eigen::MatrixXd plain;
    const auto eigen = [&] {
      const plain::Gradients gradients = plain::gradients(mesh);
      const SparseMatrix L =
          gradients.matrix.transpose() * plain::norm(mesh, gradients.areas, 0.0, 3) * gradients.matrix;
      Vector mass = Vector::Zero(mesh.vertex_count());
      for (Index t = 0; t < mesh.cell_count(); ++t) {
        for (int i = 0; i < 3; ++i) mass[mesh.cells(t, i)] += gradients.areas[t] / 3.0;
      }
      const SparseMatrix H = L * mass.cwiseInverse().asDiagonal() * L;
      const plain::Elimination elimination = plain::elimination(constraints, 1);
      const SparseMatrix ZH = elimination.Z.transpose() * H;
      const SparseMatrix K = ZH * elimination.Z;
      const plain::Factorization factorization(K);
      plain = elimination.Z * factorization.solve(-(ZH * elimination.fixed)) + elimination.fixed;
    };
    samples.time("eigen_total", [&] { samples.cpu_time("eigen_cpu", eigen); });
    const double difference = relative_difference(plain, u);
    state.counters["difference"] = difference;
    if (!(difference < 1e-6)) state.SkipWithError("the solutions differ");
  }
  samples.report(state);
  state.counters["eigen/ours"] = samples.ratio("eigen_total", "total");
  state.counters["eigen/ours_cpu"] = samples.ratio("eigen_cpu", "total_cpu");
}

void few(benchmark::internal::Benchmark* benchmark) {
  benchmark->Iterations(3)->UseManualTime()->Unit(benchmark::kMillisecond);
}

// Plain Eigen takes long.
void once(benchmark::internal::Benchmark* benchmark) {
  benchmark->Iterations(1)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(linear, lscm_grid_unregularized, lscm_grid, 0.0)->Apply(few);
BENCHMARK_CAPTURE(linear, lscm_grid, lscm_grid, 0.3)->Apply(once);
BENCHMARK_CAPTURE(nonlinear, arap_sphere_unregularized, arap_sphere, 0.0)->Apply(few);
BENCHMARK_CAPTURE(nonlinear, arap_sphere, arap_sphere, 0.2)->Apply(once);
BENCHMARK_CAPTURE(nonlinear, arap_parametrization_unregularized, arap_parametrization, 0.0)->Apply(few);
BENCHMARK_CAPTURE(nonlinear, arap_parametrization, arap_parametrization, 0.3)->Apply(once);
BENCHMARK(biharmonic)->Apply(few);

}  // namespace
}  // namespace variform::benchmarks
