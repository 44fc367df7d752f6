// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "energies/energies.h"
#include "energies/gradient/poisson.h"
#include "energies/vector_field/vector_field.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "integrators/ode/ode_backends.h"
#include "integrators/shape/deformation_flow.h"
#include "solvers/linear/linear_backends.h"
#include "tests/allocation_count.h"
#include "tests/plain_ldlt.h"

namespace variform {
namespace {

using std::numbers::pi;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;

SpacePoint point(std::initializer_list<double> x) {
  return Eigen::Map<const Vector>(x.begin(), static_cast<Eigen::Index>(x.size()));
}

std::unique_ptr<Energy> make(const std::string& name, const std::map<std::string, ParameterValue>& values = {}) {
  Parameters parameters(energies().find(name).parameters);
  for (const auto& [key, value] : values) parameters.set(key, value);
  return energies().find(name).make(parameters);
}

std::unique_ptr<OdeBackend> integrator(const std::string& name, bool control = true) {
  Parameters parameters(ode_backends().find(name).parameters);
  if (!control) parameters.set("control", false);
  return make_ode_backend(name, parameters);
}

// Irregular meshes.
Domain plane() { return Domain(rectangle_mesh({.width = 2.0, .h = 0.25, .jitter = 0.3})); }
Domain solid() { return Domain(bar_tet_mesh(1.5, 1.0, 0.5, 0.5, 0.2)); }
Domain sheet(const RectangleOptions& options) {
  const Mesh flat = rectangle_mesh(options);
  Mesh mesh{Matrix::Zero(flat.vertex_count(), 3), flat.cells};
  mesh.positions.leftCols(2) = flat.positions;
  return Domain(mesh, DomainKind::surface);
}
Domain bump() { return Domain(bump_mesh({.base = {.h = 0.2, .jitter = 0.3}})); }

template <class Inside>
std::vector<Index> vertices_where(const Domain& domain, const Inside& inside) {
  std::vector<Index> vertices;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (inside(domain.positions().row(v))) vertices.push_back(v);
  }
  return vertices;
}

std::vector<Index> at(const Domain& domain, int axis, double value) {
  return vertices_where(domain, [&](const auto& x) { return std::abs(x[axis] - value) < 1e-9; });
}

// Vertices in general position: the first and last ones, and some between.
std::vector<Index> scattered(const Domain& domain, int count) {
  std::vector<Index> vertices;
  for (int k = 0; k < count; ++k) vertices.push_back((domain.vertex_count() - 1) * k * (k + 1) / (count * (count - 1)));
  return vertices;
}

// A smooth map that is none of an affine shape.
Matrix moved(const Matrix& X) {
  Matrix Y = X;
  for (Eigen::Index v = 0; v < X.rows(); ++v) {
    Y(v, 0) += 0.2 * X(v, 1) * X(v, 1);
    Y(v, 1) += 0.15 * std::sin(1.5 * X(v, 0));
    if (X.cols() == 3) Y(v, 2) += 0.2 * std::cos(2.0 * X(v, 0)) + 0.1 * X(v, 1);
  }
  return Y;
}

Vector state(const Matrix& X) { return Eigen::Map<const Vector>(X.data(), X.size()); }

Eigen::MatrixXd spin(int d) {
  Eigen::MatrixXd A(d, d);
  if (d == 2) {
    A << 0.0, -1.0, 1.0, 0.0;
  } else {
    A << 0.0, -0.6, 0.3, 0.6, 0.0, -0.5, -0.3, 0.5, 0.0;
  }
  return A;
}

struct EnergyCase {
  std::string name;
  std::map<std::string, ParameterValue> parameters = {};
  NormOptions norm = {};
};

std::vector<EnergyCase> isometric_energies(DomainKind kind) {
  std::vector<EnergyCase> cases;
  if (kind == DomainKind::surface) {
    for (const double omega : {0.01, 1.0 / 3.0, 1.0}) cases.push_back({"near_isometric", {}, {.beta = omega}});
    return cases;
  }
  for (const double beta : {0.0, 0.3}) {
    for (const std::string name : {"akvf", "metr", "auth", "phi"}) cases.push_back({name, {}, {.beta = beta}});
  }
  cases.push_back({"akvf", {{"smoothness", "gradient"}}, {.beta = 0.2}});
  cases.push_back({"metr", {{"smoothness", "gradient"}}, {.beta = 0.2}});
  return cases;
}

// Handles that follow v = A x + b, with that field's flow known.
void expect_affine_motion(const Domain& domain, const EnergyCase& of, const Eigen::MatrixXd& A, const SpacePoint& b) {
  SCOPED_TRACE(of.name + " " + to_string(domain.kind()) + " beta " + std::to_string(of.norm.beta));
  const auto energy = make(of.name, of.parameters);
  const auto motion = linear_field(A, b, {0.0, 1.0});
  const auto backend = make_linear_backend("auto");
  DeformationFlow flow(domain, *energy, of.norm, {{.vertices = scattered(domain, 5), .motion = motion}}, 0.0, *backend);
  const auto ode = integrator("odeint.dopri5");
  const Vector y = ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.tolerance = 1e-9});
  ASSERT_TRUE(ode->report().completed) << ode->report().reason;
  const Matrix X = DeformationFlow::positions_of(y, flow.point_size());
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const SpacePoint expected = motion->position(0.0, domain.positions().row(v).transpose(), 1.0);
    ASSERT_LT((X.row(v).transpose() - expected).norm(), 1e-7) << v;
  }
  // The field on the shape where it ended, and its energy by that of a field that is not of the kernel.
  Vector dy(flow.size());
  flow.velocity(1.0, state(X), dy);
  const Matrix expected = (X * A.transpose()).rowwise() + b.transpose();
  EXPECT_LT((flow.velocities() - expected).norm(), 1e-8 * expected.norm());
  EXPECT_LT(flow.energy().total, 1e-15 * flow.problem().value(moved(X)).total);
}

