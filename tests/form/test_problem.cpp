// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <map>

#include "energies/energies.h"
#include "energies/gradient/poisson.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem_objective.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"
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

// Every third boundary vertex at a value of its own.
Constraints some_fixed(const Domain& domain, int d) {
  Constraints constraints(domain.vertex_count(), d);
  for (Index v = 0; v < domain.vertex_count(); v += 3) {
    if (domain.boundary_vertices()[v]) constraints.fix(v, Eigen::RowVectorXd::Random(d));
  }
  return constraints;
}

// The minimizer of x'A x - 2 b'x, one column at a time, with rows of x given where constraints fix vertices.
Eigen::MatrixXd dense_minimizer(const Eigen::MatrixXd& A, const Eigen::MatrixXd& b, const Constraints& constraints) {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(b.rows(), b.cols());
  std::vector<bool> fixed(b.rows(), false);
  for (const auto& value : constraints.fixed()) {
    x.row(value.vertex) = value.value;
    fixed[value.vertex] = true;
  }
  std::vector<Index> free;
  for (Index v = 0; v < b.rows(); ++v) {
    if (!fixed[v]) free.push_back(v);
  }
  const Eigen::MatrixXd A_free = A(free, free);
  const Eigen::MatrixXd right = (b - A * x)(free, Eigen::all);
  const Eigen::MatrixXd x_free = A_free.ldlt().solve(right);
  x(free, Eigen::all) = x_free;
  return x;
}

// r_v = u_v - c_v at every vertex: fits a field of k columns to given values.
class VertexFit final : public Energy {
 public:
  explicit VertexFit(const Matrix& values) : values_(values) {}
  EnergyTraits traits(const Domain&) const override {
    return {.residuals = 1,
            .unknowns = 1,
            .columns = static_cast<int>(values_.cols()),
            .kernel = Kernel::trivial,
            .support = Support::vertices};
  }
  Form declare(const Domain& domain) const override {
    IndexMatrix sites(domain.vertex_count(), 1);
    for (Index v = 0; v < domain.vertex_count(); ++v) sites(v, 0) = v;
    Form form(domain.vertex_count(), sites, 1, 1, static_cast<int>(values_.cols()));
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      form.block(v)(0, 0) = 1.0;
      form.target(v) = values_.row(v);
    }
    return form;
  }
  void refresh_operator(const Domain&, Form&) const override {}

 private:
  Matrix values_;
};

class VertexProblem : public ::testing::Test {
 protected:
  std::vector<Domain> domains_ = {Domain(rectangle_mesh({.width = 2.0, .h = 0.25, .jitter = 0.3})),
                                  Domain(bar_surface_mesh(2.0, 1.0, 1.0, 0.5)),
                                  Domain(bar_tet_mesh(2.0, 1.0, 1.0, 0.5))};
};

TEST_F(VertexProblem, PassesTheSuiteOfEnergies) {
  for (const Domain& domain : {domains_[0], domains_[2]}) {
    testing::check_energy("positions on " + to_string(domain.kind()), VertexFit(domain.positions()), domain, true);
    testing::check_energy("values on " + to_string(domain.kind()), VertexFit(Matrix::Random(domain.vertex_count(), 1)),
                          domain, false);
  }
}

