// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "energies/energies.h"
#include "energies/isometric/near_isometric.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "solvers/linear/linear_backends.h"
#include "tests/support.h"

namespace variform {
namespace {

using Eigen::Matrix3d;
using Eigen::RowVector3d;
using Eigen::Vector3d;
using ::testing::HasSubstr;

std::unique_ptr<Energy> make(const std::string& name) {
  const EnergyEntry& entry = energies().find(name);
  return entry.make(Parameters(entry.parameters));
}

Mesh lifted(const Mesh& flat, double height) {
  Mesh mesh{Matrix(flat.vertex_count(), 3), flat.cells};
  for (Index v = 0; v < flat.vertex_count(); ++v) {
    const double x = flat.positions(v, 0);
    const double y = flat.positions(v, 1);
    mesh.positions.row(v) << x, y, height * std::sin(2.0 * x + 0.3) * std::cos(1.0 + 3.0 * y);
  }
  return mesh;
}

// A plane in space: a surface, not a planar domain.
Domain sheet(double height) {
  return Domain(lifted(rectangle_mesh({.h = 0.25, .jitter = 0.3}), height), DomainKind::surface);
}

Domain sphere() { return Domain(sphere_mesh(1.0, 0.7)); }

// Nothing is held: values and matrices only.
Problem free_problem(const Domain& domain, const Energy& energy, double beta) {
  Constraints all(domain.vertex_count(), 3);
  for (Index v = 0; v < domain.vertex_count(); ++v) all.fix(v, RowVector3d::Zero());
  return Problem(domain, energy, {.beta = beta}, all);
}

// Values of the energy and its smoothness.
struct Values {
  double E;
  double S;
};
Values values(const Domain& domain, const Matrix& v, const std::string& name = "near_isometric") {
  const auto energy = make(name);
  const EnergyValue value = free_problem(domain, *energy, 0.5).value(v);
  return {value.plain, value.variation};
}

Index kernel_dimension(const Domain& domain, double beta, const std::string& name = "near_isometric") {
  const auto energy = make(name);
  Problem problem = free_problem(domain, *energy, beta);
  const Vector eigenvalues =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(testing::dense_symmetric(problem.normal_matrix())).eigenvalues();
  return (eigenvalues.array() < 1e-11 * eigenvalues.maxCoeff()).count();
}

Index edge_count(const Domain& domain) {
  return domain.facet_count() + static_cast<Index>(domain.boundary_facets().rows());
}

Matrix rigid_field(const Matrix& positions) {
  const Vector3d spin(0.3, -1.2, 0.7);
  Matrix v(positions.rows(), 3);
  for (Index i = 0; i < positions.rows(); ++i) {
    v.row(i) = spin.cross(Vector3d(positions.row(i).transpose())).transpose() + RowVector3d(1.0, -2.0, 0.5);
  }
  return v;
}

// The integral over a triangle of |f|^2 for f linear with values F at the corners (columns): the exact mass matrix, not
// the midpoint rule.
double integral(double area, const Matrix3d& F) {
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) sum += area / (i == j ? 6.0 : 12.0) * F.col(i).dot(F.col(j));
  }
  return sum;
}

// The rigid field closest to v on a triangle, by least squares with exact integrals: (spin, shift) about the origin.
Eigen::VectorXd least_squares_fit(double area, const Matrix3d& X, const Matrix3d& V) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(6, 6);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(6);
  const auto motion = [&](int k, int corner) {
    if (k >= 3) return Vector3d(Vector3d::Unit(k - 3));
    return Vector3d(Vector3d::Unit(k).cross(Vector3d(X.col(corner))));
  };
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const double w = area / (i == j ? 6.0 : 12.0);
      for (int k = 0; k < 6; ++k) {
        for (int l = 0; l < 6; ++l) A(k, l) += w * motion(k, i).dot(motion(l, j));
        b[k] += w * motion(k, i).dot(V.col(j));
      }
    }
  }
  return A.ldlt().solve(b);
}

Matrix3d corners(const Domain& domain, const Matrix& values, Index t) {
  Matrix3d X;
  for (int i = 0; i < 3; ++i) X.col(i) = values.row(domain.cells()(t, i)).transpose();
  return X;
}

Matrix3d at_corners(const Eigen::VectorXd& rigid, const Matrix3d& X) {
  Matrix3d F;
  for (int i = 0; i < 3; ++i) F.col(i) = Vector3d(rigid.head<3>()).cross(Vector3d(X.col(i))) + rigid.tail<3>();
  return F;
}