TEST(DeformationFlow, RigidMotionsOfTheHandlesAreReproduced) {
  for (const Domain& domain : {plane(), solid(), bump()}) {
    const int d = domain.ambient_dimension();
    for (const EnergyCase& of : isometric_energies(domain.kind())) {
      expect_affine_motion(domain, of, spin(d), SpacePoint(0.3 * Vector::LinSpaced(d, 1.0, 2.0)));
    }
  }
}

TEST(DeformationFlow, ConformalFieldsReproduceSimilarities) {
  for (const Domain& domain : {plane(), solid()}) {
    const int d = domain.ambient_dimension();
    const Eigen::MatrixXd A = spin(d) + 0.4 * Eigen::MatrixXd::Identity(d, d);
    for (const double beta : {0.0, 0.3}) {
      expect_affine_motion(domain, {"conf", {}, {.beta = beta}}, A, SpacePoint(Vector::Constant(d, 0.2)));
    }
    expect_affine_motion(domain, {"conf", {{"smoothness", "gradient"}}, {.beta = 0.3}}, A,
                         SpacePoint(Vector::Constant(d, 0.2)));
  }
}

// A quarter turn driven by four vertices whose velocities are integrated, as all others are: errors are those of the
// methods (methods: continuous deformation, 3.6).
TEST(DeformationFlow, MethodsHaveTheirOrders) {
  Mesh mesh = rectangle_mesh({.width = 4.0, .h = 0.5, .jitter = 0.2});
  mesh.positions.rowwise() -= Eigen::RowVector2d(2.0, 0.5);
  const Domain domain(mesh);
  const auto metr = make("metr");
  const std::vector<Eigen::MatrixXd> A = {0.5 * pi * spin(2), Eigen::MatrixXd::Zero(2, 2)};
  const MotionPointer turn = polynomial_field(A, {}, {0.0, 1.0});
  ASSERT_FALSE(turn->closed_form());
  const std::vector<Index> corners =
      vertices_where(domain, [](const auto& x) { return std::abs(x[0]) > 1.99 && std::abs(x[1]) > 0.49; });
  ASSERT_EQ(corners.size(), 4U);
  Matrix expected(domain.vertex_count(), 2);
  expected << -domain.positions().col(1), domain.positions().col(0);
  struct Method {
    std::string name;
    double order;
    std::vector<double> errors;  // with 10, 20 and 40 steps, as measured by the specification
  };
  for (const Method& method : {Method{"euler", 1.0, {0.27, 0.13, 0.063}}, Method{"abm3", 3.0, {4.9e-4, 6.5e-5, 8.1e-6}},
                               Method{"rk4", 4.0, {1.7e-5, 1.0e-6, 6.3e-8}}, Method{"odeint.dopri5", 5.0, {}}}) {
    SCOPED_TRACE(method.name);
    std::vector<double> errors;
    for (const int steps : {10, 20, 40}) {
      const auto backend = make_linear_backend("auto");
      DeformationFlow flow(domain, *metr, {}, {{.vertices = corners, .motion = turn}}, 0.0, *backend);
      const bool fixed = method.name == "euler" || method.name == "rk4";
      const auto ode = fixed ? make_ode_backend(method.name) : integrator(method.name, false);
      const Vector y = ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.first_step = 1.0 / steps});
      EXPECT_EQ(ode->report().steps, steps);
      errors.push_back((DeformationFlow::positions_of(y, 2) - expected).rowwise().norm().maxCoeff());
    }
    for (std::size_t k = 0; k < method.errors.size(); ++k) {
      EXPECT_NEAR(errors[k], method.errors[k], 0.1 * method.errors[k]) << k;
    }
    EXPECT_NEAR(std::log2(errors[1] / errors[2]), method.order, 0.12);
  }
}

// Rollers at both ends in x, one vertex held against sliding and, in space, one more against turning.
std::vector<Handle> press(const Domain& domain, double length, double rate) {
  const int d = domain.ambient_dimension();
  SpacePoint velocity = SpacePoint::Zero(d);
  velocity[0] = rate * length;
  const auto corner = [&](double y) {
    return vertices_where(domain,
                          [&](const auto& x) { return x.norm() - std::abs(x[1]) < 1e-9 && std::abs(x[1] - y) < 1e-9; });
  };
  std::vector<Handle> handles = {{.name = "left", .vertices = at(domain, 0, 0.0), .held = {true, false, false}},
                                 {.name = "right",
                                  .vertices = at(domain, 0, length),
                                  .motion = translate(velocity, {0.0, 1.0}),
                                  .held = {true, false, false}},
                                 {.name = "slide", .vertices = corner(0.0), .held = {false, true, true}}};
  if (d == 3) handles.push_back({.name = "turn", .vertices = corner(1.0), .held = {false, false, true}});
  return handles;
}