TEST_F(VertexProblem, SolvesTheBlendOfMassAndLaplacian) {
  for (const Domain& domain : domains_) {
    const Matrix c = Matrix::Random(domain.vertex_count(), 2);
    const VertexFit energy(c);
    Constraints constraints(domain.vertex_count(), 2);
    for (Index v = 0; v < domain.vertex_count(); v += 5) constraints.fix(v, Eigen::RowVector2d::Random());
    const Eigen::MatrixXd M = mass_matrix(domain);
    const Eigen::MatrixXd L = cotangent_laplacian(domain);
    for (const FacetWeight weight : kWeights) {
      const double s = weight == FacetWeight::facet_measure
                           ? 1.0
                           : std::pow(domain.total_measure(), 2.0 / domain.intrinsic_dimension());
      for (const double beta : {0.0, 0.3, 0.9}) {
        SCOPED_TRACE(to_string(domain.kind()) + " " + to_string(weight) + " " + std::to_string(beta));
        const Eigen::MatrixXd W = (1.0 - beta) * M + beta * s * L;
        Problem problem(domain, energy, {beta, weight}, constraints);
        const auto backend = make_linear_backend("eigen.ldlt");
        const Matrix U = problem.solve(*backend);
        EXPECT_LT((U - dense_minimizer(W, W * c, constraints)).cwiseAbs().maxCoeff(), 1e-11);
        const Eigen::MatrixXd r = U - c;
        const EnergyValue value = problem.value(U);
        EXPECT_NEAR(value.plain, (r.transpose() * M * r).trace(), 1e-12 * value.plain);
        EXPECT_NEAR(value.total, (r.transpose() * W * r).trace(), 1e-12 * value.total);
        if (beta > 0.0) {
          const double variation = s * (r.transpose() * L * r).trace();
          EXPECT_NEAR(value.variation, variation, 1e-11 * variation);
        }
      }
    }
  }
}

// min (1-beta) |u - c|^2_M + beta int |grad u|^2: implicit smoothing of c.
TEST_F(VertexProblem, TikhonovSmoothsTheField) {
  for (const Domain& domain : domains_) {
    SCOPED_TRACE(to_string(domain.kind()));
    const Matrix c = Matrix::Random(domain.vertex_count(), 2);
    const VertexFit energy(c);
    Constraints constraints(domain.vertex_count(), 2);
    constraints.fix(3, Eigen::RowVector2d(0.3, -0.2));
    const Eigen::MatrixXd M = mass_matrix(domain);
    const Eigen::MatrixXd L = cotangent_laplacian(domain);
    const double beta = 0.2;
    Problem problem(domain, energy, {.beta = beta, .regularizer = Regularizer::tikhonov}, constraints);
    const auto backend = make_linear_backend("eigen.ldlt");
    const Matrix U = problem.solve(*backend);
    const Eigen::MatrixXd expected = dense_minimizer((1.0 - beta) * M + beta * L, (1.0 - beta) * M * c, constraints);
    EXPECT_LT((U - expected).cwiseAbs().maxCoeff(), 1e-11);
    const Eigen::MatrixXd r = U - c;
    const Eigen::MatrixXd u = U;
    const EnergyValue value = problem.value(U);
    EXPECT_NEAR(value.plain, (r.transpose() * M * r).trace(), 1e-12 * value.plain);
    EXPECT_NEAR(value.variation, (u.transpose() * L * u).trace(), 1e-12 * value.variation);
    EXPECT_NEAR(value.total, (1.0 - beta) * value.plain + beta * value.variation, 1e-12 * value.total);
  }
}

// Orthonormal tangent frame of each cell, its first vector along the first edge turned by an angle that is different on
// every cell; cells x 2p.
Matrix edge_frames(const Domain& domain) {
  const int p = domain.ambient_dimension();
  Matrix frames(domain.cell_count(), 2 * p);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const auto x = [&](int i) { return Eigen::VectorXd(domain.positions().row(domain.cells()(t, i)).transpose()); };
    const Eigen::VectorXd along = (x(1) - x(0)).normalized();
    const Eigen::VectorXd rest = x(2) - x(0);
    const Eigen::VectorXd across = (rest - along * along.dot(rest)).normalized();
    const double angle = 1.7 * t + 0.4;
    frames.row(t).head(p) = std::cos(angle) * along + std::sin(angle) * across;
    frames.row(t).tail(p) = -std::sin(angle) * along + std::cos(angle) * across;
  }
  return frames;
}