TEST(NearIsometric, ThreeExpressionsOfATriangleAgree) {
  for (int sample = 0; sample < 20; ++sample) {
    const Matrix3d X = Matrix3d::Random();
    const auto by_projections = near_isometric_by_projections(X);
    const double scale = by_projections.norm();
    EXPECT_LT((near_isometric_by_strains(X) - by_projections).norm(), 1e-11 * scale);
    EXPECT_LT((near_isometric_by_edges(X) - by_projections).norm(), 1e-11 * scale);
  }
}

TEST(NearIsometric, RigidFitIsTheLeastSquaresOne) {
  for (int sample = 0; sample < 5; ++sample) {
    const Matrix3d X = Matrix3d::Random();
    const Matrix3d V = Matrix3d::Random();
    const double area = 0.5 * Vector3d(X.col(1) - X.col(0)).cross(Vector3d(X.col(2) - X.col(0))).norm();
    const Eigen::VectorXd expected = least_squares_fit(area, X, V);
    const Eigen::Matrix<double, 6, 1> fit = rigid_fit(X) * Eigen::Map<const Eigen::VectorXd>(V.data(), 9);
    EXPECT_LT((fit.head<3>() - expected.head<3>()).norm(), 1e-9);
    const Vector3d at_centroid = Vector3d(expected.head<3>()).cross(Vector3d(X.rowwise().mean())) + expected.tail<3>();
    EXPECT_LT((fit.tail<3>() - at_centroid).norm(), 1e-9);
  }
}

TEST(NearIsometric, EqualsTheIntegralsCellByCell) {
  for (const Domain& domain : {sheet(0.3), sphere(), Domain(bar_surface_mesh(1.0, 0.5, 0.5, 0.25))}) {
    const Matrix v = Matrix::Random(domain.vertex_count(), 3);
    double E = 0.0;
    double by_matrices = 0.0;
    double S = 0.0;
    double edges = 0.0;
    for (Index t = 0; t < domain.cell_count(); ++t) {
      const Matrix3d X = corners(domain, domain.positions(), t);
      const Matrix3d V = corners(domain, v, t);
      const Eigen::VectorXd fit = least_squares_fit(domain.cell_measures()[t], X, V);
      E += integral(domain.cell_measures()[t], V - at_corners(fit, X));
      const Eigen::Map<const Eigen::Matrix<double, 9, 1>> vec(V.data());
      by_matrices += vec.dot(near_isometric_by_edges(X) * vec);
      for (int k = 0; k < 3; ++k) {
        const int a = (k + 1) % 3;
        const int b = (k + 2) % 3;
        edges += std::pow((X.col(b) - X.col(a)).dot(V.col(b) - V.col(a)), 2);
      }
      // Neighbours found here, by shared vertices.
      const std::set<Index> own(domain.cells().row(t).begin(), domain.cells().row(t).end());
      for (Index s = 0; s < domain.cell_count(); ++s) {
        int shared = 0;
        for (int i = 0; i < 3; ++i) shared += own.count(domain.cells()(s, i)) > 0 ? 1 : 0;
        if (shared != 2) continue;
        const Matrix3d Y = corners(domain, domain.positions(), s);
        S += integral(domain.cell_measures()[s], corners(domain, v, s) - at_corners(fit, Y));
      }
    }
    const Values found = values(domain, v);
    EXPECT_NEAR(found.E, E, 1e-11 * E);
    EXPECT_NEAR(by_matrices, E, 1e-11 * E);
    EXPECT_NEAR(found.S, S, 1e-11 * S);
    const Values literature = values(domain, v, "edge_lengths");
    EXPECT_NEAR(literature.E, edges, 1e-11 * edges);
    EXPECT_NEAR(literature.S, S, 1e-11 * S);
    for (const double omega : {0.0, 0.3, 1.0}) {
      const auto energy = make("near_isometric");
      const double total = free_problem(domain, *energy, omega).value(v).total;
      EXPECT_NEAR(total, (1.0 - omega) * E + omega * S, 1e-11 * (E + S));
    }
  }
}

TEST(NearIsometric, DoesNotSeeRigidFields) {
  for (const Domain& domain : {sheet(0.3), sphere()}) {
    const Matrix v = Matrix::Random(domain.vertex_count(), 3);
    const Matrix rigid = rigid_field(domain.positions());
    for (const std::string name : {"near_isometric", "edge_lengths"}) {
      const Values plain = values(domain, v, name);
      const Values moved = values(domain, v + rigid, name);
      EXPECT_NEAR(moved.E, plain.E, 1e-12 * plain.E);
      EXPECT_NEAR(moved.S, plain.S, 1e-12 * plain.S);
    }
  }
}