// Martinez Esturo 2013, sec. 3.4: the lateral stretch in closed form (methods: continuous deformation, 4.9).
TEST(DeformationFlow, CompressionBetweenRollersHasTheLateralStretchOfItsEnergy) {
  struct Case {
    EnergyCase energy;
    double strain, divergence;
  };
  for (const Domain& domain : {plane(), Domain(bar_tet_mesh(2.0, 1.0, 1.0, 0.5, 0.2))}) {
    const int d = domain.ambient_dimension();
    std::vector<Case> cases = {{{"akvf"}, 1.0, 0.0},
                               {{"metr"}, 1.0, 2.0},
                               {{"conf"}, 1.0, -4.0 / d},
                               {{"auth", {{"shear", std::exp2(-9)}}}, std::exp2(-9), 1.0}};
    for (const double phi : {0.3, 1.0, 2.0, largest_phi(d) - 0.05}) {
      for (const double beta : {0.0, 0.3}) {
        cases.push_back({{"phi", {{"phi", phi}}, {.beta = beta}}, std::sin(phi), std::cos(phi)});
      }
      cases.push_back(
          {{"phi", {{"phi", phi}, {"smoothness", "gradient"}}, {.beta = 0.1}}, std::sin(phi), std::cos(phi)});
    }
    for (const Case& of : cases) {
      SCOPED_TRACE(of.energy.name + " " + to_string(domain.kind()) + " " + std::to_string(of.strain));
      const auto energy = make(of.energy.name, of.energy.parameters);
      const auto backend = make_linear_backend("auto");
      DeformationFlow flow(domain, *energy, of.energy.norm, press(domain, 2.0, -0.3), 0.0, *backend);
      const auto ode = integrator("odeint.dopri5");
      const Vector y = ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.tolerance = 1e-8});
      ASSERT_TRUE(ode->report().completed) << ode->report().reason;
      const double kappa = of.divergence / (4.0 * of.strain + (d - 1) * of.divergence);
      Matrix expected = domain.positions();
      expected.col(0) *= 0.7;
      expected.rightCols(d - 1) *= std::pow(0.7, -kappa);
      EXPECT_LT((DeformationFlow::positions_of(y, d) - expected).cwiseAbs().maxCoeff(), 1e-6);
    }
  }
}

// Fails where refreshing the operator, the norm or the energy's own regularizer is left out.
TEST(DeformationFlow, TheFieldIsThatOfAProblemOnTheCurrentShape) {
  for (const Domain& domain : {plane(), solid(), bump()}) {
    const int d = domain.ambient_dimension();
    std::vector<EnergyCase> cases = isometric_energies(domain.kind());
    if (domain.kind() == DomainKind::surface) {
      cases.push_back({"edge_lengths", {}, {.beta = 0.2}});
    } else {
      cases.push_back({"metr", {}, {.beta = 0.9, .facet_weight = FacetWeight::finite_volume}});
      cases.push_back({"conf", {}, {.beta = 0.9}});
    }
    for (const EnergyCase& of : cases) {
      SCOPED_TRACE(of.name + " " + to_string(domain.kind()) + " beta " + std::to_string(of.norm.beta));
      const auto energy = make(of.name, of.parameters);
      const std::vector<Index> still = scattered(domain, 4);
      const Index handle = domain.vertex_count() / 3;
      const SpacePoint velocity = Vector::LinSpaced(d, 1.0, 2.0);
      const auto motion = polynomial_field({}, {velocity, SpacePoint::Zero(d)}, {0.0, 1.0});
      const auto backend = make_linear_backend("auto");
      DeformationFlow flow(domain, *energy, of.norm, {{.vertices = {handle}, .motion = motion}, {.vertices = still}},
                           0.0, *backend);
      Matrix X = moved(domain.positions());
      for (const Index v : still) X.row(v) = domain.positions().row(v);
      Vector dy(flow.size());
      flow.velocity(0.0, flow.rest_state(), dy);
      const Matrix at_rest = flow.velocities();
      flow.velocity(0.5, state(X), dy);
      Constraints constraints(domain.vertex_count(), d);
      for (const Index v : still) constraints.fix(v, Eigen::RowVectorXd::Zero(d));
      constraints.fix(handle, velocity.transpose());
      Domain current = domain;
      current.set_positions(X);
      Problem fresh(current, *energy, of.norm, constraints);
      const auto other = make_linear_backend("auto");
      const Matrix expected = fresh.solve(*other);
      EXPECT_LT((flow.velocities() - expected).norm(), 1e-8 * expected.norm());
      EXPECT_GT((at_rest - expected).norm(), 1e-3 * expected.norm());
      EXPECT_NEAR(flow.energy().total, fresh.value(expected).total, 1e-8 * fresh.value(expected).total);
    }
  }
}

TEST(DeformationFlow, ThousandsOfEvaluationsShareOneAnalysis) {
  const Domain domain(rectangle_mesh({.h = 0.5}));
  const auto metr = make("metr");
  const auto backend = make_linear_backend("auto");
  DeformationFlow flow(domain, *metr, {.beta = 0.1},
                       {{.vertices = at(domain, 0, 0.0)},
                        {.vertices = at(domain, 0, 1.0), .motion = translate(point({0.2, 0.5}), {0.0, 1.0})}},
                       0.0, *backend);
  const auto ode = make_ode_backend("rk4");
  ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.first_step = 1.0 / 500});
  EXPECT_GT(ode->report().evaluations, 1900);
  EXPECT_EQ(backend->report().analyses, 1);
  EXPECT_EQ(backend->report().factorizations, ode->report().evaluations);
}

