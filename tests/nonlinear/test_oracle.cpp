// SPDX-License-Identifier: BSD-3-Clause
// Minima of our backends against those of Ceres for the same energies, written once more: from positions and triangles
// alone, with derivatives by automatic differentiation.
#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/nonlinear/arap_problems.h"

namespace variform {
namespace {

using testing::ArapProblem;

/// One triangle: the map from its rest shape, F = [b - a, c - a] [b0 - a0, c0 - a0]^-1.
struct Triangle {
  Triangle(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
    Eigen::Matrix2d edges;
    edges << b - a, c - a;
    root_area = std::sqrt(0.5 * edges.determinant());
    to_unit = edges.inverse();
  }

  template <class T>
  Eigen::Matrix<T, 2, 2> map(const T* a, const T* b, const T* c) const {
    Eigen::Matrix<T, 2, 2> edges;
    edges << b[0] - a[0], c[0] - a[0], b[1] - a[1], c[1] - a[1];
    return edges * to_unit.cast<T>();
  }

  double root_area = 0.0;
  Eigen::Matrix2d to_unit;
};

/// A |F - R|^2 with the rotation R that is closest to F.
struct Rigidity {
  static constexpr int kRows = 4;

  template <class T>
  bool operator()(const T* a, const T* b, const T* c, T* residual) const {
    using std::atan2;
    using std::cos;
    using std::sin;
    const Eigen::Matrix<T, 2, 2> F = triangle.map(a, b, c);
    const T angle = atan2(F(1, 0) - F(0, 1), F(0, 0) + F(1, 1));
    residual[0] = triangle.root_area * (F(0, 0) - cos(angle));
    residual[1] = triangle.root_area * (F(1, 0) - sin(angle));
    residual[2] = triangle.root_area * (F(0, 1) + sin(angle));
    residual[3] = triangle.root_area * (F(1, 1) - cos(angle));
    return true;
  }

  double constant() const { return 0.0; }

  Triangle triangle;
};

/// A (|F|^2 + |F^-1|^2 - 4), but for the 4; none for inverted triangles.
struct Isometry {
  static constexpr int kRows = 8;

  template <class T>
  bool operator()(const T* a, const T* b, const T* c, T* residual) const {
    const Eigen::Matrix<T, 2, 2> F = triangle.map(a, b, c);
    const T det = F(0, 0) * F(1, 1) - F(0, 1) * F(1, 0);
    if (!(det > T(0.0))) return false;
    for (int i = 0; i < 4; ++i) {
      residual[i] = triangle.root_area * F.data()[i];
      residual[4 + i] = residual[i] / det;  // entries of the inverse, but for order and signs
    }
    return true;
  }

  double constant() const { return -4.0 * triangle.root_area * triangle.root_area; }