// Gradient fit with the components of gradients in frames of the cells: r_t = B_t (G_t u_t) - h_t.
class FrameGradientFit final : public CellEnergy {
 public:
  // guidance: cells x 2k, row t is vec of the 2 x k matrix of wanted gradients in the frame of t.
  explicit FrameGradientFit(const Matrix& guidance) : guidance_(guidance) {}
  EnergyTraits traits(const Domain&) const override {
    return {.residuals = 2,
            .unknowns = 1,
            .columns = static_cast<int>(guidance_.cols()) / 2,
            .kernel = Kernel::constants,
            .gauge = Gauge::cell_frame};
  }
  Matrix frames(const Domain& domain) const override { return edge_frames(domain); }
  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    const Matrix all = edge_frames(domain);
    const Eigen::Map<const Matrix> B(all.row(t).data(), 2, domain.ambient_dimension());
    E = B * domain.gradient(t);
  }
  bool target(const Domain&, Index t, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const override {
    c = Eigen::Map<const Eigen::MatrixXd>(guidance_.row(t).data(), 2, c.cols());
    return true;
  }

 private:
  Matrix guidance_;
};

// The same guidance in the frames of the cells instead of the world.
Matrix in_frames(const Domain& domain, const Matrix& world) {
  const auto k = world.cols() / 2;
  const Matrix frames = edge_frames(domain);
  Matrix local(world.rows(), world.cols());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::Map<const Matrix> B(frames.row(t).data(), 2, 2);
    const Eigen::MatrixXd h = B * Eigen::Map<const Eigen::MatrixXd>(world.row(t).data(), 2, k);
    local.row(t) = Eigen::Map<const Eigen::RowVectorXd>(h.data(), h.size());
  }
  return local;
}

TEST(CellFrames, GiveWhatTheWorldGivesInThePlane) {
  const Domain domain(rectangle_mesh({.h = 0.2, .jitter = 0.3}));
  const Matrix guidance = Matrix::Random(domain.cell_count(), 4);
  const auto in_world = make_poisson(guidance, 2);
  const FrameGradientFit in_cells(in_frames(domain, guidance));
  const Constraints constraints = some_fixed(domain, 2);
  const Matrix any = Matrix::Random(domain.vertex_count(), 2);
  for (const FacetWeight weight : kWeights) {
    for (const double beta : {0.0, 0.3, 0.9}) {
      SCOPED_TRACE(to_string(weight) + " " + std::to_string(beta));
      Problem world(domain, *in_world, {beta, weight}, constraints);
      Problem cells(domain, in_cells, {beta, weight}, constraints);
      const auto backend = make_linear_backend("eigen.ldlt");
      const Matrix expected = world.solve(*backend);
      EXPECT_LT((cells.solve(*backend) - expected).cwiseAbs().maxCoeff(), 1e-11);
      for (const Matrix& U : {expected, any}) {
        const EnergyValue a = world.value(U);
        const EnergyValue b = cells.value(U);
        EXPECT_NEAR(b.total, a.total, 1e-12 * a.total);
        EXPECT_NEAR(b.plain, a.plain, 1e-12 * a.plain);
        if (beta > 0.0) {
          EXPECT_NEAR(b.variation, a.variation, 1e-11 * a.variation);
        }
      }
    }
  }
}

// Frames see only what is intrinsic: a sheet folded along a line of its mesh solves the problem of the flat one.
TEST(CellFrames, GiveTheSameOnAFoldedSheetAsOnTheFlatOne) {
  const Mesh flat = rectangle_mesh({.width = 2.0, .h = 0.25});
  Mesh folded{Matrix(flat.vertex_count(), 3), flat.cells};
  for (Index v = 0; v < flat.vertex_count(); ++v) {
    const double x = flat.positions(v, 0);
    const double beyond = std::max(0.0, x - 1.0);
    folded.positions.row(v) << x - beyond + std::cos(1.2) * beyond, flat.positions(v, 1), std::sin(1.2) * beyond;
  }
  const Domain plane(flat);
  const Domain sheet(folded);
  const Matrix guidance = Matrix::Random(plane.cell_count(), 4);
  const Constraints constraints = some_fixed(plane, 2);
  const NormOptions norm{.beta = 0.5};
  const auto in_world = make_poisson(guidance, 2);
  const FrameGradientFit in_cells(in_frames(plane, guidance));
  Problem on_plane(plane, *in_world, norm, constraints);
  Problem on_sheet(sheet, in_cells, norm, constraints);
  const auto backend = make_linear_backend("eigen.ldlt");
  const Matrix U = on_plane.solve(*backend);
  EXPECT_LT((on_sheet.solve(*backend) - U).cwiseAbs().maxCoeff(), 1e-11);
  EXPECT_NEAR(on_sheet.value(U).total, on_plane.value(U).total, 1e-12 * on_plane.value(U).total);
}