// Linearity in the velocities of the handles.
TEST(DeformationFlow, ADifferentSpeedSweepsTheSamePath) {
  const Domain domain = plane();
  const auto akvf = make("akvf");
  const MotionPointer turn = rotate(point({2.0, 0.5}), {}, 1.5, {0.0, 1.0});
  const auto path = [&](const MotionPointer& motion, const std::vector<double>& times) {
    const auto backend = make_linear_backend("auto");
    DeformationFlow flow(domain, *akvf, {.beta = 0.2},
                         {{.vertices = at(domain, 0, 0.0)}, {.vertices = at(domain, 0, 2.0), .motion = motion}}, 0.0,
                         *backend);
    std::vector<Vector> states;
    integrator("odeint.dopri5")
        ->integrate(flow, flow.rest_state(), 0.0, 1.0, {.tolerance = 1e-8, .outputs = times},
                    {.output = [&](double, const Vector& y) {
                      states.push_back(y);
                      return true;
                    }});
    return states;
  };
  // Speed 0.2 + 1.6 t, time 0.2 t + 0.8 t^2.
  const std::vector<Vector> slow = path(weighted(turn, {{0.0, 0.2}, {1.0, 1.8}}), {0.25, 0.5, 1.0});
  const std::vector<Vector> plain = path(turn, {0.1, 0.3, 1.0});
  ASSERT_EQ(slow.size(), 3U);
  for (std::size_t k = 0; k < slow.size(); ++k) EXPECT_LT((slow[k] - plain[k]).cwiseAbs().maxCoeff(), 1e-5) << k;
  EXPECT_GT((plain[0] - plain[1]).norm(), 0.1);
}

TEST(DeformationFlow, HandlesAreOnTheirPathsAtTheEndOfEveryStepAndTheDriftIsLogged) {
  const Domain domain = plane();
  const auto akvf = make("akvf");
  const MotionPointer turn = rotate(point({2.0, 0.5}), {}, 0.75 * pi, {0.0, 1.0});
  const std::vector<Index> ends[] = {at(domain, 0, 0.0), at(domain, 0, 2.0)};
  const auto backend = make_linear_backend("auto");
  DeformationFlow flow(domain, *akvf, {}, {{.vertices = ends[0]}, {.vertices = ends[1], .motion = turn}}, 0.0,
                       *backend);
  const auto ode = make_ode_backend("abm3");
  int steps = 0;
  const Vector y = ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.tolerance = 1e-3},
                                  {.step = [&](const OdeStep& step, const Vector& at_end) {
                                    const Matrix X = DeformationFlow::positions_of(at_end, 2);
                                    for (const Index v : ends[0]) EXPECT_EQ(X.row(v), domain.positions().row(v));
                                    for (const Index v : ends[1]) {
                                      const SpacePoint rest = domain.positions().row(v).transpose();
                                      EXPECT_EQ(X.row(v).transpose(), turn->position(0.0, rest, step.time));
                                    }
                                    EXPECT_GT(step.drift, 0.0);
                                    ++steps;
                                    return true;
                                  }});
  EXPECT_GT(steps, 4);
  // Integrated handles miss their paths by what a tolerance of 1e-3 allows.
  EXPECT_GT(ode->report().drift, 1e-5);
  EXPECT_LT(ode->report().drift, 1e-2);
  EXPECT_EQ(flow.handle_error(1.0, DeformationFlow::positions_of(y, 2)), 0.0);
  EXPECT_NEAR(flow.handle_error(0.0, DeformationFlow::positions_of(y, 2)), 2.0 * std::sin(0.375 * pi) * 0.5, 1e-12)
      << "the corners go around the middle of the side";
}

// One vertex is driven out of the triangles or tetrahedra around it, all others stand still.
void expect_event(const Domain& domain, const SpacePoint& velocity, double earliest, double latest,
                  const std::string& what) {
  SCOPED_TRACE(to_string(domain.kind()));
  const auto energy = make(domain.kind() == DomainKind::surface ? "near_isometric" : "akvf");
  const int d = domain.ambient_dimension();
  Index centre = 0;
  const Eigen::RowVectorXd middle =
      0.5 * (domain.positions().colwise().minCoeff().eval() + domain.positions().colwise().maxCoeff().eval());
  (domain.positions().rowwise() - middle).rowwise().norm().minCoeff(&centre);
  std::vector<Index> others;
  for (Index v = 1; v < domain.vertex_count(); ++v) {
    if (v != centre) others.push_back(v);
  }
  const auto backend = make_linear_backend("auto");
  DeformationFlow flow(domain, *energy, {.beta = 0.2},
                       {{.vertices = {centre}, .motion = translate(velocity, {0.0, 1.0})}, {.vertices = others}}, 0.0,
                       *backend);
  for (const std::string name : {"abm3", "rk4"}) {
    const auto ode = make_ode_backend(name);
    const Vector y = ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {});
    const OdeReport& report = ode->report();
    EXPECT_FALSE(report.completed);
    EXPECT_THAT(report.event, HasSubstr(what));
    EXPECT_GT(report.refused, 0);
    EXPECT_GT(report.time, earliest);
    EXPECT_LE(report.time, latest);
    // The cell that is named is one of those around the vertex, and the last state that was good comes back.
    const auto digits = report.event.find_first_of("0123456789");
    ASSERT_NE(digits, std::string::npos) << report.event;
    const auto cell = static_cast<Index>(std::stoi(report.event.substr(digits)));
    EXPECT_TRUE((domain.cells().row(cell).array() == centre).any()) << report.event;
    Domain last = domain;
    EXPECT_NO_THROW(last.set_positions(DeformationFlow::positions_of(y, d)));
  }
}

TEST(DeformationFlow, ACellThatInvertsEndsItWithItsName) {
  expect_event(Domain(rectangle_mesh({.h = 0.25, .tessellation = Tessellation::regular})), point({0.5, 0.0}), 0.49, 0.5,
               "cell ");
  expect_event(Domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5)), point({0.7, 0.0, 0.0}), 0.7, 0.5 / 0.7, "cell ");
}

