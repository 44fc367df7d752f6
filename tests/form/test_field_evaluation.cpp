// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "energies/energies.h"
#include "energies/vector_field/vector_field.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "solvers/linear/linear_backends.h"
#include "tests/allocation_count.h"
#include "tests/plain_ldlt.h"

namespace variform {
namespace {

using testing::PlainLdlt;

struct Case {
  std::string name;
  std::vector<std::pair<std::string, ParameterValue>> parameters;
  Domain domain;
  NormOptions norm;
};

std::vector<Case> cases() {
  const Domain plane(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  const Domain surface(sphere_mesh(1.0, 0.6));
  const std::pair<std::string, ParameterValue> gradient = {"smoothness", "gradient"};
  const std::pair<std::string, ParameterValue> stiff = {"stiffness", std::vector<double>{3.0, 1.0}};
  const std::pair<std::string, ParameterValue> axis = {"axis", std::vector<double>{1.0, 0.5}};
  return {{"akvf", {}, plane, {.beta = 0.3}},
          {"metr", {gradient}, plane, {.beta = 0.3, .facet_weight = FacetWeight::finite_volume}},
          {"conf", {}, plane, {.beta = 0.0}},
          {"phi", {gradient, stiff, axis}, plane, {.beta = 0.3}},
          {"metr", {}, solid, {.beta = 0.3, .facet_weight = FacetWeight::facet_measure_unit}},
          {"akvf", {}, plane, {.beta = 0.3, .regularizer = Regularizer::tikhonov}},
          {"near_isometric", {}, surface, {.beta = 1.0 / 3.0}},
          {"near_isometric", {}, surface, {.beta = 1.0}},
          {"edge_lengths", {}, surface, {.beta = 0.5}}};
}

TEST(FieldEvaluation, AllocationsAreSeenAtAll) {
  const long before = testing::allocation_count();
  const Matrix values = Matrix::Ones(3, static_cast<Eigen::Index>(testing::allocation_count() % 5 + 1));
  EXPECT_EQ(testing::allocation_count() - before, 1);
  EXPECT_EQ(values.maxCoeff(), 1.0);
  const Domain domain(rectangle_mesh({.h = 0.25}));
  const long made = testing::allocation_count();
  facet_weights(domain, FacetWeight::facet_measure);  // of the library, not of this file
  EXPECT_EQ(testing::allocation_count() - made, 1);
}

// What a deformation does at every evaluation of its field: the shape moves, handles have new velocities.
TEST(FieldEvaluation, AllocatesNothing) {
  for (Case& of : cases()) {
    for (const bool equality : {false, true}) {
      Domain domain = of.domain;
      const int p = domain.ambient_dimension();
      SCOPED_TRACE(of.name + " " + to_string(domain.kind()) + (equality ? " with an equality" : ""));
      Parameters parameters(energies().find(of.name).parameters);
      for (const auto& [key, value] : of.parameters) parameters.set(key, value);
      const auto energy = energies().find(of.name).make(parameters);
      Constraints constraints(domain.vertex_count(), p);
      for (Index v = 0; v < domain.vertex_count(); v += 4) constraints.fix(v, Eigen::RowVectorXd::Zero(p));
      std::vector<bool> roller(p, false);
      roller[0] = true;
      constraints.fix(1, Eigen::RowVectorXd::Zero(p), roller);
      constraints.attract(2, Eigen::RowVectorXd::Ones(p), 0.1);
      if (equality) constraints.combine({5, 6, 7}, {0.2, 0.3, 0.5}, Eigen::RowVectorXd::Zero(p));
      Problem problem(domain, *energy, of.norm, constraints);
      PlainLdlt backend;
      const Matrix rest = domain.positions();
      Matrix velocities = Matrix::Zero(static_cast<Index>(constraints.fixed().size()), p);
      Matrix values = Matrix::Zero(static_cast<Index>(constraints.equalities().size()), p);
      Matrix positions = rest;
      Matrix v;
      long before = 0;
      for (int evaluation = 0; evaluation < 5; ++evaluation) {
        if (evaluation == 2) before = testing::allocation_count();
        for (Index i = 0; i < positions.rows(); ++i) {
          for (int c = 0; c < p; ++c) {
            positions(i, c) =
                (1.0 + 0.1 * evaluation * (c + 1)) * rest(i, c) + 0.01 * evaluation * rest(i, 0) * rest(i, 0);
          }
        }
        velocities.setConstant(0.1 * evaluation);
        values.setConstant(-0.2 * evaluation);
        domain.set_positions(positions);
        problem.refresh_operator();
        problem.set_fixed_values(velocities);
        problem.set_equality_values(values);
        problem.solve(backend, v);
      }
      EXPECT_EQ(testing::allocation_count() - before, 0);
      EXPECT_EQ(backend.report().factorizations, 5);
      // The same as by a problem made for the last shape.
      Constraints last = constraints;
      last.set_fixed_values(velocities);
      last.set_equality_values(values);
      Problem fresh(domain, *energy, of.norm, last);
      const Matrix expected = fresh.solve(backend);
      EXPECT_LT((v - expected).norm(), 1e-8 * expected.norm());
      for (const auto& fixed : last.fixed()) {
        for (int c = 0; c < p; ++c) {
          if (fixed.holds(c)) {
            EXPECT_EQ(v(fixed.vertex, c), fixed.value[c]);
          }
        }
      }
      EXPECT_GT(std::abs(v(1, 1) - velocities(0, 0)), 1e-6) << "the roller rolls";
      if (equality) {
        EXPECT_LT((0.2 * v.row(5) + 0.3 * v.row(6) + 0.5 * v.row(7) - values.row(0)).norm(), 1e-8);
      }
    }
  }
}

TEST(FieldEvaluation, TensorsCarriedAlongAllocateNothing) {
  for (const Domain& rest : {Domain(rectangle_mesh({.h = 0.25})), Domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5))}) {
    Domain domain = rest;
    const int p = rest.ambient_dimension();
    Eigen::MatrixXd B = Eigen::MatrixXd::Identity(p, p);
    B(0, 1) = B(1, 0) = 0.4;
    const Matrix tensors = Eigen::Map<const Eigen::RowVectorXd>(B.data(), B.size()).replicate(rest.cell_count(), 1);
    VectorFieldEnergy energy(VectorFieldKind::metric, Vector::Zero(1), tensors, Smoothness::gradient);
    Constraints constraints(domain.vertex_count(), p);
    for (Index v = 0; v < domain.vertex_count(); v += 4) constraints.fix(v, Eigen::RowVectorXd::Random(p));
    Problem problem(domain, energy, {.beta = 0.3}, constraints);
    PlainLdlt backend;
    Matrix carried;
    Matrix v;
    Matrix positions = rest.positions();
    long before = 0;
    for (int evaluation = 0; evaluation < 4; ++evaluation) {
      if (evaluation == 2) before = testing::allocation_count();
      positions.col(0) *= 1.1;
      positions.col(1) += 0.1 * positions.col(0);
      domain.set_positions(positions);
      rotated_tensors(rest, positions, tensors, carried);
      energy.set_tensors(carried);
      problem.refresh_operator();
      problem.solve(backend, v);
    }
    EXPECT_EQ(testing::allocation_count() - before, 0);
    const VectorFieldEnergy last(VectorFieldKind::metric, Vector::Zero(1), carried, Smoothness::gradient);
    Problem fresh(domain, last, {.beta = 0.3}, constraints);
    EXPECT_LT((fresh.solve(backend) - v).norm(), 1e-10 * v.norm());
  }
}

// A backend that is made where another one was, with as many factorizations, is another one.
TEST(FieldEvaluation, FactorizesForANewBackendInTheSamePlace) {
  const Domain domain(rectangle_mesh({.h = 0.25}));
  const auto energy = energies().find("akvf").make(Parameters(energies().find("akvf").parameters));
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(0, Eigen::RowVector2d(0.0, 0.0));
  constraints.fix(3, Eigen::RowVector2d(0.1, 0.2));
  Problem problem(domain, *energy, {.beta = 0.3}, constraints);
  Problem other(domain, *energy, {.beta = 0.8}, constraints);
  std::optional<PlainLdlt> backend(std::in_place);
  const Matrix v = problem.solve(*backend);
  const std::uint64_t id = backend->id();
  backend.emplace();
  EXPECT_NE(backend->id(), id);
  other.solve(*backend);
  EXPECT_EQ(backend->report().factorizations, 1);
  EXPECT_EQ(problem.solve(*backend), v);
  EXPECT_EQ(backend->report().factorizations, 2);
}

}  // namespace
}  // namespace variform
