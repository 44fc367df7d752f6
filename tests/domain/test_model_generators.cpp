// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "framework/base/error.h"
#include "framework/domain/check.h"
#include "framework/domain/domain.h"
#include "framework/domain/generators.h"
#include "framework/domain/quality.h"

namespace variform {
namespace {

using std::numbers::pi;
using ::testing::HasSubstr;

/// Vertices - edges + triangles.
Index euler_characteristic(const Mesh& mesh) {
  std::set<std::pair<Index, Index>> edges;
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) edges.insert(std::minmax({mesh.cells(t, i), mesh.cells(t, (i + 1) % 3)}));
  }
  return mesh.vertex_count() - static_cast<Index>(edges.size()) + mesh.cell_count();
}

Domain good_domain(const Mesh& mesh, DomainKind kind) {
  for (const Defect& defect : check_mesh(mesh)) ADD_FAILURE() << defect.message;
  Domain domain(mesh);
  EXPECT_EQ(domain.kind(), kind);
  EXPECT_EQ(domain.component_count(), 1);
  return domain;
}

Domain closed_surface(const Mesh& mesh) {
  Domain domain = good_domain(mesh, DomainKind::surface);
  EXPECT_EQ(domain.boundary_facets().rows(), 0);
  EXPECT_EQ(euler_characteristic(mesh), 2);
  return domain;
}

/// By the divergence theorem: positive where normals point outwards.
double enclosed_volume(const Mesh& mesh) {
  double volume = 0.0;
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    const Eigen::Vector3d a = mesh.positions.row(mesh.cells(t, 0));
    const Eigen::Vector3d b = mesh.positions.row(mesh.cells(t, 1));
    const Eigen::Vector3d c = mesh.positions.row(mesh.cells(t, 2));
    volume += a.dot(b.cross(c)) / 6.0;
  }
  return volume;
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

bool same(const Mesh& a, const Mesh& b) {
  return a.positions.rows() == b.positions.rows() && a.cells.rows() == b.cells.rows() && a.positions == b.positions &&
         a.cells == b.cells;
}

/// The mirror image of every cell about x = 0 is a cell.
void expect_mirror_symmetric(const Mesh& mesh) {
  const auto place = [&](Index v, double side) {
    std::vector<double> p;
    for (Eigen::Index c = 0; c < mesh.positions.cols(); ++c) {
      p.push_back(std::round(mesh.positions(v, c) * (c == 0 ? side : 1.0) * 1e8) + 0.0);
    }
    return p;
  };
  std::map<std::vector<double>, Index> vertex_at;
  for (Index v = 0; v < mesh.vertex_count(); ++v) vertex_at[place(v, 1.0)] = v;
  std::set<std::vector<Index>> cells;
  for (const auto cell : mesh.cells.rowwise()) {
    std::vector<Index> corners(cell.begin(), cell.end());
    std::sort(corners.begin(), corners.end());
    cells.insert(corners);
  }
  for (const auto cell : mesh.cells.rowwise()) {
    std::vector<Index> corners;
    for (const Index v : cell) {
      const auto image = vertex_at.find(place(v, -1.0));
      ASSERT_NE(image, vertex_at.end()) << "vertex " << v << " has no mirror image";
      corners.push_back(image->second);
    }
    std::sort(corners.begin(), corners.end());
    ASSERT_EQ(cells.count(corners), 1U);
  }
}

TEST(Tube, IsOpenRoundAndOutward) {
  for (const bool alternating : {true, false}) {
    const Mesh mesh = tube_mesh({.alternating = alternating});
    EXPECT_EQ(mesh.vertex_count(), 24 * 49);
    EXPECT_EQ(mesh.cell_count(), 2 * 24 * 48);
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(euler_characteristic(mesh), 0);
    EXPECT_EQ(domain.boundary_facets().rows(), 2 * 24);
    EXPECT_NEAR(domain.total_measure(), 24 * 2.0 * 0.5 * std::sin(pi / 24) * 4.0, 1e-12);
    for (Index t = 0; t < domain.cell_count(); ++t) {
      EXPECT_GT(domain.normals().row(t).dot(mesh.positions.row(mesh.cells(t, 0))), 0.0);
    }
  }
  EXPECT_FALSE(same(tube_mesh({}), tube_mesh({.alternating = false})));
}