// An energy with a regularizer of its own: jumps of u along interior facets, weighted by their measures.
class SelfRegularized final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    return {.residuals = domain.ambient_dimension(), .unknowns = 1, .columns = 2, .kernel = Kernel::constants};
  }
  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }
  bool target(const Domain&, Index t, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const override {
    c.setConstant(std::sin(t));
    return true;
  }
  std::optional<Term> regularizer(const Domain& domain, const NormOptions&) const override {
    Form form(domain.vertex_count(), domain.facet_vertices(), 1, 1, 2);
    refresh_regularizer(domain, form);
    return Term{std::move(form), diagonal_norm(Vector::Ones(domain.facet_count()))};
  }
  void refresh_regularizer(const Domain& domain, Form& form) const override {
    for (Index f = 0; f < domain.facet_count(); ++f) {
      const double root = 1.0 / std::sqrt(domain.facet_measures()[f]);
      form.block(f) << root, -root;
    }
  }
};

class MovedDomain : public ::testing::Test {
 protected:
  // A problem on the domain before it moves, refreshed after, is the one built on the moved domain.
  void expect_as_built_afresh(const Energy& energy, const NormOptions& norm) {
    Domain domain(rectangle_mesh({.width = 2.0, .h = 0.25, .jitter = 0.3}));
    const Constraints constraints = some_fixed(domain, 2);
    Problem problem(domain, energy, norm, constraints);
    const auto backend = make_linear_backend("eigen.ldlt");
    const Matrix before = problem.solve(*backend);

    Matrix moved = domain.positions();
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      const double x = moved(v, 0);
      const double y = moved(v, 1);
      moved.row(v) << 1.5 * x + 0.2 * std::sin(2.0 * y), 0.8 * y + 0.3 * x * x;
    }
    domain.set_positions(moved);
    problem.refresh_operator();
    problem.refresh_target(moved);
    const Matrix after = problem.solve(*backend);
    EXPECT_EQ(backend->report().analyses, 1);
    EXPECT_EQ(backend->report().factorizations, 2);
    EXPECT_GT((after - before).cwiseAbs().maxCoeff(), 1e-3) << "the move should matter";

    Problem fresh(domain, energy, norm, constraints);
    fresh.refresh_target(moved);
    const auto another = make_linear_backend("eigen.ldlt");
    EXPECT_LT((after - fresh.solve(*another)).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_EQ((problem.normal_matrix() - fresh.normal_matrix()).norm(), 0.0);
    EXPECT_EQ(problem.normal_right_hand_side(), fresh.normal_right_hand_side());
    const EnergyValue a = problem.value(before);
    const EnergyValue b = fresh.value(before);
    EXPECT_EQ(a.total, b.total);
    EXPECT_EQ(a.plain, b.plain);
    EXPECT_EQ(a.variation, b.variation);
  }
};

TEST_F(MovedDomain, IsSeenByTheNormOfTheEnergy) {
  for (const FacetWeight weight : kWeights) {
    for (const std::string name : {"larap", "asap", "arap", "poisson"}) {
      SCOPED_TRACE(name + " " + to_string(weight));
      expect_as_built_afresh(*make(name), {.beta = 0.4, .facet_weight = weight});
    }
  }
}

TEST_F(MovedDomain, IsSeenByVertexResiduals) {
  const Domain domain(rectangle_mesh({.width = 2.0, .h = 0.25}));
  expect_as_built_afresh(VertexFit(Matrix::Random(domain.vertex_count(), 2)), {.beta = 0.4});
}

TEST_F(MovedDomain, IsSeenByARegularizerOfTheEnergy) { expect_as_built_afresh(SelfRegularized(), {.beta = 0.4}); }