TEST(DeformationFlow, ATriangleInSpaceThatCollapsesEndsItWithItsName) {
  const Domain flat = sheet({.h = 0.25, .tessellation = Tessellation::regular});
  expect_event(flat, point({0.25, 0.0, 0.0}), 0.999, 1.0, "collapses");
}

// Solves nothing after a number of factorizations.
class Failing final : public LinearBackend {
 public:
  explicit Failing(int good) : LinearBackend("failing"), good_(good) {}
  LinearCapabilities capabilities() const override { return plain_.capabilities(); }

 private:
  void do_analyze() override { plain_.analyze(matrix(), kind()); }
  void do_factorize() override {
    if (good_-- <= 0) fail("cannot");
    plain_.factorize(matrix(), kind());
  }
  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override { plain_.solve(B, X); }

  int good_;
  testing::PlainLdlt plain_;
};

TEST(DeformationFlow, SolvesThatFailAreErrorsAtRestAndRefuseStepsLater) {
  // Handles at the origin: at the first evaluation, inside the interval by the rounding of times, they have moved.
  const Domain domain = plane();
  const std::vector<Handle> handles = {
      {.vertices = vertices_where(domain, [](const auto& x) { return x[0] < 1e-9; }),
       .motion = translate(point({0.1, 0.3}), {0.0, 1.0})},
      {.vertices = vertices_where(domain, [](const auto& x) { return x[0] > 2.0 - 1e-9; })}};
  const auto energy = make("akvf");
  for (const bool continued : {false, true}) {
    SCOPED_TRACE(continued);
    const auto dirichlet = make_poisson(Eigen::MatrixXd(Eigen::MatrixXd::Zero(2, 2)));
    const auto integrate = [&](int good) {
      Failing failing(good);
      testing::PlainLdlt other;
      LinearBackend& velocities = continued ? static_cast<LinearBackend&>(other) : failing;
      DeformationFlow flow(domain, *energy, {}, handles, 0.0, velocities,
                           {.continued_by = continued ? dirichlet.get() : nullptr,
                            .continuation_backend = continued ? &failing : nullptr});
      const auto ode = make_ode_backend("rk4");
      ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.first_step = 0.25, .smallest_step = 0.01});
      return ode->report();
    };
    EXPECT_THROW(integrate(0), SolverError);
    const OdeReport report = integrate(7);
    EXPECT_FALSE(report.completed);
    EXPECT_THAT(report.event, HasSubstr("cannot"));
    EXPECT_EQ(report.steps, 1);
    EXPECT_GT(report.refused, 1);
  }
}

// Asking twice gives the same answer, and good states are good again afterwards.
TEST(DeformationFlow, WhatIsRefusedStaysRefused) {
  for (const Domain& domain : {plane(), solid(), sheet({.h = 0.25})}) {
    SCOPED_TRACE(to_string(domain.kind()));
    const auto energy = make(domain.kind() == DomainKind::surface ? "near_isometric" : "akvf");
    const auto backend = make_linear_backend("auto");
    DeformationFlow flow(domain, *energy, {.beta = 0.2}, {{.vertices = scattered(domain, 5)}}, 0.0, *backend);
    // The first cell with a free corner, that corner drawn to the middle of the others.
    std::vector<bool> held(static_cast<std::size_t>(domain.vertex_count()), false);
    for (const Index v : scattered(domain, 5)) held[static_cast<std::size_t>(v)] = true;
    Index t = 0;
    while (held[static_cast<std::size_t>(domain.cells()(t, 0))]) ++t;
    Matrix X = domain.positions();
    X.row(domain.cells()(t, 0)).setZero();
    for (int i = 1; i < domain.cell_size(); ++i) {
      X.row(domain.cells()(t, 0)) += domain.positions().row(domain.cells()(t, i)) / (domain.cell_size() - 1);
    }
    Vector dy(flow.size());
    for (int k = 0; k < 2; ++k) {
      EXPECT_THAT(flow.refusal(0.5, state(X)), HasSubstr("cell"));
      EXPECT_THROW(flow.velocity(0.5, state(X), dy), StepRefused);
    }
    EXPECT_EQ(flow.refusal(0.5, flow.rest_state()), "");
    EXPECT_NO_THROW(flow.velocity(0.5, flow.rest_state(), dy));
    Vector y = flow.rest_state();
    Index free = 0;
    while (held[static_cast<std::size_t>(free)]) ++free;
    y[free * flow.point_size()] = std::nan("");
    EXPECT_THAT(flow.refusal(0.5, y), HasSubstr("not finite"));
  }
}