TEST(SquareTube, IsABoxOfTheGivenCounts) {
  for (const bool alternating : {true, false}) {
    const Mesh mesh = square_tube_mesh({.alternating = alternating});
    EXPECT_EQ(mesh.cell_count(), 2 * (4 * 40 * 6 + 2 * 6 * 6));
    const Domain domain = closed_surface(mesh);
    EXPECT_NEAR(domain.total_measure(), 4 * 4.0 * 0.8 + 2 * 0.64, 1e-12);
    EXPECT_NEAR(enclosed_volume(mesh), 4.0 * 0.64, 1e-12);
    EXPECT_LT((mesh.positions.colwise().minCoeff() - Eigen::RowVector3d(-0.4, -0.4, 0.0)).norm(), 1e-15);
    EXPECT_LT((mesh.positions.colwise().maxCoeff() - Eigen::RowVector3d(0.4, 0.4, 4.0)).norm(), 1e-15);
  }
  // Every face's diagonals in turns: an even count of quads is mirror symmetric.
  expect_mirror_symmetric(square_tube_mesh({}));
}

TEST(BumpArray, IsTheGraphOfHalfEllipsoids) {
  BumpArrayOptions options{.bumps = 4, .radius = 0.1, .height = 0.15};
  options.base.h = 1.0 / 120;
  options.base.tessellation = Tessellation::regular;
  const Mesh mesh = bump_array_mesh(options);
  const Domain domain = good_domain(mesh, DomainKind::surface);
  EXPECT_EQ(mesh.cell_count(), 2 * 120 * 120);
  EXPECT_EQ(euler_characteristic(mesh), 1);
  EXPECT_GT(domain.normals().col(2).minCoeff(), 0.0);
  EXPECT_NEAR(mesh.positions.col(2).maxCoeff(), 0.15, 1e-12);  // the centres, at multiples of 1/8, are vertices
  // Volume below: 16 half ellipsoids.
  double volume = 0.0;
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    double height = 0.0;
    for (const Index v : mesh.cells.row(t)) height += mesh.positions(v, 2) / 3.0;
    volume += height * 0.5 / (120.0 * 120.0);
  }
  EXPECT_NEAR(volume, 16 * 2.0 / 3.0 * pi * 0.1 * 0.1 * 0.15, 0.01 * volume);
  EXPECT_THAT(message_of([] { bump_array_mesh({.bumps = 10, .radius = 0.06}); }), HasSubstr("'radius' = 0.06"));
}

TEST(Pillow, IsTheGraphOfItsFunctionOnManyTessellations) {
  for (const std::uint64_t seed : {1U, 2U}) {
    const Mesh mesh = pillow_mesh({.h = 0.125, .tessellation = Tessellation::random, .jitter = 0.45, .seed = seed});
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(mesh.cell_count(), 2 * 16 * 16);
    EXPECT_GT(domain.normals().col(2).minCoeff(), 0.0);
    for (const auto p : mesh.positions.rowwise()) {
      EXPECT_NEAR(p(2), 0.5 * (1.0 - p(0) * p(0)) * (1.0 - p(1) * p(1)), 1e-15);
    }
    EXPECT_EQ(mesh.positions.col(0).minCoeff(), -1.0);
    EXPECT_EQ(mesh.positions.col(1).maxCoeff(), 1.0);
  }
  EXPECT_FALSE(same(pillow_mesh({.seed = 1}), pillow_mesh({.seed = 2})));
}