TEST(Problem, TakesWeightOneForARegularizerOfTheEnergyOnly) {
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  Constraints constraints(domain.vertex_count(), 2);  // corners are on no interior facet
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.boundary_vertices()[v]) constraints.fix(v, Eigen::RowVector2d::Random());
  }
  const auto backend = make_linear_backend("eigen.ldlt");
  const SelfRegularized own;
  Problem problem(domain, own, {.beta = 0.4}, constraints);
  problem.solve(*backend);
  problem.set_beta(1.0);
  const Matrix U = problem.solve(*backend);
  Problem fresh(domain, own, {.beta = 1.0}, constraints);
  EXPECT_EQ((problem.normal_matrix() - fresh.normal_matrix()).norm(), 0.0);
  EXPECT_LT((fresh.solve(*backend) - U).norm(), 1e-12 * U.norm());
  const EnergyValue value = problem.value(U);
  EXPECT_EQ(value.total, value.variation);
  EXPECT_THROW(problem.set_beta(1.1), UsageError);
  EXPECT_EQ(problem.beta(), 1.0);

  const auto larap = make("larap");
  EXPECT_THROW(Problem(domain, *larap, {.beta = 1.0}, constraints), UsageError);
  Problem without(domain, *larap, {.beta = 0.4}, constraints);
  EXPECT_THROW(without.set_beta(1.0), UsageError);
  EXPECT_EQ(without.beta(), 0.4);
  EXPECT_THROW(Problem(domain, own, {.beta = 1.0, .regularizer = Regularizer::tikhonov}, constraints), UsageError);
  EXPECT_THROW(Problem(domain, own, {.beta = std::nan("")}, constraints), UsageError);
}

TEST_F(MovedDomain, IsSeenByTikhonov) {
  for (const std::string name : {"larap", "arap"}) {
    SCOPED_TRACE(name);
    expect_as_built_afresh(*make(name), {.beta = 0.4, .regularizer = Regularizer::tikhonov});
  }
}

// The frames turn with the first edges of their cells, hence the transports between them change.
TEST_F(MovedDomain, IsSeenByTransports) {
  const Domain domain(rectangle_mesh({.width = 2.0, .h = 0.25}));
  expect_as_built_afresh(FrameGradientFit(Matrix::Random(domain.cell_count(), 4)), {.beta = 0.4});
}

// Every rotation is as close to a reflection as any other.
TEST(UndefinedTargets, StayWhatTheyWereAndAreCounted) {
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  const auto energy = make("arap");
  Problem problem(domain, *energy, {.beta = 0.3}, some_fixed(domain, 2));
  const double angle = 0.7;
  Eigen::Matrix2d Q;
  Q << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);  // x -> x Q on rows
  const Matrix turned = domain.positions() * Q;
  EXPECT_EQ(problem.refresh_target(turned), 0);

  const Index reflected = domain.cell_count() / 2;
  Matrix U = domain.positions();
  for (int i = 0; i < 3; ++i)
    U(domain.cells()(reflected, i), 0) = 1.1 - domain.positions()(domain.cells()(reflected, i), 0);
  EXPECT_EQ(problem.refresh_target(U), 1);
  EXPECT_EQ(problem.refresh_target(U), 1);  // of this state already
  const Form& form = problem.terms().front().form;
  EXPECT_LT((form.target(reflected) - Q).cwiseAbs().maxCoeff(), 1e-13);
  // The others have the closest rotation of U: S makes S' F symmetric with positive trace.
  for (Index t = 0; t < domain.cell_count(); ++t) {
    if (t == reflected) continue;
    const Eigen::Matrix2d F = deformation(domain, t, U);
    const Eigen::Matrix2d S = form.target(t);
    const Eigen::Matrix2d P = S.transpose() * F;
    EXPECT_NEAR(P(0, 1), P(1, 0), 1e-12 * F.norm());
    EXPECT_GT(P.trace(), 0.0);
    EXPECT_LT((S.transpose() * S - Eigen::Matrix2d::Identity()).norm(), 1e-13);
  }

  const auto backend = make_linear_backend("eigen.ldlt");
  ProblemObjective objective(problem, *backend);
  objective.value(turned);
  EXPECT_EQ(objective.undefined_targets(), 0);
  objective.value(U);
  EXPECT_EQ(objective.undefined_targets(), 1);
}

