// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>

#include "energies/energies.h"
#include "energies/gradient/poisson.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem_objective.h"
#include "framework/operators/distortion.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"
#include "solvers/nonlinear/nonlinear_backends.h"
#include "tests/energies/energy_suite.h"
#include "tests/support.h"

namespace variform {
namespace {

constexpr FacetWeight kWeights[] = {FacetWeight::facet_measure, FacetWeight::facet_measure_unit,
                                    FacetWeight::finite_volume};

std::unique_ptr<Energy> make(const std::string& name) {
  const EnergyEntry& entry = energies().find(name);
  return entry.make(Parameters(entry.parameters));
}

Domain jittered_square(double h) { return Domain(rectangle_mesh({.h = h, .jitter = 0.2})); }

Index nearest(const Domain& domain, double x, double y) {
  Index best = 0;
  (domain.positions().rowwise() - Eigen::RowVector2d(x, y)).rowwise().squaredNorm().minCoeff(&best);
  return best;
}

Index count_flipped(const Domain& domain, const Matrix& U) {
  Index flipped = 0;
  for (Index t = 0; t < domain.cell_count(); ++t) flipped += deformation(domain, t, U).determinant() <= 0.0;
  return flipped;
}

Matrix minimize(const Domain& domain, const Energy& energy, const NormOptions& norm, const Constraints& constraints,
                NonlinearReport* report = nullptr, const Matrix& start = {}, double tolerance = 1e-8) {
  Problem problem(domain, energy, norm, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  if (problem.traits().state == StateDependence::none) return problem.solve(*linear);
  ProblemObjective objective(problem, *linear);
  const auto nonlinear = make_nonlinear_backend("local_global");
  const Matrix U = nonlinear->minimize(objective, start.size() > 0 ? start : domain.positions(),
                                       {.tolerance = tolerance, .max_iterations = 2000});
  if (report != nullptr) *report = nonlinear->report();
  return U;
}

// Left side clamped, one vertex of the right end dragged.
Constraints dragged_strip(const Domain& domain, const Eigen::RowVector2d& move) {
  std::vector<std::pair<Index, Eigen::RowVectorXd>> moves;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.positions()(v, 0) == 0.0) moves.emplace_back(v, Eigen::RowVector2d::Zero());
  }
  moves.emplace_back(nearest(domain, 3.5, 0.5), move);
  return testing::fixed_at(domain, 2, moves);
}

TEST(PlanarEnergies, ValuesAreTheStatedFunctionsOfSingularValues) {
  const Domain domain = jittered_square(0.25);
  const Matrix U = domain.positions() + 0.08 * Matrix::Random(domain.vertex_count(), 2);
  double similar = 0.0;
  double rigid = 0.0;
  double killing = 0.0;
  double conformal = 0.0;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::Matrix2d F = deformation(domain, t, U);
    const Eigen::JacobiSVD<Eigen::Matrix2d> svd(F);
    const double s1 = svd.singularValues()[0];
    const double s2 = svd.singularValues()[1] * (F.determinant() < 0.0 ? -1.0 : 1.0);
    const Eigen::Matrix2d J = F - Eigen::Matrix2d::Identity();
    similar += domain.cell_measures()[t] * 0.5 * (s1 - s2) * (s1 - s2);
    rigid += domain.cell_measures()[t] * ((s1 - 1) * (s1 - 1) + (s2 - 1) * (s2 - 1));
    killing += domain.cell_measures()[t] * (J + J.transpose()).squaredNorm();
    conformal += domain.cell_measures()[t] * ((F + F.transpose()).squaredNorm() - 2.0 * F.trace() * F.trace());
  }
  const auto value = [&](const std::string& name) {
    const auto energy = make(name);
    Problem problem(domain, *energy, {},
                    testing::fixed_at(domain, 2, {{0, Eigen::RowVector2d::Zero()}, {1, Eigen::RowVector2d::Zero()}}));
    problem.refresh_target(U);
    return problem.value(U).plain;
  };
  EXPECT_NEAR(value("asap"), similar, 1e-12 * similar);
  EXPECT_NEAR(value("asap"), 0.25 * conformal, 1e-12 * similar);
  EXPECT_NEAR(value("arap"), rigid, 1e-12 * rigid);
  const Distortion errors = distortion(domain, U);
  EXPECT_NEAR(value("arap"), domain.total_measure() * errors.isometric, 1e-12 * rigid);
  EXPECT_NEAR(value("asap"), domain.total_measure() * errors.conformal, 1e-12 * similar);
  EXPECT_NEAR(value("larap"), 0.25 * killing, 1e-12 * killing);
}

