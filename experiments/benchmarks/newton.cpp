// SPDX-License-Identifier: BSD-3-Clause
// Parts of a Newton direction of the symmetric Dirichlet energy, against what it replaces: numeric eigen-decompositions
// of every cell's Hessian and triplets.
#include <Eigen/Eigenvalues>
#include <tbb/global_control.h>

#include <cmath>
#include <vector>

#include "experiments/benchmarks/scene.h"
#include "framework/form/newton_model.h"
#include "framework/operators/isotropic.h"
#include "solvers/linear/linear_backends.h"

namespace variform::benchmarks {
namespace {

// Half the Hessian of free vertices as one would write it: every cell's Hessian by F projected numerically, triplets.
SparseMatrix numeric_matrix(const Domain& domain, const Matrix& U, const std::vector<Index>& free) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  triplets.reserve(static_cast<std::size_t>(domain.cell_count()) * 21);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::Matrix<double, 2, 3> G = domain.gradient(t);
    Eigen::Matrix<double, 3, 2> u;
    for (int i = 0; i < 3; ++i) u.row(i) = U.row(domain.cells()(t, i));
    const Eigen::Matrix2d F = G * u;
    Eigen::Matrix2d C;
    Eigen::Matrix4d D;
    inverse_transposed(F, C, &D);
    // f = |F|^2 + |C|^2: half the second derivative is I + D'D + (second derivative of C against C).
    Eigen::Matrix4d H = Eigen::Matrix4d::Identity() + D.transpose() * D;
    for (int a = 0; a < 4; ++a) {
      for (int b = 0; b < 4; ++b) {
        // d2C = C A' C B' C + C B' C A' C for unit matrices A = e_l e_k', B = e_j e_i'.
        Eigen::Matrix2d A = Eigen::Matrix2d::Zero();
        Eigen::Matrix2d B = Eigen::Matrix2d::Zero();
        A.data()[a] = 1.0;
        B.data()[b] = 1.0;
        const Eigen::Matrix2d second = C * A.transpose() * C * B.transpose() * C;
        H(a, b) += C.cwiseProduct(second).sum() + C.cwiseProduct(C * B.transpose() * C * A.transpose() * C).sum();
      }
    }
    Eigen::Matrix<double, 4, 6> couple = Eigen::Matrix<double, 4, 6>::Zero();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 2; ++j) couple.block<2, 1>(2 * j, 2 * i + j) = G.col(i);
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(H);
    const Eigen::Matrix4d projected =
        eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * eigen.eigenvectors().transpose();
    const Eigen::Matrix<double, 6, 6> P = domain.cell_measures()[t] * couple.transpose() * projected * couple;
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        const Index row = free[domain.cells()(t, i / 2)];
        const Index column = free[domain.cells()(t, j / 2)];
        if (row < 0 || column < 0) continue;
        const Index r = 2 * row + i % 2;
        const Index c = 2 * column + j % 2;
        if (r >= c) triplets.emplace_back(r, c, P(i, j));
      }
    }
  }
  Index count = 0;
  for (const Index v : free) count += v >= 0 ? 1 : 0;
  SparseMatrix K(2 * count, 2 * count);
  K.setFromTriplets(triplets.begin(), triplets.end());
  return K;
}

// Time of the benchmark: values of the reduced Hessian at a state, projection and assembly, on all threads.
void newton(benchmark::State& state, const std::string& energy) {
  Scene scene(energy, 0.0, static_cast<Index>(state.range(0)));
  // A bent and sheared state, twisted enough for some curvatures to be negative; the left and right sides are held.
  Matrix U = scene.domain.positions();
  Constraints constraints(scene.domain.vertex_count(), 2);
  std::vector<Index> free(scene.domain.vertex_count(), -1);
  Index count = 0;
  for (Index v = 0; v < scene.domain.vertex_count(); ++v) {
    const double x = U(v, 0);
    const double y = U(v, 1);
    U.row(v) << 0.8 * x + 0.1 * std::sin(3.0 * y), 0.9 * y + 0.2 * x * x - 0.1 * x * y;
    if (x == 0.0 || x == 1.0) {
      constraints.fix(v, U.row(v));
    } else {
      free[v] = count++;
    }
  }
  scene.constraints = constraints;
  Problem problem = scene.problem();
  problem.refresh_target(U);
  NewtonModel model(problem);
  const auto cholmod = make_linear_backend("cholmod.supernodal");
  const SparseMatrix difference = model.matrix(U) - numeric_matrix(scene.domain, U, free);
  cholmod->factorize(model.matrix(U), MatrixKind::spd);

  Samples samples;
  for (auto _ : state) {
    state.SetIterationTime(samples.time("refill", [&] { benchmark::DoNotOptimize(&model.matrix(U)); }));
    {
      const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
      samples.cpu_time("refill_cpu", [&] { benchmark::DoNotOptimize(&model.matrix(U)); });
      samples.cpu_time("gradient_cpu", [&] { benchmark::DoNotOptimize(model.gradient(U)); });
      samples.cpu_time("value_cpu", [&] {
        problem.refresh_target(Matrix(1.0000001 * U));
        benchmark::DoNotOptimize(problem.value(U));
        problem.refresh_target(U);
      });
      samples.cpu_time("longest_step_cpu", [&] { benchmark::DoNotOptimize(longest_step(problem, U, U)); });
      samples.cpu_time("numeric_cpu", [&] { benchmark::DoNotOptimize(numeric_matrix(scene.domain, U, free)); });
    }
    const double all = samples.time("direction", [&] { benchmark::DoNotOptimize(model.direction(U, 0.0, *cholmod)); });
    samples.add("factorize", cholmod->report().factorize_seconds);
    samples.add("solve", cholmod->report().solve_seconds);
    samples.add("rest", all - cholmod->report().factorize_seconds - cholmod->report().solve_seconds);
  }
  samples.report(state);
  state.counters["numeric/refill_cpu"] = samples.ratio("numeric_cpu", "refill_cpu");
  state.counters["factorize/direction_%"] = 100.0 * samples.ratio("factorize", "direction");
  state.counters["difference"] = difference.coeffs().abs().maxCoeff() / model.matrix(U).coeffs().abs().maxCoeff();
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("cells")->Arg(20000)->Arg(200000)->Iterations(5)->UseManualTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(newton, symmetric_dirichlet, "symmetric_dirichlet")->Apply(sizes);

}  // namespace
}  // namespace variform::benchmarks