TEST(DeformationFlow, SoftHandlesPullAndHardOnesAreTheirLimit) {
  const Domain domain = plane();
  const auto metr = make("metr");
  const std::vector<Index> ends[] = {at(domain, 0, 0.0), at(domain, 0, 2.0)};
  const MotionPointer motion = translate(point({-0.2, 0.6}), {0.0, 1.0});
  const auto velocities = [&](double weight) {
    const auto backend = make_linear_backend("auto");
    DeformationFlow flow(domain, *metr, {}, {{.vertices = ends[0]}, {.vertices = ends[1], .motion = motion}}, 0.0,
                         *backend, {.soft_weight = weight});
    Vector dy(flow.size());
    Matrix X = domain.positions();
    X.col(1) *= 1.1;  // also of the handles: soft ones are where they are
    flow.velocity(0.3, state(X), dy);
    return flow.velocities();
  };
  // The minimizer of energy + weight sum |v - v_handle|^2, on the shape stretched in y.
  Domain stretched = domain;
  Matrix X = domain.positions();
  X.col(1) *= 1.1;
  stretched.set_positions(X);
  Constraints constraints(domain.vertex_count(), 2);
  for (const Index v : ends[0]) constraints.attract(v, Eigen::RowVector2d::Zero(), 0.5);
  for (const Index v : ends[1]) constraints.attract(v, Eigen::RowVector2d(-0.2, 0.6), 0.5);
  Problem fresh(stretched, *metr, {}, constraints);
  const auto backend = make_linear_backend("auto");
  const Matrix expected = fresh.solve(*backend);
  EXPECT_LT((velocities(0.5) - expected).norm(), 1e-9 * expected.norm());
  const double lag = (expected.row(ends[1].front()) - Eigen::RowVector2d(-0.2, 0.6)).norm();
  EXPECT_GT(lag, 0.01);
  for (const Index v : ends[1]) {
    EXPECT_LT((velocities(1e8).row(v) - Eigen::RowVector2d(-0.2, 0.6)).norm(), 1e-6);
    EXPECT_LT((velocities(0.0).row(v) - Eigen::RowVector2d(-0.2, 0.6)).norm(), 1e-14);
  }
}

// The baseline of Martinez Esturo 2013, Figure 9.
TEST(DeformationFlow, BoundaryDiffusionKeepsTheBoundaryAndIsHarmonicInside) {
  const Domain domain = plane();
  const auto akvf = make("akvf");
  const auto dirichlet = make_poisson(Eigen::MatrixXd(Eigen::MatrixXd::Zero(2, 2)));
  const std::vector<Index> middle = {domain.vertex_count() / 2};
  ASSERT_FALSE(domain.boundary_vertices()[middle.front()]);
  const std::vector<Handle> handles = {{.vertices = at(domain, 0, 0.0)},
                                       {.vertices = at(domain, 0, 2.0)},
                                       {.vertices = middle, .motion = translate(point({0.0, 0.5}), {0.0, 1.0})}};
  const auto backend = make_linear_backend("auto");
  const auto other = make_linear_backend("auto");
  const auto third = make_linear_backend("auto");
  DeformationFlow plain(domain, *akvf, {}, handles, 0.0, *third);
  DeformationFlow flow(domain, *akvf, {}, handles, 0.0, *backend,
                       {.continued_by = dirichlet.get(), .continuation_backend = other.get()});
  Vector dy(flow.size()), expected(flow.size());
  const auto ode = make_ode_backend("abm3");
  for (const bool at_rest : {true, false}) {
    const double t = at_rest ? 0.0 : 0.4;
    Matrix X = domain.positions();
    if (!at_rest) X = DeformationFlow::positions_of(ode->integrate(flow, flow.rest_state(), 0.0, t, {}), 2);
    flow.velocity(t, state(X), dy);
    Domain current = domain;
    current.set_positions(X);
    const Matrix v = flow.velocities();
    // Handles of the plain flow are put on their paths; here those inside stay where they drifted to.
    if (at_rest) {
      plain.velocity(t, state(X), expected);
      for (Index i = 0; i < domain.vertex_count(); ++i) {
        if (!domain.boundary_vertices()[i]) continue;
        EXPECT_LT((v.row(i) - plain.velocities().row(i)).norm(), 1e-12);
      }
    }
    Matrix flux = Matrix::Zero(domain.vertex_count(), 2);
    for (Index c = 0; c < domain.cell_count(); ++c) {
      const Eigen::MatrixXd G = current.gradient(c);
      Eigen::MatrixXd local(3, 2);
      for (int i = 0; i < 3; ++i) local.row(i) = v.row(domain.cells()(c, i));
      const Eigen::MatrixXd part = current.cell_measures()[c] * G.transpose() * (G * local);
      for (int i = 0; i < 3; ++i) flux.row(domain.cells()(c, i)) += part.row(i);
    }
    for (Index i = 0; i < domain.vertex_count(); ++i) {
      if (domain.boundary_vertices()[i]) continue;
      EXPECT_LT(flux.row(i).norm(), 1e-12) << i;
    }
    if (!at_rest) {
      // Boundary handles are interpolated, the one inside lags behind by a good part of its way.
      const double behind = 0.2 - (X(middle.front(), 1) - domain.positions()(middle.front(), 1));
      EXPECT_GT(behind, 0.02);
      EXPECT_NEAR(flow.handle_error(t, X), behind, 0.2 * behind);
      EXPECT_LT(ode->report().drift, 1e-12);
      for (const Index i : handles[0].vertices) EXPECT_EQ(X.row(i), domain.positions().row(i));
    }
  }
}