// At beta = 1, which the norm refuses, only the variation of the residual is left: it cannot see affine maps.
TEST(PlanarEnergies, AffineMapsHaveNoVariation) {
  const Domain domain = jittered_square(0.2);
  for (const auto& [name, dimension] :
       {std::pair<std::string, int>("asap", 6), {"larap", 6}, {"arap", 3}, {"poisson", 3}}) {
    const auto energy = make(name);
    const Form form = energy->declare(domain);
    const int n = form.residuals();
    const Eigen::MatrixXd E = form.sparse_operator();
    Eigen::MatrixXd jumps(domain.facet_count() * n, E.cols());
    for (Index f = 0; f < domain.facet_count(); ++f) {
      jumps.middleRows(f * n, n) =
          std::sqrt(domain.facet_measures()[f]) *
          (E.middleRows(domain.facet_cells()(f, 0) * n, n) - E.middleRows(domain.facet_cells()(f, 1) * n, n));
    }
    const Vector singular = Eigen::BDCSVD<Eigen::MatrixXd>(jumps).singularValues();
    EXPECT_EQ((singular.array() < 1e-10 * singular[0]).count(), dimension) << name;
  }
}

TEST(PlanarEnergies, RigidMotionsAndSimilaritiesCostNothing) {
  const Domain domain = jittered_square(0.25);
  const double angle = 2.4;  // beyond a right angle: a closest rotation from a half-plane formula would fail
  Eigen::Matrix2d Q;
  Q << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  const Matrix rotated = (domain.positions() * Q.transpose()).rowwise() + Eigen::RowVector2d(3.0, -1.0);
  for (const auto& [name, U] :
       {std::pair<std::string, Matrix>("arap", rotated), std::pair<std::string, Matrix>("asap", 1.7 * rotated)}) {
    for (const double beta : {0.0, 0.5}) {
      const auto energy = make(name);
      Problem problem(domain, *energy, {.beta = beta},
                      testing::fixed_at(domain, 2, {{0, Eigen::RowVector2d::Zero()}, {3, Eigen::RowVector2d::Zero()}}));
      problem.refresh_target(U);
      EXPECT_LT(problem.value(U).total, 1e-26) << name;
    }
  }
}

// With hard constraints sampled from a motion that costs nothing, the motion is the minimizer for every beta and
// weight.
TEST(PlanarEnergies, FreeMotionsAreReproducedExactly) {
  const Domain domain = jittered_square(0.2);
  const double angle = 0.8;
  Eigen::Matrix2d Q;
  Q << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  const Matrix rotated = domain.positions() * Q.transpose();
  for (const FacetWeight weight : kWeights) {
    for (const double beta : {0.0, 0.2, 0.9}) {
      for (const std::string name : {"arap", "asap"}) {
        const Matrix target = name == "asap" ? Matrix(1.4 * rotated) : rotated;
        Constraints constraints(domain.vertex_count(), 2);
        for (Index v = 0; v < domain.vertex_count(); v += 5) constraints.fix(v, target.row(v));
        NonlinearReport report;
        const Matrix U = minimize(domain, *make(name), {beta, weight}, constraints, &report, {}, 1e-13);
        EXPECT_LT((U - target).cwiseAbs().maxCoeff(), 1e-9) << name << " " << beta;
      }
    }
  }
}

