// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>

#include "framework/base/error.h"
#include "framework/domain/domain.h"
#include "framework/domain/generators.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

Mesh bump(double h) {
  const Mesh flat = rectangle_mesh({.h = h, .jitter = 0.2});
  Mesh mesh{Matrix(flat.positions.rows(), 3), flat.cells};
  for (Index v = 0; v < flat.vertex_count(); ++v) {
    const double x = flat.positions(v, 0);
    const double y = flat.positions(v, 1);
    mesh.positions.row(v) << x, y, 0.3 * std::exp(-10.0 * ((x - 0.5) * (x - 0.5) + (y - 0.5) * (y - 0.5)));
  }
  return mesh;
}

std::vector<Domain> all_kinds() {
  return {Domain(rectangle_mesh({.h = 0.2, .jitter = 0.3})), Domain(bump(0.1)),
          Domain(bar_tet_mesh(2.0, 1.0, 1.0, 0.5))};
}

TEST(Domain, KindFollowsFromTheMesh) {
  const std::vector<Domain> domains = all_kinds();
  EXPECT_EQ(domains[0].kind(), DomainKind::planar);
  EXPECT_EQ(domains[1].kind(), DomainKind::surface);
  EXPECT_EQ(domains[2].kind(), DomainKind::tetrahedral);
}

TEST(Domain, FlatMeshesOfAnyAxisArePlanar) {
  const Mesh flat = rectangle_mesh({.width = 2.0, .h = 0.25});
  for (const int axis : {0, 1, 2}) {
    Mesh mesh{Matrix::Constant(flat.positions.rows(), 3, 0.7), flat.cells};
    mesh.positions.col(axis == 0 ? 1 : 0) = flat.positions.col(0);
    mesh.positions.col(axis == 2 ? 1 : 2) = flat.positions.col(1);
    const Domain domain(mesh);
    EXPECT_EQ(domain.kind(), DomainKind::planar) << axis;
    EXPECT_EQ(domain.positions(), flat.positions) << axis;
    mesh.positions(3, axis) += 1e-6;
    EXPECT_EQ(Domain(mesh).kind(), DomainKind::surface) << axis;
  }
}

TEST(Domain, GradientsReproduceAffineFunctionsAndKillConstants) {
  for (const Domain& domain : all_kinds()) {
    const int p = domain.ambient_dimension();
    const Vector slope = Vector::LinSpaced(p, 0.7, -1.3);
    const Vector values = (domain.positions() * slope).array() + 2.5;
    for (Index t = 0; t < domain.cell_count(); ++t) {
      Vector local(domain.cell_size());
      for (int i = 0; i < domain.cell_size(); ++i) local[i] = values[domain.cells()(t, i)];
      Vector expected = slope;
      if (domain.kind() == DomainKind::surface) {
        const Vector n = domain.normals().row(t).transpose();
        expected -= n * n.dot(slope);
      }
      EXPECT_LT((domain.gradient(t) * local - expected).norm(), 1e-12);
      EXPECT_LT((domain.gradient(t) * Vector::Ones(domain.cell_size())).norm(), 1e-11);
    }
  }
}

TEST(Domain, LaplacianHasCotangentWeights) {
  const Domain domain(bump(0.2));
  const SparseMatrix L = cotangent_laplacian(domain);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(domain.vertex_count(), domain.vertex_count());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) {
      const Index a = domain.cells()(t, (i + 1) % 3);
      const Index b = domain.cells()(t, (i + 2) % 3);
      const Eigen::Vector3d u = (domain.positions().row(a) - domain.positions().row(domain.cells()(t, i))).transpose();
      const Eigen::Vector3d v = (domain.positions().row(b) - domain.positions().row(domain.cells()(t, i))).transpose();
      const double weight = 0.5 * u.dot(v) / u.cross(v).norm();
      expected(a, b) -= weight;
      expected(b, a) -= weight;
      expected(a, a) += weight;
      expected(b, b) += weight;
    }
  }
  EXPECT_LT((Eigen::MatrixXd(L) - expected).cwiseAbs().maxCoeff(), 1e-12);
  const SparseMatrix G = gradient_matrix(domain);
  const Vector areas = domain.cell_measures().replicate(3, 1);
  EXPECT_LT((Eigen::MatrixXd(G.transpose() * areas.asDiagonal() * G) - expected).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Domain, MassMatrixIntegratesProductsOfLinearFunctions) {
  // Integral of x^2 over [0,1]^2 is 1/3 when x is linear on every cell; of x^2 over [0,2]x[0,1]^2 it is 8/3.
  for (const auto& [domain, expected] : {std::pair(Domain(rectangle_mesh({.h = 0.2, .jitter = 0.3})), 1.0 / 3.0),
                                         std::pair(Domain(bar_tet_mesh(2.0, 1.0, 1.0, 0.5)), 8.0 / 3.0)}) {
    const Vector x = domain.positions().col(0);
    EXPECT_NEAR(x.dot(mass_matrix(domain) * x), expected, 1e-12);
  }
}

TEST(Domain, FacetsSeparateTwoCellsAndCountsObeyEuler) {
  for (const Domain& domain : all_kinds()) {
    EXPECT_EQ(domain.cell_size() * domain.cell_count(), 2 * domain.facet_count() + domain.boundary_facets().rows());
    for (Index f = 0; f < domain.facet_count(); ++f) {
      for (int side = 0; side < 2; ++side) {
        const auto cell = domain.cells().row(domain.facet_cells()(f, side));
        for (int k = 0; k < domain.intrinsic_dimension(); ++k) {
          EXPECT_TRUE((cell.array() == domain.facet_vertices()(f, k)).any());
        }
      }
    }
    EXPECT_EQ(domain.component_count(), 1);
  }
}

TEST(Domain, CellsThatMeetInAVertexAreTwoComponents) {
  Mesh mesh;
  mesh.positions.resize(5, 2);
  mesh.positions << 0, 0, 1, 0, 0, 1, -1, 0, 0, -1;
  mesh.cells.resize(2, 3);
  mesh.cells << 0, 1, 2, 0, 3, 4;
  const Domain domain(mesh);
  EXPECT_EQ(domain.component_count(), 2);
  EXPECT_EQ(domain.facet_count(), 0);
}

TEST(Domain, MovesAndRefusesToDegenerate) {
  Domain domain(rectangle_mesh({.h = 0.5}));
  const Matrix rest = domain.positions();
  const double area = domain.total_measure();
  domain.set_positions(2.0 * rest);
  EXPECT_NEAR(domain.total_measure(), 4.0 * area, 1e-14);
  Matrix flat = rest;
  flat.col(1).setZero();
  EXPECT_THROW(domain.set_positions(flat), DataError);
  EXPECT_NEAR(domain.total_measure(), 4.0 * area, 1e-14);
  EXPECT_EQ(domain.positions(), 2.0 * rest);
}

TEST(Domain, DeformationIsTheTransposedDeformationGradient) {
  const Domain domain(rectangle_mesh({.h = 0.5}));
  Eigen::Matrix2d A;
  A << 1.0, 0.3, -0.2, 0.8;  // u = A x
  const Matrix U = domain.positions() * A.transpose();
  EXPECT_LT((deformation(domain, 0, U) - A.transpose()).norm(), 1e-13);
}

}  // namespace
}  // namespace variform