TEST(Wing, IsFilledAndMirrorSymmetricWithAllItsCells) {
  for (const double h : {0.4, 0.1, 0.07}) {
    const Mesh mesh = wing_tet_mesh(h);
    const Domain domain = good_domain(mesh, DomainKind::tetrahedral);
    EXPECT_NEAR(domain.total_measure(), 0.8 * 2.0 * 0.6 + 2 * 1.6 * 0.6 * 0.2, 1e-12);
    expect_mirror_symmetric(mesh);
    // The boundary is a sphere: V - E + F of its triangles.
    std::set<Index> vertices;
    const IndexMatrix& sides = domain.boundary_facets();
    for (const Index v : sides.reshaped()) vertices.insert(v);
    EXPECT_EQ(static_cast<Index>(vertices.size()) - sides.rows() / 2, 2);
  }
  EXPECT_THAT(message_of([] { wing_tet_mesh(0.5); }), HasSubstr("'h' = 0.5"));
}

TEST(BoxCar, IsABoxWithAHood) {
  const Mesh mesh = box_car_mesh(1.0 / 32);
  closed_surface(mesh);
  EXPECT_NEAR(mesh.positions.col(2).maxCoeff(), 0.7, 1e-12);
  // The hood adds 0.2 times the squared mean of sin^2.
  EXPECT_NEAR(enclosed_volume(mesh), 2.0 * 0.5 + 0.2 * 0.25, 1e-4);
}

TEST(CactusSurface, IsAGoodClosedSurfaceOfItsSize) {
  for (const double h : {0.03, 0.0182}) {
    const Mesh mesh = cactus_surface_mesh(h);
    const Domain domain = closed_surface(mesh);
    EXPECT_GT(enclosed_volume(mesh), 0.0);
    const MeshQuality quality = mesh_quality(domain);
    EXPECT_GT(quality.mean_edge, 0.8 * h);
    EXPECT_LT(quality.mean_edge, 1.6 * h);
    EXPECT_GT(quality.min_angle, 15.0);
    EXPECT_LT(quality.measure_ratio, 12.0);
    const Eigen::RowVector3d low = mesh.positions.colwise().minCoeff();
    const Eigen::RowVector3d high = mesh.positions.colwise().maxCoeff();
    EXPECT_LT((low - Eigen::RowVector3d(-0.40, -0.12, 0.0)).norm(), 0.01);
    EXPECT_LT((high - Eigen::RowVector3d(0.43, 0.12, 1.12)).norm(), 0.01);
  }
  const Mesh mesh = cactus_surface_mesh(0.0182);
  EXPECT_NEAR(mesh.vertex_count(), 5261, 300);  // the benchmark's
  EXPECT_TRUE(same(cactus_surface_mesh(0.04), cactus_surface_mesh(0.04)));
  // Enclosed: at the trunk's height without arms, circles of radius 0.12.
  std::array<int, 3> parts{};
  for (const auto p : mesh.positions.rowwise()) {
    const int part = cactus_surface_part(Eigen::Vector3d(p));
    ++parts[part];
    if (p(0) > 0.3) {
      EXPECT_EQ(part, 1);
    }
    if (p(0) < -0.3) {
      EXPECT_EQ(part, 2);
    }
    if (p(2) < 0.2) {
      EXPECT_EQ(part, 0);
    }
    if (p(2) > 0.12 && p(2) < 0.25) {
      EXPECT_NEAR(p.head(2).norm(), 0.12, 1e-6);
    }
  }
  for (const int count : parts) EXPECT_GT(count, 500);
  EXPECT_THAT(message_of([] { cactus_surface_mesh(0.05); }), HasSubstr("'h' = 0.05"));
}