TEST(PlanarEnergies, BetaZeroIsThePlainMethod) {
  const Domain domain = jittered_square(0.2);
  const Constraints constraints = testing::fixed_at(
      domain, 2, {{0, Eigen::RowVector2d(0, 0)}, {5, Eigen::RowVector2d(0, 0)}, {20, Eigen::RowVector2d(0.2, 0.1)}});
  const auto energy = make("asap");
  Problem problem(domain, *energy, {.beta = 0.0}, constraints);
  const SparseMatrix E = problem.terms().front().form.sparse_operator();
  Vector areas(4 * domain.cell_count());
  for (Index t = 0; t < domain.cell_count(); ++t) areas.segment(4 * t, 4).setConstant(domain.cell_measures()[t]);
  const Eigen::MatrixXd plain = Eigen::MatrixXd(E.transpose() * areas.asDiagonal() * E);
  EXPECT_LT((testing::dense_symmetric(problem.normal_matrix()) - plain).cwiseAbs().maxCoeff(), 1e-14);
  // Brute force: the constrained minimizer from dense algebra.
  std::vector<Index> free;
  Vector known = Vector::Zero(2 * domain.vertex_count());
  std::vector<bool> fixed(2 * domain.vertex_count(), false);
  for (const auto& value : constraints.fixed()) {
    for (int i = 0; i < 2; ++i) {
      known[2 * value.vertex + i] = value.value[i];
      fixed[2 * value.vertex + i] = true;
    }
  }
  for (Index i = 0; i < known.size(); ++i) {
    if (!fixed[i]) free.push_back(i);
  }
  const Vector x = plain(free, free).ldlt().solve(-(plain * known)(free));
  const auto linear = make_linear_backend("eigen.ldlt");
  const Matrix U = problem.solve(*linear);
  Vector expected = known;
  expected(free) = x;
  EXPECT_LT((Eigen::Map<const Vector>(U.data(), U.size()) - expected).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(PlanarEnergies, RegularizationTradesEnergyForVariationMonotonically) {
  const Domain domain(rectangle_mesh({.width = 4.0, .h = 1.0 / 8, .jitter = 0.2}));
  const Constraints constraints = dragged_strip(domain, {-1.5, 1.8});
  for (const std::string name : {"asap", "larap"}) {
    const auto energy = make(name);
    EnergyValue last{};
    std::vector<double> minima;
    for (int i = 0; i <= 8; ++i) {
      const double beta = 0.1 * i;
      Problem problem(domain, *energy, {.beta = beta}, constraints);
      const auto linear = make_linear_backend("eigen.ldlt");
      const EnergyValue value = problem.value(problem.solve(*linear));
      if (i > 0) {
        EXPECT_GE(value.plain, last.plain * (1 - 1e-12)) << name << beta;
        EXPECT_LE(value.variation, last.variation * (1 + 1e-12)) << name << beta;
      }
      last = value;
      minima.push_back(value.total);
    }
    // The minimum of functions affine in beta is concave in beta.
    for (std::size_t i = 1; i + 1 < minima.size(); ++i) {
      EXPECT_GE(minima[i], 0.5 * (minima[i - 1] + minima[i + 1]) * (1 - 1e-12)) << name;
    }
  }
}

TEST(PlanarEnergies, SolutionDependsLinearlyOnSmallBeta) {
  const Domain domain = jittered_square(0.125);
  Constraints constraints = testing::fixed_at(domain, 2, {{nearest(domain, 0.5, 0.5), Eigen::RowVector2d(0.2, 0.0)}});
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.boundary_vertices()[v]) constraints.fix(v, domain.positions().row(v));
  }
  const Matrix plain = minimize(domain, *make("larap"), {.beta = 0.0}, constraints);
  const auto distance = [&](double beta) {
    return (minimize(domain, *make("larap"), {.beta = beta}, constraints) - plain).norm();
  };
  EXPECT_NEAR(std::log10(distance(1e-5) / distance(1e-7)) / 2.0, 1.0, 0.01);
}

TEST(PlanarEnergies, LarapStripLosesItsFlipsAsBetaGrows) {
  const Domain domain(rectangle_mesh({.width = 4.0, .h = 1.0 / 16, .jitter = 0.2}));
  const Constraints constraints = dragged_strip(domain, {-1.5, 1.8});
  Index last = 0;
  for (const double beta : {0.0, 0.05, 0.2, 0.4}) {
    const Index flipped = count_flipped(domain, minimize(domain, *make("larap"), {.beta = beta}, constraints));
    if (beta == 0.0) {
      EXPECT_GT(flipped, 0);
    } else {
      EXPECT_LE(flipped, last);
    }
    last = flipped;
  }
  EXPECT_EQ(last, 0);
}