TEST(NearIsometric, SmoothedKernelIsTheRigidMotionsEvenOnPlanes) {
  const Mesh flap{(Matrix(4, 3) << 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0).finished(),
                  (IndexMatrix(2, 3) << 0, 1, 2, 1, 3, 2).finished()};
  for (const Domain& domain : {sheet(0.0), sheet(0.3), sphere(), Domain(flap, DomainKind::surface)}) {
    for (const double omega : {1e-3, 1.0 / 3.0, 1.0}) EXPECT_EQ(kernel_dimension(domain, omega), 6) << omega;
    EXPECT_EQ(kernel_dimension(domain, 1.0 / 3.0, "edge_lengths"), 6);
  }
}

TEST(NearIsometric, KernelWithoutSmoothnessIsTheInfinitesimalIsometries) {
  // 5 x 6 vertices with 69 edges: 3 * 30 - 69.
  const Domain patch(lifted(rectangle_mesh({.width = 1.25, .h = 0.25, .jitter = 0.3}), 0.4), DomainKind::surface);
  ASSERT_EQ(patch.vertex_count(), 30);
  ASSERT_EQ(edge_count(patch), 69);
  for (const std::string name : {"near_isometric", "edge_lengths"}) {
    EXPECT_EQ(kernel_dimension(patch, 0.0, name), 21) << name;
    EXPECT_EQ(kernel_dimension(sheet(0.0), 0.0, name), sheet(0.0).vertex_count() + 3) << name;
    EXPECT_EQ(kernel_dimension(sphere(), 0.0, name), 6) << name;  // a convex polyhedron is rigid
  }
}