TEST(SymmetricSilhouettes, AreTheShapeWithMirroredCells) {
  for (const std::string name : {"figure", "frog"}) {
    SCOPED_TRACE(name);
    for (const double h : {0.0175, 0.006}) {
      const Mesh mesh = silhouette_mesh(name, h, true);
      const Domain domain = good_domain(mesh, DomainKind::planar);
      EXPECT_EQ(euler_characteristic(mesh), 1);
      expect_mirror_symmetric(mesh);
      EXPECT_GT(mesh_quality(domain).min_angle, 15.0);
      const double area = Domain(silhouette_mesh(name, h)).total_measure();
      EXPECT_NEAR(domain.total_measure(), area, 0.02 * area);
      if (h < 0.01) {
        EXPECT_GT(mesh.vertex_count(), 5000);
      }
    }
  }
  EXPECT_THAT(message_of([] { silhouette_mesh("giraffe", 0.01, true); }), HasSubstr("'giraffe' is not symmetric"));
}

TEST(LatticeSphere, ConvergesToAreaAndVolumeForAllAspects) {
  for (const auto& [meridians, parallels] : {std::pair{64, 31}, {128, 31}, {32, 63}}) {
    const Mesh mesh = lattice_sphere_mesh(1.5, meridians, parallels);
    EXPECT_EQ(mesh.vertex_count(), meridians * parallels + 2);
    EXPECT_EQ(mesh.cell_count(), 2 * meridians * parallels);
    const Domain domain = closed_surface(mesh);
    EXPECT_NEAR(domain.total_measure(), 4.0 * pi * 2.25, 0.01 * 4.0 * pi * 2.25);
    EXPECT_NEAR(enclosed_volume(mesh), 4.0 / 3.0 * pi * 3.375, 0.02 * 4.0 / 3.0 * pi * 3.375);
    EXPECT_LT((mesh.positions.rowwise().norm().array() - 1.5).abs().maxCoeff(), 1e-14);
  }
  closed_surface(lattice_sphere_mesh(1.0, 3, 1));
}

TEST(RandomSphere, IsTheConvexHullOfItsPoints) {
  for (const int rounds : {0, 3}) {
    const Mesh mesh = random_sphere_mesh({.radius = 2.0, .points = 300, .rounds = rounds, .seed = 5});
    EXPECT_EQ(mesh.vertex_count(), 300);
    EXPECT_EQ(mesh.cell_count(), 2 * 300 - 4);
    closed_surface(mesh);
    EXPECT_LT((mesh.positions.rowwise().norm().array() - 2.0).abs().maxCoeff(), 1e-14);
    for (Index t = 0; t < mesh.cell_count(); ++t) {
      const Eigen::Vector3d a = mesh.positions.row(mesh.cells(t, 0));
      const Eigen::Vector3d b = mesh.positions.row(mesh.cells(t, 1));
      const Eigen::Vector3d c = mesh.positions.row(mesh.cells(t, 2));
      const Eigen::Vector3d normal = (b - a).cross(c - a).normalized();
      EXPECT_LT(((mesh.positions * normal).array() - a.dot(normal)).maxCoeff(), 1e-12);
    }
  }
}

TEST(RandomSphere, RoundsMakeItEvenAndSeedsDecide) {
  std::vector<double> angles;
  for (const int rounds : {0, 2, 7}) {
    angles.push_back(mesh_quality(closed_surface(random_sphere_mesh({.rounds = rounds}))).min_angle);
  }
  EXPECT_LT(angles[0], angles[1]);
  EXPECT_LT(angles[1], angles[2]);
  EXPECT_GT(angles[2], 10.0);
  EXPECT_TRUE(same(random_sphere_mesh({.seed = 3}), random_sphere_mesh({.seed = 3})));
  EXPECT_FALSE(same(random_sphere_mesh({.seed = 3}), random_sphere_mesh({.seed = 4})));
  EXPECT_THAT(message_of([] { random_sphere_mesh({.points = 4}); }), HasSubstr("'points' = 4"));
}

}  // namespace
}  // namespace variform