TEST(PlanarEnergies, ArapAlternationDescendsWithoutRegularization) {
  const Domain domain(rectangle_mesh({.width = 4.0, .h = 1.0 / 8, .jitter = 0.2}));
  NonlinearReport report;
  minimize(domain, *make("arap"), {.beta = 0.0}, dragged_strip(domain, {-1.5, 1.8}), &report);
  ASSERT_TRUE(report.converged) << report.reason;
  ASSERT_GT(report.iterations, 5);
  // History row 0 is the start, which does not satisfy the constraints yet.
  for (std::size_t i = 2; i < report.history.size(); ++i) {
    EXPECT_LE(report.history[i].energy.plain, report.history[i - 1].energy.plain * (1 + 1e-12));
  }
}

TEST(PlanarEnergies, IterationLimitIsNotConvergence) {
  const Domain domain(rectangle_mesh({.width = 4.0, .h = 1.0 / 8}));
  const auto energy = make("arap");
  Problem problem(domain, *energy, {}, dragged_strip(domain, {-1.5, 1.8}));
  const auto linear = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *linear);
  const auto nonlinear = make_nonlinear_backend("local_global");
  nonlinear->minimize(objective, domain.positions(), {.tolerance = 1e-12, .max_iterations = 3});
  EXPECT_FALSE(nonlinear->report().converged);
  EXPECT_THAT(nonlinear->report().reason, ::testing::HasSubstr("iteration limit 3"));
  // All iterations share one factorization: only c changes.
  EXPECT_EQ(linear->report().factorizations, 1);
}