// (s E, s c) in place of (E, c).
class Scaled final : public Energy {
 public:
  Scaled(std::unique_ptr<Energy> energy, double scale) : energy_(std::move(energy)), scale_(scale) {}
  EnergyTraits traits(const Domain& domain) const override { return energy_->traits(domain); }
  Form declare(const Domain& domain) const override {
    Form form = energy_->declare(domain);
    for (Index s = 0; s < form.site_count(); ++s) {
      form.block(s) *= scale_;
      form.target(s) *= scale_;
    }
    return form;
  }
  void refresh_operator(const Domain&, Form&) const override { FAIL() << "the domain does not move"; }

 private:
  std::unique_ptr<Energy> energy_;
  double scale_;
};

TEST(Problem, ScaledResidualHasTheSameMinimizer) {
  const Domain domain(rectangle_mesh({.h = 0.2, .jitter = 0.3}));
  Constraints constraints = some_fixed(domain, 2);
  const Index interior = 14;
  ASSERT_FALSE(domain.boundary_vertices()[interior]);
  constraints.attract(interior, Eigen::RowVector2d(0.9, 0.1));  // the default weight is relative to the energy
  const auto backend = make_linear_backend("eigen.ldlt");
  for (const std::string name : {"larap", "asap", "poisson", "arap"}) {
    for (const double beta : {0.0, 0.4}) {
      const auto energy = make(name);
      Problem problem(domain, *energy, {.beta = beta}, constraints);
      const Matrix U = problem.solve(*backend);
      for (const double scale : {1e-3, -40.0}) {
        const Scaled scaled(make(name), scale);
        Problem other(domain, scaled, {.beta = beta}, constraints);
        EXPECT_LT((other.solve(*backend) - U).cwiseAbs().maxCoeff(), 1e-11) << name << " " << beta << " " << scale;
        const double expected = scale * scale * problem.value(U).total;
        EXPECT_NEAR(other.value(U).total, expected, 1e-12 * expected) << name;
      }
    }
  }
}

#ifdef VARIFORM_TEST_SUITESPARSE
TEST(Problem, HandlesComeMoveAndGoWithoutANewFactorization) {
  const auto backend_name = "cholmod.simplicial";
  const Domain domain(rectangle_mesh({.width = 2.0, .height = 1.0, .h = 0.125, .jitter = 0.2}));
  for (const char* name : {"asap", "arap"}) {  // coordinates coupled, and columns
    const auto energy = make(name);
    Constraints constraints(domain.vertex_count(), 2);
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (domain.positions()(v, 0) == 0.0) constraints.fix(v, domain.positions().row(v));
    }
    const auto backend = make_linear_backend(backend_name);
    Problem problem(domain, *energy, {.beta = 0.3}, constraints);
    problem.refresh_target(domain.positions());
    problem.solve(*backend);
    std::map<Index, Eigen::RowVectorXd> handles;
    const auto expect_as_afresh = [&] {
      Constraints all = constraints;
      for (const auto& [vertex, value] : handles) all.fix(vertex, value);
      Problem fresh(domain, *energy, {.beta = 0.3}, all);
      fresh.refresh_target(domain.positions());
      const Matrix expected = fresh.solve(*make_linear_backend(backend_name));
      EXPECT_LT((problem.solve(*backend) - expected).norm(), 1e-10 * expected.norm()) << name;
    };
    const auto hold = [&](Index vertex, double x, double y) {
      handles[vertex] = Eigen::RowVector2d(x, y);
      problem.hold(vertex, handles[vertex]);
    };
    hold(60, 1.2, 0.9);
    expect_as_afresh();
    hold(100, 2.5, 0.3);
    hold(60, 1.0, 0.7);
    expect_as_afresh();
    problem.release(60);
    handles.erase(60);
    expect_as_afresh();
    problem.release(100);
    handles.erase(100);
    expect_as_afresh();
    EXPECT_EQ(backend->report().factorizations, 1) << name;
    hold(40, 0.5, 0.5);
    problem.set_beta(0.5);  // factorizes, and holds again
    problem.refresh_target(domain.positions());
    Constraints all = constraints;
    all.fix(40, handles.at(40));
    Problem fresh(domain, *energy, {.beta = 0.5}, all);
    fresh.refresh_target(domain.positions());
    EXPECT_LT((problem.solve(*backend) - fresh.solve(*backend)).norm(), 1e-9) << name;

    EXPECT_THROW(problem.release(41), UsageError);
    EXPECT_THROW(problem.hold(0, Eigen::RowVector2d(0.0, 0.0)), UsageError);  // fixed
    EXPECT_THROW(problem.hold(41, Eigen::RowVector3d(0.0, 0.0, 0.0)), UsageError);
    EXPECT_THROW(problem.hold(domain.vertex_count(), Eigen::RowVector2d(0.0, 0.0)), UsageError);
    EXPECT_THROW(problem.solve(*make_linear_backend("eigen.ldlt")), UsageError);  // cannot update
  }
}
#endif