TEST(NearIsometric, VanishesExactlyWhereNoEdgeChangesItsLength) {
  const Domain domain = sheet(0.3);
  const auto energy = make("near_isometric");
  Problem problem = free_problem(domain, *energy, 0.0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(testing::dense_symmetric(problem.normal_matrix()));
  const auto rates = [&](const Matrix& v) {
    double largest = 0.0;
    for (Index t = 0; t < domain.cell_count(); ++t) {
      const Matrix3d V = corners(domain, v, t);
      largest = std::max(
          largest, (edge_rates(corners(domain, domain.positions(), t)) * Eigen::Map<const Eigen::VectorXd>(V.data(), 9))
                       .cwiseAbs()
                       .maxCoeff());
    }
    return largest;
  };
  int zeros = 0;
  for (Eigen::Index k = 0; k < eigen.eigenvalues().size(); ++k) {
    const Eigen::VectorXd column = eigen.eigenvectors().col(k);
    const Matrix v = Eigen::Map<const Matrix>(column.data(), domain.vertex_count(), 3);
    const bool zero = eigen.eigenvalues()[k] < 1e-11 * eigen.eigenvalues().maxCoeff();
    zeros += zero ? 1 : 0;
    if (zero) {
      EXPECT_LT(rates(v), 1e-6);
    } else {
      EXPECT_GT(rates(v), 1e-4);
    }
  }
  EXPECT_EQ(zeros, 3 * domain.vertex_count() - edge_count(domain));
}

Matrix minimizer(const Domain& domain, double beta) {
  const auto energy = make("near_isometric");
  Constraints constraints(domain.vertex_count(), 3);
  constraints.fix(0, RowVector3d(0.1, 0.2, 0.3));
  constraints.fix(domain.vertex_count() / 2, RowVector3d(0.0, -0.4, 0.1));
  constraints.fix(domain.vertex_count() - 1, RowVector3d(0.5, 0.0, 0.0));
  Problem problem(domain, *energy, {.beta = beta}, constraints);
  return problem.solve(*make_linear_backend("eigen.ldlt"));
}

TEST(NearIsometric, MinimizerMovesWithTheMeshFarFromTheOrigin) {
  const Domain domain = sheet(0.3);
  Domain moved = domain;
  Matrix positions = domain.positions();
  positions.rowwise() += 1e6 * domain.diameter() * RowVector3d(0.6, -0.64, 0.48);
  moved.set_positions(positions);
  for (const double omega : {1.0 / 3.0, 1.0}) {
    const Matrix v = minimizer(domain, omega);
    EXPECT_LT((minimizer(moved, omega) - v).norm(), 1e-6 * v.norm());
  }
}

TEST(NearIsometric, RigidConstraintsGiveTheRigidField) {
  for (const Domain& domain : {sheet(0.0), sheet(0.3), sphere()}) {
    const Matrix field = rigid_field(domain.positions());
    Constraints constraints(domain.vertex_count(), 3);
    for (const Index v : {Index{0}, domain.vertex_count() / 2, domain.vertex_count() - 2}) {
      constraints.fix(v, field.row(v));
    }
    const auto energy = make("near_isometric");
    for (const double omega : {0.1, 1.0 / 3.0, 1.0}) {
      Problem problem(domain, *energy, {.beta = omega}, constraints);
      EXPECT_LT((problem.solve(*make_linear_backend("eigen.ldlt")) - field).cwiseAbs().maxCoeff(), 1e-8);
    }
  }
}

// Each triangle cut into four at the midpoints of its edges, put on the unit sphere.
Mesh subdivided(const Mesh& mesh) {
  std::map<std::pair<Index, Index>, Index> middles;
  Mesh fine{mesh.positions, IndexMatrix(4 * mesh.cells.rows(), 3)};
  fine.positions.conservativeResize(mesh.vertex_count() + 3 * mesh.cells.rows() / 2, Eigen::NoChange);
  Index next = mesh.vertex_count();
  const auto middle = [&](Index a, Index b) {
    const auto [at, fresh] = middles.emplace(std::minmax(a, b), next);
    if (fresh) fine.positions.row(next++) = (mesh.positions.row(a) + mesh.positions.row(b)).normalized();
    return at->second;
  };
  for (Index t = 0; t < mesh.cells.rows(); ++t) {
    const Index a = mesh.cells(t, 0);
    const Index b = mesh.cells(t, 1);
    const Index c = mesh.cells(t, 2);
    const Index ab = middle(a, b);
    const Index bc = middle(b, c);
    const Index ca = middle(c, a);
    fine.cells.middleRows(4 * t, 4) << a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca;
  }
  return fine;
}

// E_t goes with (length)^4 strain^2: for the normal field of an icosahedron subdivided on the sphere E times the number
// of triangles is 29.8, 30.6, 30.9 for 320, 1280 and 5120 of them.
TEST(NearIsometric, FallsWithTheNumberOfTriangles) {
  Mesh mesh = subdivided(sphere_mesh(1.0, 1.1));
  ASSERT_EQ(mesh.cells.rows(), 80);
  for (const double expected : {29.8, 30.6, 30.9}) {
    mesh = subdivided(mesh);
    const Domain domain(mesh);
    const auto energy = make("near_isometric");
    const double E = free_problem(domain, *energy, 0.0).value(domain.positions()).plain;
    EXPECT_NEAR(E * domain.cell_count(), expected, 0.05) << domain.cell_count();
  }
}

TEST(NearIsometric, FollowsTheDomainThatMoves) {
  Domain domain = sheet(0.3);
  for (const std::string name : {"near_isometric", "edge_lengths"}) {
    const auto energy = make(name);
    for (const double omega : {1.0 / 3.0, 1.0}) {
      Problem problem = free_problem(domain, *energy, omega);
      problem.normal_matrix();
      Matrix moved = domain.positions();
      moved.col(2) += 0.2 * moved.col(0).cwiseAbs2();
      moved.col(1) *= 1.1;
      domain.set_positions(moved);
      problem.refresh_operator();
      Problem fresh = free_problem(domain, *energy, omega);
      EXPECT_EQ((problem.normal_matrix() - fresh.normal_matrix()).norm(), 0.0);
      const Matrix v = Matrix::Random(domain.vertex_count(), 3);
      EXPECT_EQ(problem.value(v).total, fresh.value(v).total);
    }
  }
}

TEST(NearIsometric, RefusesWhatItCannotDo) {
  const auto message = [](const auto& call) {
    try {
      call();
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("nothing thrown");
  };
  const auto energy = make("near_isometric");
  EXPECT_THAT(message([&] { energy->traits(Domain(rectangle_mesh({.h = 0.5}))); }), HasSubstr("akvf, metr"));
  const Domain domain = sheet(0.3);
  Constraints line(domain.vertex_count(), 3);
  line.fix(0, RowVector3d::Zero());
  line.fix(1, RowVector3d::Zero());
  EXPECT_THAT(message([&] { Problem(domain, *energy, {.beta = 0.5}, line); }), HasSubstr("too few constraints"));
  EXPECT_THAT(message([&] { Problem(domain, *energy, {.beta = 1.5}, line); }), HasSubstr("beta = 1.5"));
  // Three vertices do not hold the infinitesimal isometries.
  line.fix(domain.vertex_count() - 1, RowVector3d(0.0, 0.0, 1.0));
  EXPECT_THAT(message([&] {
                Problem problem(domain, *energy, {.beta = 0.0}, line);
                problem.solve(*make_linear_backend("eigen.llt"));
              }),
              HasSubstr("take beta > 0"));
  EXPECT_NO_THROW(Problem(domain, *energy, {.beta = 1.0}, line));
}

}  // namespace
}  // namespace variform