  Triangle triangle;
};

struct Minimum {
  Matrix positions;
  double energy = 0.0;
};

template <class Term>
Minimum minimum_by_ceres(const ArapProblem& of) {
  const Matrix& rest = of.domain->positions();
  std::vector<Eigen::Vector2d> positions;
  for (Index v = 0; v < rest.rows(); ++v) positions.emplace_back(of.start(v, 0), of.start(v, 1));
  ceres::Problem problem;
  double constant = 0.0;
  const IndexMatrix& cells = of.domain->cells();
  for (Index t = 0; t < cells.rows(); ++t) {
    const auto corner = [&](int i) { return Eigen::Vector2d(rest(cells(t, i), 0), rest(cells(t, i), 1)); };
    const auto place = [&](int i) { return positions[static_cast<std::size_t>(cells(t, i))].data(); };
    auto* const term = new Term{Triangle(corner(0), corner(1), corner(2))};
    constant += term->constant();
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Term, Term::kRows, 2, 2, 2>(term), nullptr, place(0),
                             place(1), place(2));
  }
  for (const auto& fixed : of.constraints.fixed()) {
    problem.SetParameterBlockConstant(positions[static_cast<std::size_t>(fixed.vertex)].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 2000;
  options.function_tolerance = 1e-18;
  options.gradient_tolerance = 1e-12;
  options.parameter_tolerance = 1e-13;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.FullReport();
  Minimum minimum{of.start, 2.0 * summary.final_cost + constant};
  for (Index v = 0; v < rest.rows(); ++v) minimum.positions.row(v) = positions[static_cast<std::size_t>(v)];
  return minimum;
}

/// A jittered bar, its left end held and its right one turned and moved by the given vector.
ArapProblem bar(const std::string& energy, double degrees, const Eigen::RowVector2d& move) {
  const Mesh mesh = rectangle_mesh({.width = 2.0, .height = 0.8, .h = 0.25, .jitter = 0.25});
  const double angle = degrees * std::acos(-1.0) / 180.0;
  const Eigen::Rotation2Dd turn(angle);
  const Eigen::Vector2d centre(2.0, 0.4);
  Constraints constraints(mesh.vertex_count(), 2);
  Matrix start = mesh.positions;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Eigen::Vector2d x(mesh.positions(v, 0), mesh.positions(v, 1));
    // Bent a bit more with every column: no triangle of the start is inverted.
    const double share = x[0] / 2.0;
    const Eigen::Vector2d bent = centre + Eigen::Rotation2Dd(share * angle) * (x - centre) + share * move.transpose();
    start.row(v) = bent.transpose();
    if (x[0] == 0.0) constraints.fix(v, mesh.positions.row(v));
    if (x[0] == 2.0) constraints.fix(v, (centre + turn * (x - centre)).transpose() + move);
  }
  return testing::arap_problem(energy, mesh, energy, start, constraints);
}

Minimum minimum_by(const std::string& backend, const ArapProblem& of) {
  Problem problem(*of.domain, *of.energy, {}, of.constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  const auto nonlinear = make_nonlinear_backend(backend);
  Minimum minimum;
  minimum.positions = nonlinear->minimize(objective, of.start,
                                          {.tolerance = 1e-12, .max_iterations = 20000, .gradient_tolerance = 1e-9});
  EXPECT_TRUE(nonlinear->report().converged) << nonlinear->report().reason;
  minimum.energy = objective.value(minimum.positions).objective();
  return minimum;
}

void expect_equal(const Minimum& ours, const Minimum& oracle) {
  EXPECT_NEAR(ours.energy, oracle.energy, 1e-9 * oracle.energy);
  EXPECT_LT((ours.positions - oracle.positions).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Oracle, ArapHasTheMinimumThatCeresFinds) {
  for (const auto& [degrees, move] :
       {std::pair(40.0, Eigen::RowVector2d(-0.1, 0.3)), std::pair(-70.0, Eigen::RowVector2d(0.2, -0.4))}) {
    const ArapProblem of = bar("arap", degrees, move);
    const Minimum oracle = minimum_by_ceres<Rigidity>(of);
    ASSERT_GT(oracle.energy, 1e-3);
    for (const std::string backend : {"newton", "gauss_newton", "local_global"}) {
      SCOPED_TRACE(backend);
      expect_equal(minimum_by(backend, of), oracle);
    }
  }
}

TEST(Oracle, SymmetricDirichletHasTheMinimumThatCeresFinds) {
  for (const auto& [degrees, move] :
       {std::pair(40.0, Eigen::RowVector2d(-0.2, 0.3)), std::pair(-60.0, Eigen::RowVector2d(0.6, -0.4))}) {
    const ArapProblem of = bar("symmetric_dirichlet", degrees, move);
    const Minimum oracle = minimum_by_ceres<Isometry>(of);
    ASSERT_GT(oracle.energy, 1e-3);
    for (const std::string backend : {"newton", "gauss_newton"}) {
      SCOPED_TRACE(backend);
      expect_equal(minimum_by(backend, of), oracle);
    }
  }
}

}  // namespace
}  // namespace variform
