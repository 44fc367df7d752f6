// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "energies/energies.h"
#include "framework/domain/generators.h"
#include "framework/form/problem_objective.h"
#include "solvers/linear/linear_backends.h"
#include "tests/energies/curved_meshes.h"

namespace variform::testing {

/// A small problem with an energy whose targets are projections.
struct ArapProblem {
  std::string name;
  std::shared_ptr<Domain> domain;
  std::shared_ptr<Energy> energy;
  Constraints constraints;
  Matrix start;  // satisfies the hard constraints
};

inline ArapProblem arap_problem(const std::string& name, const Mesh& mesh, const std::string& energy,
                                const Matrix& start, const Constraints& constraints) {
  const EnergyEntry& entry = energies().find(energy);
  return {name, std::make_shared<Domain>(mesh), std::shared_ptr<Energy>(entry.make(Parameters(entry.parameters))),
          constraints, closest_feasible(constraints, start)};
}

inline Index nearest(const Matrix& positions, const Eigen::RowVectorXd& point) {
  Index best = 0;
  (positions.leftCols(point.size()).rowwise() - point).rowwise().squaredNorm().minCoeff(&best);
  return best;
}

/// ARAP in the plane, on a surface and a volume, a parametrization, and one with soft and identified vertices; from 60
/// to 300 variables.
inline std::vector<ArapProblem> arap_problems() {
  std::vector<ArapProblem> problems;
  {
    const Mesh mesh = rectangle_mesh({.width = 2.0, .height = 0.4, .h = 0.2, .jitter = 0.2});
    Constraints constraints(mesh.vertex_count(), 2);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      if (mesh.positions(v, 0) == 0.0) constraints.fix(v, mesh.positions.row(v));
    }
    const Index handle = nearest(mesh.positions, Eigen::RowVector2d(2.0, 0.4));
    constraints.fix(handle, mesh.positions.row(handle) + Eigen::RowVector2d(-0.2, 0.6));
    problems.push_back(arap_problem("planar", mesh, "arap", mesh.positions, constraints));
  }
  {
    const Mesh mesh = bump_mesh(0.2, 0.3);
    Constraints constraints(mesh.vertex_count(), 3);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      if (mesh.positions(v, 0) == 0.0) constraints.fix(v, mesh.positions.row(v));
      if (mesh.positions(v, 0) == 1.0) {
        constraints.fix(v, mesh.positions.row(v) + Eigen::RowVector3d(0.3, 0.1, 0.1));
      }
    }
    problems.push_back(arap_problem("surface", mesh, "arap", mesh.positions, constraints));
  }
  {
    const Mesh mesh = bar_tet_mesh(1.0, 0.5, 0.5, 0.25);
    Constraints constraints(mesh.vertex_count(), 3);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      const double x = mesh.positions(v, 0);
      if (x == mesh.positions.col(0).minCoeff()) constraints.fix(v, mesh.positions.row(v));
      if (x == mesh.positions.col(0).maxCoeff()) {
        constraints.fix(v, mesh.positions.row(v) + Eigen::RowVector3d(-0.1, 0.4, 0.2));
      }
    }
    problems.push_back(arap_problem("tetrahedral", mesh, "arap", mesh.positions, constraints));
  }
  {
    const Mesh mesh = bump_mesh(0.2, 0.6);
    Constraints constraints(mesh.vertex_count(), 2);
    const Index corner = nearest(mesh.positions, Eigen::RowVector2d(0.0, 0.0));
    const Index other = nearest(mesh.positions, Eigen::RowVector2d(1.0, 0.0));
    constraints.fix(corner, Eigen::RowVector2d(0.0, 0.0));
    constraints.fix(other, Eigen::RowVector2d(1.1, 0.0));
    problems.push_back(
        arap_problem("parametrization", mesh, "arap_parametrization", mesh.positions.leftCols(2), constraints));
  }
  {
    // A square with two corners of its top glued together, dragged softly at two vertices.
    const Mesh mesh = rectangle_mesh({.h = 0.2, .jitter = 0.2});
    Constraints constraints(mesh.vertex_count(), 2);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      if (mesh.positions(v, 1) == 0.0) constraints.fix(v, mesh.positions.row(v));
    }
    constraints.identify(nearest(mesh.positions, Eigen::RowVector2d(0.0, 1.0)),
                         nearest(mesh.positions, Eigen::RowVector2d(0.2, 1.0)));
    constraints.attract(nearest(mesh.positions, Eigen::RowVector2d(1.0, 1.0)), Eigen::RowVector2d(1.3, 0.8), 0.5);
    constraints.attract(nearest(mesh.positions, Eigen::RowVector2d(1.0, 0.6)), Eigen::RowVector2d(1.2, 0.6), 2.0);
    problems.push_back(arap_problem("soft and identified", mesh, "arap", mesh.positions, constraints));
  }
  return problems;
}

}  // namespace variform::testing
