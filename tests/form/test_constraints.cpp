// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>

#include "energies/energies.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem_objective.h"
#include "solvers/linear/linear_backends.h"
#include "tests/allocation_count.h"
#include "tests/energies/energy_suite.h"
#include "tests/support.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<Energy> make(const std::string& name) {
  const EnergyEntry& entry = energies().find(name);
  return entry.make(Parameters(entry.parameters));
}

template <class Action>
std::string message_of(const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

Matrix solve(const Domain& domain, const Energy& energy, double beta, const Constraints& constraints,
             const std::string& backend = "eigen.ldlt") {
  Problem problem(domain, energy, {.beta = beta}, constraints);
  const auto linear = make_linear_backend(backend);
  return problem.solve(*linear);
}

class ConstraintTest : public ::testing::Test {
 protected:
  Domain domain_{rectangle_mesh({.h = 0.2, .jitter = 0.2})};
  Constraints pinned_ =
      testing::fixed_at(domain_, 2, {{0, Eigen::RowVector2d(0.0, 0.0)}, {5, Eigen::RowVector2d(0.1, 0.0)}});
};

TEST_F(ConstraintTest, HardOnesHoldExactly) {
  for (const std::string name : {"asap", "larap", "arap"}) {
    const Matrix U = solve(domain_, *make(name), 0.3, pinned_);
    for (const auto& fixed : pinned_.fixed()) EXPECT_EQ(U.row(fixed.vertex), fixed.value) << name;
  }
}

TEST_F(ConstraintTest, SoftOnesApproachTheirTargetLikeOneOverTheWeight) {
  for (const std::string name : {"larap", "arap"}) {
    const Eigen::RowVector2d target = domain_.positions().row(30) + Eigen::RowVector2d(0.2, 0.1);
    const auto error = [&](double weight, const std::string& backend) {
      Constraints constraints = pinned_;
      constraints.attract(30, target, weight);
      return (solve(domain_, *make(name), 0.3, constraints, backend).row(30) - target).norm();
    };
    EXPECT_NEAR(std::log10(error(1e4, "eigen.ldlt") / error(1e6, "eigen.ldlt")) / 2.0, 1.0, 0.01) << name;
#ifdef VARIFORM_TEST_SUITESPARSE
    EXPECT_NEAR(error(1e2, "spqr"), error(1e2, "eigen.ldlt"), 1e-10) << name;
#endif
  }
}

#ifdef VARIFORM_TEST_SUITESPARSE
// The least-squares path alternates as the normal equations do, with one factorization.
TEST_F(ConstraintTest, StackedAlternationAgreesWithNormalEquations) {
  Constraints constraints = pinned_;
  constraints.fix(30, domain_.positions().row(30) + Eigen::RowVector2d(0.3, 0.2));
  constraints.attract(20, domain_.positions().row(20) + Eigen::RowVector2d(0.1, -0.1), 0.5);
  const auto energy = make("arap");
  Matrix results[2];
  for (int k = 0; k < 2; ++k) {
    Problem problem(domain_, *energy, {.beta = 0.3}, constraints);
    const auto linear = make_linear_backend(k == 0 ? "eigen.ldlt" : "spqr");
    ProblemObjective objective(problem, *linear);
    results[k] = domain_.positions();
    for (int iteration = 0; iteration < 10; ++iteration) results[k] = objective.local_global_step(results[k]);
    EXPECT_EQ(linear->report().factorizations, 1);
  }
  EXPECT_LT((results[0] - results[1]).cwiseAbs().maxCoeff(), 1e-11);
}
#endif

TEST_F(ConstraintTest, IdentifiedVerticesMoveAsOneAndTheRestIsOptimal) {
  Constraints constraints = pinned_;
  constraints.identify(10, 20);
  constraints.identify(20, 30);
  for (const std::string name : {"larap", "arap"}) {
    const auto energy = make(name);
    const Matrix U = solve(domain_, *energy, 0.3, constraints);
    EXPECT_EQ(U.row(10), U.row(20));
    EXPECT_EQ(U.row(10), U.row(30));
    Problem problem(domain_, *energy, {.beta = 0.3}, constraints);
    Matrix direction = Matrix::Random(U.rows(), 2);
    direction.row(0).setZero();
    direction.row(5).setZero();
    direction.row(20) = direction.row(30) = direction.row(10);
    const double step = 1e-4;
    EXPECT_NEAR((problem.value(U + step * direction).total - problem.value(U - step * direction).total) / (2 * step),
                0.0, 1e-10);
  }
}

TEST_F(ConstraintTest, IdentifiedWithAFixedVertexIsFixed) {
  Constraints constraints = pinned_;
  constraints.identify(12, 5);
  EXPECT_EQ(solve(domain_, *make("larap"), 0.3, constraints).row(12), pinned_.fixed()[1].value);
}

TEST_F(ConstraintTest, LinearEqualitiesHoldAndTheRestIsOptimal) {
  Constraints constraints = pinned_;
  const Eigen::RowVector2d target(0.9, 1.2);
  constraints.combine({20, 21, 27}, {0.2, 0.3, 0.5}, target);
  for (const std::string name : {"larap", "arap"}) {
    const auto energy = make(name);
    const Matrix U = solve(domain_, *energy, 0.3, constraints, "eigen.lu");
    EXPECT_LT((0.2 * U.row(20) + 0.3 * U.row(21) + 0.5 * U.row(27) - target).norm(), 1e-12);
    Problem problem(domain_, *energy, {.beta = 0.3}, constraints);
    Matrix direction = Matrix::Random(U.rows(), 2);
    direction.row(0).setZero();
    direction.row(5).setZero();
    direction.row(27) = -(0.2 * direction.row(20) + 0.3 * direction.row(21)) / 0.5;
    const double step = 1e-4;
    EXPECT_NEAR((problem.value(U + step * direction).total - problem.value(U - step * direction).total) / (2 * step),
                0.0, 1e-10);
  }
}

TEST_F(ConstraintTest, ReductionIsTheProductWithTheEliminationMatrix) {
  Constraints constraints = pinned_;
  constraints.attract(30, Eigen::RowVector2d(0.2, 0.1), 7.0);
  constraints.identify(10, 11);  // neighbours: an off-diagonal entry of H lands on the diagonal of K
  constraints.identify(11, 20);
  constraints.identify(12, 5);  // with a fixed one
  for (const std::string name : {"asap", "arap"}) {
    const auto energy = make(name);
    Problem problem(domain_, *make(name), {.beta = 0.3}, constraints);
    const SparseMatrix& H = problem.normal_matrix();
    const Matrix& g = problem.normal_right_hand_side();
    const int unknowns = problem.traits().unknowns;
    Reduction reduction(H, constraints, unknowns);
    Vector values[2];
    for (int threads = 1; threads <= 2; ++threads) {
      const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
      reduction.refill(H, constraints);
      values[threads - 1] = Eigen::Map<const Vector>(reduction.matrix().valuePtr(), reduction.matrix().nonZeros());
    }
    EXPECT_EQ(values[0], values[1]) << name;
    const long before = testing::allocation_count();
    reduction.refill(H, constraints);
    EXPECT_EQ(testing::allocation_count() - before, 0) << name;

    Eigen::MatrixXd full = testing::dense_symmetric(H);
    Eigen::MatrixXd right = g - full * Eigen::MatrixXd(reduction.fixed_part(constraints, g.cols()));
    for (int i = 0; i < 2; ++i)
      right(30 * unknowns + (unknowns == 2 ? i : 0), unknowns == 2 ? 0 : i) += 7.0 * (0.2 - 0.1 * i);
    for (int i = 0; i < unknowns; ++i) full(30 * unknowns + i, 30 * unknowns + i) += 7.0;
    const Eigen::MatrixXd Z = reduction.elimination();
    const double scale = full.cwiseAbs().maxCoeff();
    EXPECT_LT((testing::dense_symmetric(reduction.matrix()) - Z.transpose() * full * Z).cwiseAbs().maxCoeff(),
              1e-14 * scale)
        << name;
    EXPECT_LT((reduction.right_hand_side(H, g, constraints) - Z.transpose() * right).cwiseAbs().maxCoeff(),
              1e-14 * scale)
        << name;
  }
}

// Against the optimality system with a multiplier for every scalar constraint, dense.
TEST_F(ConstraintTest, SingleComponentsAreHeldAsByMultipliers) {
  Constraints constraints = pinned_;
  constraints.fix(7, Eigen::RowVector2d(0.3, 99.0), {true, false});
  constraints.fix(14, Eigen::RowVector2d(-99.0, 0.6), {false, true});
  constraints.fix(33, Eigen::RowVector2d(0.4, 1.1), {true, true});  // as without marks
  constraints.identify(7, 8);                                       // x of both is held, y is one unknown
  constraints.identify(14, 20);
  constraints.identify(20, 21);
  constraints.attract(7, Eigen::RowVector2d(0.2, 0.1), 7.0);
  constraints.combine({7, 26}, {0.5, 0.5}, Eigen::RowVector2d(0.4, 0.5));
  EXPECT_TRUE(constraints.has_components());
  EXPECT_TRUE(constraints.fixed().back().components.empty());
  for (const std::string name : {"larap", "akvf", "asap"}) {
    const auto energy = make(name);
    Problem problem(domain_, *energy, {.beta = 0.3}, constraints);
    Eigen::MatrixXd H = testing::dense_symmetric(problem.normal_matrix());
    Eigen::VectorXd g = problem.normal_right_hand_side();
    for (int c = 0; c < 2; ++c) {
      H(7 * 2 + c, 7 * 2 + c) += 7.0;
      g[7 * 2 + c] += 7.0 * (c == 0 ? 0.2 : 0.1);
    }
    struct Row {
      std::vector<std::pair<Index, double>> entries;
      double value;
    };
    std::vector<Row> rows = {{{{14, 1.0}}, 0.3}, {{{29, 1.0}}, 0.6}, {{{66, 1.0}}, 0.4}, {{{67, 1.0}}, 1.1}};
    for (int c = 0; c < 2; ++c) {
      rows.push_back({{{c, 1.0}}, pinned_.fixed()[0].value[c]});
      rows.push_back({{{10 + c, 1.0}}, pinned_.fixed()[1].value[c]});
      for (const auto& [a, b] : {std::pair<Index, Index>(7, 8), {14, 20}, {20, 21}}) {
        rows.push_back({{{2 * a + c, 1.0}, {2 * b + c, -1.0}}, 0.0});
      }
      rows.push_back({{{14 + c, 0.5}, {52 + c, 0.5}}, c == 0 ? 0.4 : 0.5});
    }
    const Eigen::Index n = H.cols();
    const auto m = static_cast<Eigen::Index>(rows.size());
    Eigen::MatrixXd K = Eigen::MatrixXd::Zero(n + m, n + m);
    Eigen::VectorXd right(n + m);
    K.topLeftCorner(n, n) = H;
    right.head(n) = g;
    for (Eigen::Index i = 0; i < m; ++i) {
      for (const auto& [unknown, weight] : rows[i].entries) K(n + i, unknown) = K(unknown, n + i) = weight;
      right[n + i] = rows[i].value;
    }
    const Eigen::VectorXd expected = K.fullPivLu().solve(right).head(n);
    const Matrix U = problem.solve(*make_linear_backend("eigen.lu"));
    EXPECT_LT((U - Eigen::Map<const Matrix>(expected.data(), U.rows(), 2)).cwiseAbs().maxCoeff(), 1e-9) << name;
    EXPECT_EQ(U(7, 0), 0.3);
    EXPECT_EQ(U(14, 1), 0.6);
  }
}

TEST_F(ConstraintTest, SingleComponentsAreForCoupledEnergies) {
  Constraints rollers = pinned_;
  rollers.fix(7, Eigen::RowVector2d(0.3, 0.0), {true, false});
  const auto arap = make("arap");
  EXPECT_THAT(message_of([&] { Problem(domain_, *arap, {.beta = 0.3}, rollers); }), HasSubstr("separately"));
  const auto larap = make("larap");
  Problem problem(domain_, *larap, {.beta = 0.3}, rollers);
  EXPECT_THROW(problem.hold(7, Eigen::RowVector2d(0.0, 0.0)), UsageError);
  EXPECT_THAT(message_of([&] {
                rollers.fix(8, Eigen::RowVector2d(0, 0), {false, false});
              }),
              HasSubstr("0 of 2 components"));
  EXPECT_THAT(message_of([&] { rollers.fix(8, Eigen::RowVector2d(0, 0), {true}); }), HasSubstr("expected 2 flags"));
  EXPECT_THAT(message_of([&] { rollers.fix(7, Eigen::RowVector2d(0.3, 0.0)); }), HasSubstr("different components"));
  EXPECT_THAT(message_of([&] {
                rollers.fix(7, Eigen::RowVector2d(0.4, 0.0), {true, false});
              }),
              HasSubstr("fixed at both"));
  EXPECT_NO_THROW(rollers.fix(7, Eigen::RowVector2d(0.3, 5.0), {true, false}));
  Constraints pair = rollers;  // the held components differ, the free ones may
  pair.fix(8, Eigen::RowVector2d(0.9, 0.0), {true, false});
  pair.identify(7, 8);
  EXPECT_THAT(message_of([&] { Problem(domain_, *larap, {}, pair).reduced_matrix(); }), HasSubstr("7 and 8"));
  Constraints equality = rollers;
  equality.combine({7}, {1.0}, Eigen::RowVector2d(0.3, 0.1));
  EXPECT_THAT(message_of([&] { Problem(domain_, *larap, {}, equality).reduced_matrix(); }),
              HasSubstr("in some component"));
}

TEST_F(ConstraintTest, RollersHoldOnlyTheMotionsAlongThem) {
  // Vertex 5 is at the end of the edge through vertex 0: only across that edge it holds the turn about vertex 0.
  ASSERT_EQ(domain_.positions()(0, 1), domain_.positions()(5, 1));
  for (const bool across : {false, true}) {
    Constraints constraints = testing::fixed_at(domain_, 2, {{0, Eigen::RowVector2d(0, 0)}});
    constraints.fix(5, domain_.positions().row(5), {!across, across});
    const std::string message = message_of([&] { solve(domain_, *make("larap"), 0.2, constraints); });
    EXPECT_THAT(message, HasSubstr(across ? "no error" : "hold 2 of the 3 motions"));
  }
}

TEST_F(ConstraintTest, NewValuesOfEqualitiesNeedNoNewFactorization) {
  Constraints constraints = pinned_;
  constraints.combine({20, 21, 27}, {0.2, 0.3, 0.5}, Eigen::RowVector2d(0.4, 0.6));
  const auto energy = make("larap");
  Problem problem(domain_, *energy, {.beta = 0.3}, constraints);
  const auto linear = make_linear_backend("eigen.lu");
  problem.solve(*linear);
  const Matrix values{{0.7, 0.2}};
  problem.set_equality_values(values);
  const Matrix U = problem.solve(*linear);
  EXPECT_LT((0.2 * U.row(20) + 0.3 * U.row(21) + 0.5 * U.row(27) - values).norm(), 1e-12);
  EXPECT_EQ(linear->report().factorizations, 1);
  EXPECT_THAT(message_of([&] { problem.set_equality_values(Matrix::Zero(2, 2)); }),
              HasSubstr("expected 1 x 2 values of linear equalities, got 2 x 2"));
  EXPECT_THROW(problem.set_equality_values(Matrix::Constant(1, 2, std::nan(""))), DataError);
}

// Counts how often targets are declared.
class CountingEnergy final : public Energy {
 public:
  explicit CountingEnergy(std::unique_ptr<Energy> energy) : energy_(std::move(energy)) {}
  EnergyTraits traits(const Domain& domain) const override { return energy_->traits(domain); }
  Form declare(const Domain& domain) const override { return energy_->declare(domain); }
  void refresh_operator(const Domain& domain, Form& form) const override { energy_->refresh_operator(domain, form); }
  Index refresh_target(const Domain& domain, const Matrix& U, Form& form) const override {
    ++count;
    return energy_->refresh_target(domain, U, form);
  }
  mutable int count = 0;

 private:
  std::unique_ptr<Energy> energy_;
};

TEST_F(ConstraintTest, TargetsAreDeclaredOncePerState) {
  const CountingEnergy energy(make("arap"));
  Problem problem(domain_, energy, {.beta = 0.3}, pinned_);
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  const Matrix U = 1.1 * domain_.positions();
  objective.value(U);
  const Matrix next = objective.local_global_step(U);
  EXPECT_EQ(energy.count, 1);
  objective.value(next);
  objective.value(U);
  EXPECT_EQ(energy.count, 3);
  EXPECT_EQ(objective.local_global_step(U), next);
  EXPECT_EQ(energy.count, 3);
  problem.refresh_operator();  // targets depend on it
  objective.value(U);
  EXPECT_EQ(energy.count, 4);
}

TEST_F(ConstraintTest, NewValuesNeedNoNewFactorization) {
  const auto energy = make("larap");
  Problem problem(domain_, *energy, {.beta = 0.3}, pinned_);
  const auto linear = make_linear_backend("eigen.ldlt");
  problem.solve(*linear);
  Matrix values(2, 2);
  values << 0.0, 0.0, 1.3, 0.4;
  problem.set_fixed_values(values);
  const Matrix U = problem.solve(*linear);
  EXPECT_EQ(U.row(5), values.row(1));
  EXPECT_EQ(linear->report().factorizations, 1);
}

TEST_F(ConstraintTest, AllVerticesFixedReturnsTheConstraints) {
  Constraints constraints(domain_.vertex_count(), 2);
  for (Index v = 0; v < domain_.vertex_count(); ++v) constraints.fix(v, 2.0 * domain_.positions().row(v));
  EXPECT_EQ(solve(domain_, *make("asap"), 0.2, constraints), 2.0 * domain_.positions());
}

TEST_F(ConstraintTest, BadOnesAreNamed) {
  Constraints c = pinned_;
  EXPECT_THAT(message_of([&] { c.fix(36, Eigen::RowVector2d(0, 0)); }),
              HasSubstr("vertex 36 does not exist; the mesh has vertices 0 to 35"));
  EXPECT_THAT(message_of([&] { c.fix(-1, Eigen::RowVector2d(0, 0)); }), HasSubstr("vertex -1"));
  EXPECT_THAT(message_of([&] { c.fix(0, Eigen::RowVector2d(1, 0)); }), HasSubstr("vertex 0 is fixed at both"));
  EXPECT_THAT(message_of([&] { c.fix(1, Eigen::RowVector3d(1, 0, 0)); }), HasSubstr("expected 2 coordinates, got 3"));
  EXPECT_THAT(message_of([&] { c.fix(1, Eigen::RowVector2d(std::nan(""), 0)); }), HasSubstr("not finite"));
  EXPECT_THAT(message_of([&] { c.attract(1, Eigen::RowVector2d(0, 0), -1.0); }), HasSubstr("soft weight -1"));
  EXPECT_THAT(message_of([&] {
                c.combine({1, 2}, {1.0}, Eigen::RowVector2d(0, 0));
              }),
              HasSubstr("2 vertices with 1 weights"));
  EXPECT_NO_THROW(c.fix(0, domain_.positions().row(0)));
}

TEST_F(ConstraintTest, TooFewAreFoundBeforeFactorization) {
  const Constraints one = testing::fixed_at(domain_, 2, {{0, Eigen::RowVector2d(0, 0)}});
  EXPECT_THAT(message_of([&] { solve(domain_, *make("asap"), 0.2, one); }),
              HasSubstr("component 0 of 1 (with cell 0) has 1 constrained vertices, which hold 2 of the 4 motions"));
  EXPECT_THAT(message_of([&] { solve(domain_, *make("larap"), 0.2, one); }), HasSubstr("hold 2 of the 3 motions"));
  EXPECT_EQ(message_of([&] { solve(domain_, *make("arap"), 0.2, one); }), "no error");
  EXPECT_THAT(message_of([&] { solve(domain_, *make("arap"), 0.2, Constraints(domain_.vertex_count(), 2)); }),
              HasSubstr("too few constraints"));
}

TEST_F(ConstraintTest, IdentificationDoesNotHoldASimilarity) {
  // All points at one place satisfy an identification, wherever that place is.
  Constraints c(domain_.vertex_count(), 2);
  c.identify(0, 2);
  EXPECT_THAT(message_of([&] { solve(domain_, *make("asap"), 0.2, c); }), HasSubstr("hold 0 of the 4 motions"));
  // With a pin the collapse is the one minimizer left: two points at one place allow no other similarity.
  c.fix(5, domain_.positions().row(5));
  const Matrix U = solve(domain_, *make("asap"), 0.2, c);
  EXPECT_LT((U.rowwise() - domain_.positions().row(5)).cwiseAbs().maxCoeff(), 1e-10);
}

TEST_F(ConstraintTest, IdentifiedVerticesFixedApartAreAContradiction) {
  Constraints c = pinned_;
  c.identify(0, 7);
  c.identify(7, 5);
  EXPECT_THAT(message_of([&] { solve(domain_, *make("larap"), 0.2, c); }),
              HasSubstr("vertices 0 and 5 are identified, but fixed at"));
  // Also when the values come later.
  const auto energy = make("larap");
  Constraints together(domain_.vertex_count(), 2);
  together.fix(0, Eigen::RowVector2d(0.0, 0.0));
  together.fix(5, Eigen::RowVector2d(0.0, 0.0));
  together.fix(30, domain_.positions().row(30));
  together.identify(0, 5);
  Problem problem(domain_, *energy, {.beta = 0.2}, together);
  const auto linear = make_linear_backend("eigen.ldlt");
  problem.solve(*linear);
  Matrix values(3, 2);
  values << 0.0, 0.0, 0.5, 0.0, 1.0, 1.0;
  problem.set_fixed_values(values);
  EXPECT_THAT(message_of([&] { problem.solve(*linear); }), HasSubstr("are identified, but fixed at"));
}

TEST(ConstraintRank, SeesTheLineThroughCollinearVertices) {
  // Fixing any number of vertices of one edge of a bar leaves the turn about that edge.
  const Domain bar(bar_tet_mesh(2.0, 1.0, 1.0, 0.5));
  const Eigen::MatrixXd kernel =
      kernel_basis({.residuals = 9, .unknowns = 3, .columns = 1, .kernel = Kernel::rigid_motions}, bar);
  Constraints constraints(bar.vertex_count(), 3);
  Index off_edge = 0;
  for (Index v = 0; v < bar.vertex_count(); ++v) {
    if (bar.positions()(v, 1) == 0.0 && bar.positions()(v, 2) == 0.0)
      constraints.fix(v, bar.positions().row(v));
    else
      off_edge = v;
  }
  EXPECT_THAT(message_of([&] { check_constraint_rank(bar, constraints, kernel, 3); }),
              HasSubstr("hold 5 of the 6 motions"));
  constraints.fix(off_edge, bar.positions().row(off_edge));
  EXPECT_NO_THROW(check_constraint_rank(bar, constraints, kernel, 3));
}

TEST(ConstraintRank, ComponentsHeldByASeamAreHeld) {
  // Two squares side by side, not connected: the second is held only by two identifications with the first.
  Mesh mesh;
  mesh.positions.resize(8, 2);
  mesh.positions << 0, 0, 1, 0, 1, 1, 0, 1, 1, 0, 2, 0, 2, 1, 1, 1;
  mesh.cells.resize(4, 3);
  mesh.cells << 0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7;
  const Domain domain(mesh);
  const auto energy = make("larap");
  Constraints seam = testing::fixed_at(domain, 2, {{0, Eigen::RowVector2d(0, 0)}, {3, Eigen::RowVector2d(0, 0)}});
  seam.identify(1, 4);
  EXPECT_THAT(message_of([&] { Problem(domain, *energy, {}, seam); }), HasSubstr("component 1 of 2"));
  seam.identify(2, 7);
  EXPECT_NO_THROW(Problem(domain, *energy, {}, seam));
}

TEST(ConstraintRank, IsPerComponent) {
  // Two squares that share one vertex: no facet connects them.
  Mesh mesh;
  mesh.positions.resize(7, 2);
  mesh.positions << 0, 0, 1, 0, 1, 1, 0, 1, 2, 1, 2, 2, 1, 2;
  mesh.cells.resize(4, 3);
  mesh.cells << 0, 1, 2, 0, 2, 3, 2, 4, 5, 2, 5, 6;
  const Domain domain(mesh);
  ASSERT_EQ(domain.component_count(), 2);
  const auto energy = make("larap");
  const Constraints first =
      testing::fixed_at(domain, 2, {{0, Eigen::RowVector2d(0, 0)}, {1, Eigen::RowVector2d(0, 0)}});
  EXPECT_THAT(message_of([&] { Problem(domain, *energy, {}, first); }), HasSubstr("component 1 of 2 (with cell 2)"));
}

TEST(ClosestFeasible, SatisfiesAllHardConstraintsAndMovesNoMoreThanNeeded) {
  Constraints constraints(6, 2);
  constraints.fix(0, Eigen::RowVector2d(5.0, 6.0));
  constraints.identify(1, 2);
  constraints.identify(2, 1);  // says the same twice
  constraints.identify(3, 0);
  constraints.combine({4, 5}, {0.25, 0.75}, Eigen::RowVector2d(1.0, 1.0));
  const Matrix U{{1, 1}, {0, 0}, {2, 4}, {9, 9}, {0, 0}, {0, 0}};
  const Matrix result = closest_feasible(constraints, U);
  // The middle of two vertices; the fixed value; the foot of the perpendicular on a plane, w / |w|^2.
  const Matrix expected{{5, 6}, {1, 2}, {1, 2}, {5, 6}, {0.4, 0.4}, {1.2, 1.2}};
  EXPECT_LT((result - expected).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((closest_feasible(constraints, result) - result).cwiseAbs().maxCoeff(), 1e-14);
  // Components on their own: x of vertex 1 is held, so the seam moves x of vertex 2 alone, and y of both.
  Constraints rollers(3, 2);
  rollers.fix(1, Eigen::RowVector2d(3.0, 0.0), {true, false});
  rollers.identify(1, 2);
  const Matrix rolled = closest_feasible(rollers, Matrix{{7, 8}, {1, 2}, {5, 4}});
  EXPECT_LT((rolled - Matrix{{7, 8}, {3, 3}, {3, 3}}).cwiseAbs().maxCoeff(), 1e-12);
  Constraints contradiction(2, 2);
  contradiction.combine({0}, {1.0}, Eigen::RowVector2d(0.0, 0.0));
  contradiction.combine({0}, {2.0}, Eigen::RowVector2d(1.0, 0.0));
  EXPECT_THROW(closest_feasible(contradiction, Matrix::Zero(2, 2)), SolverError);
}

}  // namespace
}  // namespace variform