TEST(DeformationFlow, OptionsThatMakeNoSenseAreRefused) {
  const Domain domain = plane();
  const Domain closed(sphere_mesh(1.0, 0.6));
  const auto akvf = make("akvf");
  const auto arap = make("arap");
  const auto surface = make("near_isometric");
  const auto backend = make_linear_backend("auto");
  const auto other = make_linear_backend("auto");
  const auto message = [&](const Domain& on, const Energy& energy, const std::vector<Handle>& handles,
                           const FlowOptions& options) -> std::string {
    try {
      DeformationFlow(on, energy, {.beta = 0.3}, handles, 0.0, *backend, options);
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  };
  const std::vector<Handle> ends = {{.vertices = at(domain, 0, 0.0)}, {.vertices = at(domain, 0, 2.0)}};
  const std::vector<Handle> rollers = {{.vertices = at(domain, 0, 0.0)},
                                       {.vertices = at(domain, 0, 2.0), .held = {true, false, false}}};
  const auto dirichlet = make_poisson(Eigen::MatrixXd(Eigen::MatrixXd::Zero(2, 2)));
  const auto in_space = make_poisson(Eigen::MatrixXd(Eigen::MatrixXd::Zero(3, 3)));
  EXPECT_EQ(message(domain, *akvf, ends, {}), "no error");
  EXPECT_EQ(message(domain, *akvf, rollers, {}), "no error");
  EXPECT_THAT(message(domain, *arap, ends, {}), HasSubstr("not one of velocities"));
  EXPECT_THAT(message(domain, *akvf, {}, {}), ::testing::Not("no error"));
  EXPECT_THAT(message(domain, *akvf, rollers, {.soft_weight = 1.0}), HasSubstr("hold all components"));
  EXPECT_THAT(message(domain, *akvf, ends, {.soft_weight = -1.0}), HasSubstr("weight -1"));
  EXPECT_THAT(message(domain, *akvf, ends, {.soft_weight = std::nan("")}), HasSubstr("weight nan"));
  EXPECT_THAT(message(domain, *akvf, ends, {.continued_by = dirichlet.get()}), HasSubstr("backend of its own"));
  EXPECT_THAT(message(domain, *akvf, ends, {.continued_by = dirichlet.get(), .continuation_backend = backend.get()}),
              HasSubstr("backend of its own"));
  EXPECT_THAT(message(closed, *surface, {{.vertices = {0, 1, 2, 5}}},
                      {.continued_by = in_space.get(), .continuation_backend = other.get()}),
              HasSubstr("without one"));
}

// Tensors of a material turn with the shape: on a turned shape everything is turned.
TEST(DeformationFlow, TensorsAreCarriedAlongWithTheShape) {
  for (const Domain& domain : {plane(), solid()}) {
    const int d = domain.ambient_dimension();
    Eigen::VectorXd axis = Eigen::VectorXd::Zero(d);
    axis.head(2) << 0.8, 0.6;
    const Eigen::MatrixXd B = Eigen::MatrixXd::Identity(d, d) + 9.0 * axis * axis.transpose();
    const Matrix tensors = Eigen::Map<const Eigen::RowVectorXd>(B.data(), d * d).replicate(domain.cell_count(), 1);
    Eigen::MatrixXd Q = Eigen::Rotation2Dd(0.9).toRotationMatrix();
    if (d == 3) Q = Eigen::AngleAxisd(0.9, Eigen::Vector3d(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
    for (const double beta : {0.0, 0.3}) {
      VectorFieldEnergy energy(VectorFieldKind::phi, Vector::Constant(1, 1.0), tensors);
      const std::vector<Index> still = scattered(domain, 4);
      const SpacePoint velocity = Vector::LinSpaced(d, 1.0, 2.0);
      const auto field = [&](const SpacePoint& v, const Matrix& X, bool carried) {
        // Without closed form: handles are where the state has them.
        const auto motion = polynomial_field({}, {v, SpacePoint::Zero(d)}, {0.0, 1.0});
        const auto stop = polynomial_field({}, {SpacePoint::Zero(d), SpacePoint::Zero(d)}, {0.0, 1.0});
        const auto backend = make_linear_backend("auto");
        DeformationFlow flow(
            domain, energy, {.beta = beta},
            {{.vertices = {domain.vertex_count() / 3}, .motion = motion}, {.vertices = still, .motion = stop}}, 0.0,
            *backend);
        if (carried) {
          flow.carry = [&](const Matrix& positions) {
            energy.set_tensors(rotated_tensors(domain, positions, tensors));
          };
        }
        Vector dy(flow.size());
        flow.velocity(0.5, state(X), dy);
        energy.set_tensors(tensors);
        return flow.velocities();
      };
      const Matrix& rest = domain.positions();
      const Matrix expected = field(velocity, rest, true) * Q.transpose();
      const Matrix turned = rest * Q.transpose();
      EXPECT_LT((field(Q * velocity, turned, true) - expected).norm(), 1e-10 * expected.norm());
      EXPECT_GT((field(Q * velocity, turned, false) - expected).norm(), 1e-2 * expected.norm());
    }
  }
}

TEST(DeformationFlow, TheIdentityAsTensorIsIsotropic) {
  const Domain domain = plane();
  const Matrix identity = Eigen::RowVector4d(1.0, 0.0, 0.0, 1.0).replicate(domain.cell_count(), 1);
  Vector ends[2];
  for (const bool tensors : {false, true}) {
    VectorFieldEnergy energy(VectorFieldKind::phi, Vector::Constant(1, 0.8), tensors ? identity : Matrix());
    const auto backend = make_linear_backend("auto");
    DeformationFlow flow(domain, energy, {.beta = 0.2},
                         {{.vertices = at(domain, 0, 0.0)},
                          {.vertices = at(domain, 0, 2.0), .motion = translate(point({-0.3, 0.7}), {0.0, 1.0})}},
                         0.0, *backend);
    if (tensors) {
      flow.carry = [&](const Matrix& X) { energy.set_tensors(rotated_tensors(domain, X, identity)); };
    }
    ends[tensors] = make_ode_backend("rk4")->integrate(flow, flow.rest_state(), 0.0, 1.0, {.first_step = 0.2});
  }
  EXPECT_LT((ends[0] - ends[1]).cwiseAbs().maxCoeff(), 1e-11);
}

TEST(DeformationFlow, AStepAllocatesNothing) {
  for (const Domain& domain : {Domain(rectangle_mesh({.h = 0.25, .jitter = 0.2})), Domain(bar_tet_mesh(1, 1, 1, 0.5)),
                               sheet({.h = 0.25, .jitter = 0.2})}) {
    const int d = domain.ambient_dimension();
    const bool surface = domain.kind() == DomainKind::surface;
    SpacePoint axis, lift = SpacePoint::Zero(d);
    if (d == 3) axis = point({0.0, 1.0, 0.0});
    lift[d - 1] = 0.2;
    const std::vector<Index> right = at(domain, 0, 1.0);
    const SpacePoint centre = domain.positions().row(right.front()).transpose();
    // Turned, moved in parallel with a roller, and by a field that is integrated.
    const std::vector<std::vector<Handle>> handle_sets = {
        {{.vertices = at(domain, 0, 0.0)}, {.vertices = right, .motion = rotate(centre, axis, 0.6, {0.0, 1.0})}},
        {{.vertices = at(domain, 0, 0.0)},
         {.vertices = right, .motion = translate(lift, {0.0, 1.0}), .held = {d == 2, true, d == 3}}},
        {{.vertices = at(domain, 0, 0.0)},
         {.vertices = right,
          .motion = polynomial_field({0.3 * spin(d), 0.1 * spin(d)}, {SpacePoint(0.1 * lift)}, {0.0, 1.0})}}};
    for (std::size_t k = 0; k < handle_sets.size(); ++k) {
      SCOPED_TRACE(to_string(domain.kind()) + " handles " + std::to_string(k));
      const auto energy = make(surface ? "near_isometric" : "metr");
      testing::PlainLdlt backend;
      DeformationFlow flow(domain, *energy, {.beta = 0.2}, handle_sets[k], 0.0, backend);
      const auto ode = make_ode_backend("abm3");
      long before = 0, during = 0;
      int steps = 0;
      const OdeObserver observer = {.step = [&](const OdeStep&, const Vector&) {
        const long now = testing::allocation_count();
        if (++steps > 2) during += now - before;
        before = testing::allocation_count();
        return true;
      }};
      ode->integrate(flow, flow.rest_state(), 0.0, 1.0, {.tolerance = 1e-6}, observer);
      EXPECT_TRUE(ode->report().completed) << ode->report().reason;
      EXPECT_GT(steps, 5);
      EXPECT_EQ(during, 0);
    }
  }
}

// Martinez Esturo 2013, Figure 27; reference values 2.0e-6 L and 0.39 L (methods: continuous deformation, 9.3).
TEST(DeformationFlow, NearIsometricPathsAreReversibleAndStretchingIsNot) {
  const RectangleOptions options = {.width = 3.0, .height = 0.8, .h = 0.1, .tessellation = Tessellation::alternating};
  const auto energy = make("near_isometric");
  const auto back = [&](Domain domain, const MotionPointer& there, double speed_end) {
    const MotionPointer motion = in_sequence({there, reversed(there, {1.0, speed_end})});
    const auto backend = make_linear_backend("auto");
    DeformationFlow flow(
        domain, *energy, {.beta = 1.0 / 3.0},
        {{.vertices = vertices_where(domain, [](const auto& x) { return x[0] < 0.1 + 1e-9; })},
         {.vertices = vertices_where(domain, [](const auto& x) { return x[0] > 2.9 - 1e-9; }), .motion = motion}},
        0.0, *backend);
    const auto ode = make_ode_backend("rk4");
    const Vector y = ode->integrate(flow, flow.rest_state(), 0.0, 2.0, {.first_step = 0.05});
    EXPECT_EQ(ode->report().steps, 20) << ode->report().reason;
    return (DeformationFlow::positions_of(y, 3) - domain.positions()).rowwise().norm().maxCoeff() / 3.0;
  };
  const Domain flat = sheet(options);
  const MotionPointer roll =
      bend(point({0.1, 0.4, 0.0}), point({2.9, 0.4, 0.0}), point({0.0, -1.0, 0.0}), 0.5 * pi, {0.0, 1.0});
  EXPECT_LT(back(flat, roll, 2.0), 1e-5);
  Domain wavy = flat;
  Matrix X = flat.positions();
  for (Index v = 0; v < flat.vertex_count(); ++v) X(v, 2) = 0.02 * std::sin(pi * X(v, 0) / 3.0);
  wavy.set_positions(X);
  EXPECT_GT(back(wavy, translate(point({1.0, 0.0, 0.0}), {0.0, 1.0}), 2.0), 0.1);
}

// Infinitesimal isometries of a flat sheet: without smoothness its normal velocities cost nothing, and rounding alone
// makes the matrix look definite.
TEST(DeformationFlow, MotionsThatCostNothingAreAnErrorAtRest) {
  const Domain flat = sheet({.width = 3.0, .height = 0.8, .h = 0.1});
  const auto energy = make("near_isometric");
  const auto first_velocity = [&](double beta) {
    const auto backend = make_linear_backend("auto");
    DeformationFlow flow(flat, *energy, {.beta = beta},
                         {{.vertices = at(flat, 0, 0.0)},
                          {.vertices = at(flat, 0, 3.0), .motion = translate(point({-0.5, 0.4, 0.0}), {0.0, 1.0})}},
                         0.0, *backend);
    Vector dy(flow.size());
    flow.velocity(0.0, flow.rest_state(), dy);
  };
  EXPECT_THROW(first_velocity(0.0), SolverError);
  EXPECT_NO_THROW(first_velocity(0.1));
}

}  // namespace
}  // namespace variform