TEST(PlanarEnergies, RotatedSceneGivesRotatedResult) {
  const Domain domain = jittered_square(0.2);
  const double angle = 1.1;
  Eigen::Matrix2d Q;
  Q << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  Constraints here(domain.vertex_count(), 2);
  Constraints there(domain.vertex_count(), 2);
  for (Index v = 0; v < domain.vertex_count(); v += 7) {
    const Eigen::RowVector2d value = domain.positions().row(v) + 0.1 * Eigen::RowVector2d(std::sin(v), std::cos(2 * v));
    here.fix(v, value);
    there.fix(v, value * Q.transpose());
  }
  Domain turned = domain;
  turned.set_positions(domain.positions() * Q.transpose());
  for (const std::string name : {"asap", "arap"}) {
    const Matrix a = minimize(domain, *make(name), {.beta = 0.3}, here);
    const Matrix b = minimize(domain, *make(name), {.beta = 0.3}, there);
    // LARAP is left out: its residual is relative to the identity, so only the turned rest mesh may rotate.
    EXPECT_LT((b - a * Q.transpose()).cwiseAbs().maxCoeff(), 1e-6) << name;
  }
  const Matrix a = minimize(domain, *make("larap"), {.beta = 0.3}, here);
  const Matrix b = minimize(turned, *make("larap"), {.beta = 0.3}, there);
  EXPECT_LT((b - a * Q.transpose()).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(PlanarEnergies, ScaleInvarianceIsAsDocumented) {
  const Domain domain = jittered_square(0.125);
  Domain scaled = domain;
  scaled.set_positions(1000.0 * domain.positions());
  Constraints here(domain.vertex_count(), 2);
  Constraints there(domain.vertex_count(), 2);
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (!domain.boundary_vertices()[v]) continue;
    here.fix(v, domain.positions().row(v));
    there.fix(v, 1000.0 * domain.positions().row(v));
  }
  const Index centre = nearest(domain, 0.5, 0.5);
  here.fix(centre, domain.positions().row(centre) + Eigen::RowVector2d(0.25, 0.0));
  there.fix(centre, 1000.0 * (domain.positions().row(centre) + Eigen::RowVector2d(0.25, 0.0)));
  for (const FacetWeight weight : kWeights) {
    const Matrix a = minimize(domain, *make("larap"), {0.2, weight}, here);
    const Matrix b = minimize(scaled, *make("larap"), {0.2, weight}, there) / 1000.0;
    const double difference = (a - b).cwiseAbs().maxCoeff();
    if (weight == FacetWeight::facet_measure) {
      EXPECT_GT(difference, 1e-3);
    } else {
      EXPECT_LT(difference, 1e-11);
    }
  }
}

TEST(Poisson, ReproducesAffineMapsAndIntegrableFields) {
  const Domain domain = jittered_square(0.2);
  Eigen::Matrix2d A;
  A << 1.3, 0.4, -0.2, 0.7;
  const Matrix affine = (domain.positions() * A.transpose()).rowwise() + Eigen::RowVector2d(0.5, -2.0);
  const Matrix f = domain.positions() + 0.2 * Matrix::Random(domain.vertex_count(), 2);
  for (const FacetWeight weight : kWeights) {
    for (const double beta : {0.0, 0.2, 0.95}) {
      const auto constant = make_poisson(Eigen::MatrixXd(A.transpose()));
      Constraints pin(domain.vertex_count(), 2);
      pin.fix(4, affine.row(4));
      EXPECT_LT((minimize(domain, *constant, {beta, weight}, pin) - affine).cwiseAbs().maxCoeff(), 1e-9);
      Matrix guidance(domain.cell_count(), 4);
      for (Index t = 0; t < domain.cell_count(); ++t) {
        const Eigen::Matrix2d F = deformation(domain, t, f);
        guidance.row(t) = Eigen::Map<const Eigen::RowVector4d>(F.data());
      }
      Constraints pin_f(domain.vertex_count(), 2);
      pin_f.fix(4, f.row(4));
      EXPECT_LT((minimize(domain, *make_poisson(guidance, 2), {beta, weight}, pin_f) - f).cwiseAbs().maxCoeff(), 1e-9);
    }
  }
}

// The scalar Poisson matrix of the unit square: (1-beta) L + 2 sqrt(2) beta q q', q = (1,-1,1,-1).
TEST(Poisson, WorkedExampleOfTheUnitSquare) {
  Mesh mesh;
  mesh.positions.resize(4, 2);
  mesh.positions << 0, 0, 1, 0, 1, 1, 0, 1;
  mesh.cells.resize(2, 3);
  mesh.cells << 0, 1, 2, 0, 2, 3;
  const Domain domain(mesh);
  const double beta = 0.3;
  const auto energy = make_poisson(Eigen::MatrixXd(Eigen::Vector2d::Zero()));
  Constraints pin(4, 1);
  pin.fix(0, Eigen::RowVectorXd::Zero(1));
  Problem problem(domain, *energy, {.beta = beta}, pin);
  Eigen::Matrix4d L;
  L << 1, -.5, 0, -.5, -.5, 1, -.5, 0, 0, -.5, 1, -.5, -.5, 0, -.5, 1;
  const Eigen::Vector4d q(1, -1, 1, -1);
  const Eigen::Matrix4d expected = (1 - beta) * L + 2.0 * std::sqrt(2.0) * beta * q * q.transpose();
  EXPECT_LT((testing::dense_symmetric(problem.normal_matrix()) - expected).cwiseAbs().maxCoeff(), 1e-15);
}

// Tikhonov pulls the solution together whatever the energy wants: with one pinned vertex at rest the minimizer of a
// rigid energy is the rest pose shrunk by exactly 1 - beta, while the W_n norm leaves it alone.
TEST(Tikhonov, ShrinksByOneMinusBeta) {
  const Domain domain = jittered_square(0.2);
  const Eigen::RowVector2d pin = domain.positions().row(7);
  for (const double beta : {0.25, 0.5}) {
    const Constraints constraints = testing::fixed_at(domain, 2, {{7, Eigen::RowVector2d(0, 0)}});
    const Matrix expected = ((1 - beta) * (domain.positions().rowwise() - pin)).rowwise() + pin;
    // One pin holds neither energy's rotations, but Tikhonov's gradient does.
    for (const std::string name : {"arap", "larap"}) {
      const Matrix U = minimize(domain, *make(name), {.beta = beta, .regularizer = Regularizer::tikhonov}, constraints,
                                nullptr, {}, 1e-13);
      EXPECT_LT((U - expected).cwiseAbs().maxCoeff(), 1e-9) << name;
    }
    EXPECT_LT((minimize(domain, *make("arap"), {.beta = beta}, constraints) - domain.positions()).cwiseAbs().maxCoeff(),
              1e-12);
  }
}

TEST(PlanarEnergies, RefuseOtherDomains) {
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  EXPECT_THROW(make("asap")->traits(solid), UsageError);
}

}  // namespace
}  // namespace variform