// Dense, and its first change of a factorization fails.
class FailsOnce final : public LinearBackend {
 public:
  FailsOnce() : LinearBackend("fails once") {}
  LinearCapabilities capabilities() const override { return {.spd = true, .update = true}; }

 protected:
  void do_analyze() override {}
  void do_factorize() override { dense_ = testing::dense_symmetric(matrix()); }
  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override { X = dense_.llt().solve(B); }
  void do_hold(Index unknown) override {
    if (!failed_) {
      failed_ = true;
      fail("broken on purpose");
    }
    dense_.row(unknown).setZero();
    dense_.col(unknown).setZero();
    dense_(unknown, unknown) = 1.0;
  }

 private:
  Eigen::MatrixXd dense_;
  bool failed_ = false;
};

TEST(Problem, SolvesAgainAfterAHandleThatCouldNotBeHeld) {
  const Domain domain(rectangle_mesh({.h = 0.25, .jitter = 0.2}));
  const auto energy = make("asap");
  const Constraints constraints = some_fixed(domain, 2);
  Problem problem(domain, *energy, {}, constraints);
  FailsOnce backend;
  problem.solve(backend);
  Index handle = 0;
  const auto is_fixed = [&](Index v) {
    return std::any_of(constraints.fixed().begin(), constraints.fixed().end(),
                       [v](const Constraints::Value& fixed) { return fixed.vertex == v; });
  };
  while (is_fixed(handle)) ++handle;
  const Eigen::RowVector2d value(0.3, 0.4);
  problem.hold(handle, value);
  EXPECT_THROW(problem.solve(backend), SolverError);
  Constraints all = constraints;
  all.fix(handle, value);
  Problem fresh(domain, *energy, {}, all);
  EXPECT_LT((problem.solve(backend) - fresh.solve(*make_linear_backend("eigen.ldlt"))).norm(), 1e-10);
}

// W is a matter of the domain, beta and the facet weight alone.
TEST(Problem, EnergiesShareTheNorm) {
  const Domain domain(rectangle_mesh({.h = 0.2, .jitter = 0.3}));
  const Constraints constraints = some_fixed(domain, 2);
  for (const FacetWeight weight : kWeights) {
    const NormOptions options{.beta = 0.4, .facet_weight = weight};
    const Eigen::MatrixXd expected = cell_norm(domain, options)->matrix();
    for (const std::string name : {"arap", "asap", "larap", "poisson"}) {
      const auto energy = make(name);
      const Problem problem(domain, *energy, options, constraints);
      ASSERT_EQ(problem.terms().size(), 1U) << name;
      EXPECT_EQ(Eigen::MatrixXd(problem.terms().front().norm->matrix()), expected) << name;
    }
  }
}

}  // namespace
}  // namespace variform
