// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "energies/parametrization/parametrization.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/operators/distortion.h"
#include "solvers/linear/linear_backends.h"
#include "tests/energies/curved_meshes.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

template <class Call>
std::string message_of(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "nothing thrown";
}

// Two triangles, the first with the given unit normal, the second at an angle with it.
Domain fold_with_normal(const Eigen::Vector3d& n) {
  const Eigen::Vector3d a = n.unitOrthogonal();
  const Eigen::Vector3d b = n.cross(a);
  Mesh mesh{Matrix(4, 3), IndexMatrix(2, 3)};
  mesh.positions.row(0).setZero();
  mesh.positions.row(1) = (0.9 * a + 0.1 * b).transpose();
  mesh.positions.row(2) = (0.2 * a + 1.1 * b).transpose();
  mesh.positions.row(3) = (-0.8 * a + 0.7 * n).transpose();
  mesh.cells << 0, 1, 2, 0, 2, 3;
  return Domain(mesh);
}

void expect_right_handed(const Domain& domain, const Matrix& frames) {
  ASSERT_EQ(frames.rows(), domain.cell_count());
  ASSERT_EQ(frames.cols(), 6);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::Matrix3d Q;
    Q.row(0) = frames.row(t).head(3);
    Q.row(1) = frames.row(t).tail(3);
    Q.row(2) = domain.normals().row(t);
    EXPECT_LT((Q * Q.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-14);
    EXPECT_GT(Q.determinant(), 0.0);
  }
}

TEST(TangentFrames, AreOrthonormalAndRightHanded) {
  const Domain box(bar_surface_mesh(1.0, 0.5, 0.5, 0.25));
  const Domain bump(testing::bump_mesh(0.2));
  for (const Domain* domain : {&box, &bump}) {
    for (const FrameChoice choice : {FrameChoice::minimal_rotation, FrameChoice::edge_aligned, FrameChoice::random}) {
      expect_right_handed(*domain, tangent_frames(*domain, choice));
    }
  }
  EXPECT_NE(tangent_frames(bump, FrameChoice::random, 1), tangent_frames(bump, FrameChoice::random, 2));
  EXPECT_EQ(tangent_frames(bump, FrameChoice::random, 1), tangent_frames(bump, FrameChoice::random, 1));
  EXPECT_THROW(tangent_frames(Domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5))), UsageError);
}

// The rotation of least angle that takes n to z has their cross product as its axis.
TEST(TangentFrames, OfMinimalRotationTurnAboutNCrossZ) {
  std::vector<Eigen::Vector3d> normals = {{0.0, 0.0, 1.0}, {1.0, 0.0, 0.0}, {0.0, -1.0, 0.0}, {0.3, -0.4, -0.8}};
  for (const double tilt : {1e-2, 1e-6, 1e-9, 1e-13}) normals.emplace_back(tilt, -0.4 * tilt, -1.0);
  normals.emplace_back(0.0, 0.0, -1.0);
  for (const Eigen::Vector3d& wanted : normals) {
    const Domain domain = fold_with_normal(wanted.normalized());
    const Matrix frames = tangent_frames(domain);
    expect_right_handed(domain, frames);
    const Eigen::Vector3d n = domain.normals().row(0);
    Eigen::Matrix3d R;  // its rows go to x, y and z
    R.row(0) = frames.row(0).head(3);
    R.row(1) = frames.row(0).tail(3);
    R.row(2) = n.transpose();
    const double sine = std::hypot(n[0], n[1]);
    // Half a turn about any axis in the plane takes -z to z: x it is.
    const Eigen::Vector3d axis =
        sine > 0.0 ? Eigen::Vector3d(n[1] / sine, -n[0] / sine, 0.0) : Eigen::Vector3d::UnitX();
    EXPECT_LT((R * axis - axis).norm(), 1e-14) << n.transpose();
    EXPECT_NEAR(R.trace(), 1.0 + 2.0 * n[2], 1e-14) << n.transpose();  // the angle from n to z
  }
}

TEST(TangentFrames, OfThePlaneAreItsAxes) {
  const Domain plane(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  const Matrix frames = tangent_frames(plane);
  ASSERT_EQ(frames.cols(), 4);
  for (Index t = 0; t < plane.cell_count(); ++t) EXPECT_EQ(frames.row(t), Eigen::RowVector4d(1.0, 0.0, 0.0, 1.0));
  const Matrix aligned = tangent_frames(plane, FrameChoice::edge_aligned);
  for (Index t = 0; t < plane.cell_count(); ++t) {
    EXPECT_NEAR(aligned(t, 0) * aligned(t, 3) - aligned(t, 1) * aligned(t, 2), 1.0, 1e-14);
    const Eigen::RowVector2d edge =
        plane.positions().row(plane.cells()(t, 1)) - plane.positions().row(plane.cells()(t, 0));
    EXPECT_NEAR(aligned.row(t).head(2).dot(edge), edge.norm(), 1e-14);
  }
}

TEST(DefaultPins, AreTheTwoFarthestBoundaryVertices) {
  for (const Mesh& mesh : {testing::bump_mesh(0.1), testing::half_cylinder_mesh(0.1), disk_mesh(1.0, 0.1)}) {
    const Domain domain(mesh);
    const Constraints pins = default_pins(domain);
    ASSERT_EQ(pins.fixed().size(), 2u);
    const auto& a = pins.fixed()[0];
    const auto& b = pins.fixed()[1];
    const double distance = (domain.positions().row(a.vertex) - domain.positions().row(b.vertex)).norm();
    EXPECT_NEAR((a.value - b.value).norm(), distance, 1e-14);
    for (Index i = 0; i < domain.vertex_count(); ++i) {
      for (Index j = 0; j < i; ++j) {
        if (!domain.boundary_vertices()[i] || !domain.boundary_vertices()[j]) continue;
        EXPECT_LE((domain.positions().row(i) - domain.positions().row(j)).norm(), distance);
      }
    }
    EXPECT_TRUE(domain.boundary_vertices()[a.vertex] && domain.boundary_vertices()[b.vertex]);
  }
}

// A deep pit: its walls are some ten times as high as it is wide.
Mesh pit_mesh() {
  return testing::lifted(disk_mesh(1.0, 0.08), [](double x, double y) {
    return Eigen::RowVector3d(x, y, -4.0 * std::exp(-8.0 * (x * x + y * y)));
  });
}

// The sphere but for a small cap, by inverse stereographic projection: the boundary is short against the area.
Mesh open_sphere_mesh() { return testing::stereographic_cap_mesh(6.0, 0.3); }

TEST(TutteMap, TakesDisksToTheCircleWithoutFlips) {
  for (const Mesh& mesh : {testing::bump_mesh(0.1), pit_mesh(), open_sphere_mesh(), testing::half_cylinder_mesh(0.1)}) {
    const Domain domain(mesh);
    for (const TutteWeights weights : {TutteWeights::uniform, TutteWeights::mean_value}) {
      const auto backend = make_linear_backend("auto");
      const Matrix U = tutte_map(domain, TutteBoundary::circle, weights, *backend);
      const CellDistortion cells = cell_distortion(domain, U);
      EXPECT_TRUE(cells.flipped.empty());
      EXPECT_GT(cells.determinant.minCoeff(), 0.0);
      const double radius = std::sqrt(domain.total_measure() / std::numbers::pi);
      double inside = 0.0;
      for (Index v = 0; v < domain.vertex_count(); ++v) {
        if (domain.boundary_vertices()[v]) {
          EXPECT_NEAR(U.row(v).norm(), radius, 1e-12 * radius);
        } else {
          inside = std::max(inside, U.row(v).norm());
        }
      }
      EXPECT_LT(inside, radius);
      // Angles on the circle are in proportion to arc length.
      double length = 0.0;
      for (Index e = 0; e < domain.boundary_facets().rows(); ++e) {
        length += (domain.positions().row(domain.boundary_facets()(e, 1)) -
                   domain.positions().row(domain.boundary_facets()(e, 0)))
                      .norm();
      }
      for (Index e = 0; e < domain.boundary_facets().rows(); ++e) {
        const Index a = domain.boundary_facets()(e, 0);
        const Index b = domain.boundary_facets()(e, 1);
        const double angle = std::atan2(U(a, 0) * U(b, 1) - U(a, 1) * U(b, 0), U.row(a).dot(U.row(b)));
        EXPECT_NEAR(angle,
                    2.0 * std::numbers::pi * (domain.positions().row(a) - domain.positions().row(b)).norm() / length,
                    1e-12);
      }
      EXPECT_EQ(boundary_crossings(domain, U), 0);
    }
  }
}

// Without a chord in the boundary, so that no piece is cut off at a side.
TEST(TutteMap, TakesDisksToTheSquareOfTheirArea) {
  for (const Mesh& mesh : {pit_mesh(), open_sphere_mesh(), disk_mesh(1.0, 0.2)}) {
    const Domain domain(mesh);
    const auto backend = make_linear_backend("eigen.ldlt");
    const Matrix U = tutte_map(domain, TutteBoundary::square, TutteWeights::uniform, *backend);
    const Distortion errors = distortion(domain, U);
    EXPECT_TRUE(errors.flipped.empty());
    EXPECT_NEAR(errors.area_ratio, 1.0, 1e-12);  // the corners are taken
    const double half = 0.5 * std::sqrt(domain.total_measure());
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      const double edge = U.row(v).cwiseAbs().maxCoeff();
      if (domain.boundary_vertices()[v]) {
        EXPECT_EQ(edge, half);
      } else {
        EXPECT_LT(edge, half);
      }
    }
  }
}

TEST(TutteMap, PutsEveryInnerVertexAtTheMeanOfItsNeighbours) {
  const Domain domain(testing::bump_mesh(0.2));
  const auto backend = make_linear_backend("eigen.ldlt");
  const Matrix U = tutte_map(domain, TutteBoundary::circle, TutteWeights::uniform, *backend);
  Eigen::MatrixXi neighbours = Eigen::MatrixXi::Zero(domain.vertex_count(), domain.vertex_count());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) {
      neighbours(domain.cells()(t, i), domain.cells()(t, (i + 1) % 3)) = 1;
      neighbours(domain.cells()(t, (i + 1) % 3), domain.cells()(t, i)) = 1;
    }
  }
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.boundary_vertices()[v]) continue;
    const Eigen::RowVectorXd mean =
        neighbours.row(v).cast<double>() * Eigen::MatrixXd(U) / static_cast<double>(neighbours.row(v).sum());
    EXPECT_LT((mean - U.row(v)).norm(), 1e-14);
  }
}

// Mean value coordinates reproduce linear functions: a flat disk mesh whose boundary is on the circle at distances of
// its arc length stays as it is.
TEST(TutteMap, WithMeanValueWeightsKeepsAFlatDisk) {
  Mesh flat = disk_mesh(1.0, 0.2);
  const Domain boundary(flat);
  for (Index v = 0; v < flat.vertex_count(); ++v) {
    if (!boundary.boundary_vertices()[v])
      flat.positions.row(v) += 0.03 * Eigen::RowVector2d(std::sin(v), std::cos(3.0 * v));
  }
  const Domain domain(flat);
  const auto backend = make_linear_backend("eigen.lu");
  const Matrix U = tutte_map(domain, TutteBoundary::circle, TutteWeights::mean_value, *backend);
  const Distortion errors = distortion(domain, U);
  EXPECT_LT(errors.conformal, 1e-22);
  EXPECT_NEAR(errors.area_ratio, domain.total_measure() / std::numbers::pi, 1e-12);
  const auto ldlt = make_linear_backend("eigen.ldlt");
  EXPECT_GT(distortion(domain, tutte_map(domain, TutteBoundary::circle, TutteWeights::uniform, *ldlt)).conformal, 1e-4);
}

TEST(TutteMap, RefusesWhatIsNoDisk) {
  const auto backend = make_linear_backend("eigen.ldlt");
  const auto refused = [&](const Domain& domain) {
    const std::string pins = message_of([&] { default_pins(domain); });
    EXPECT_THAT(pins, HasSubstr("cut it open first"));
    return message_of([&] { tutte_map(domain, TutteBoundary::circle, TutteWeights::uniform, *backend); });
  };
  EXPECT_THAT(refused(Domain(bar_surface_mesh(1.0, 1.0, 1.0, 0.5))), HasSubstr("0 boundary loop"));
  EXPECT_THAT(refused(Domain(annulus_mesh(0.5, 1.0, 0.2))), HasSubstr("2 boundary loop"));
  // Two triangles apart, two that touch in a vertex, and a torus with a hole.
  Mesh two{Matrix(6, 2), IndexMatrix(2, 3)};
  two.positions << 0, 0, 1, 0, 0, 1, 5, 0, 6, 0, 5, 1;
  two.cells << 0, 1, 2, 3, 4, 5;
  EXPECT_THAT(refused(Domain(two)), HasSubstr("2 component(s)"));
  constexpr int kSides = 6;
  Mesh torus{Matrix(kSides * kSides, 3), IndexMatrix(2 * kSides * kSides - 2, 3)};
  Index cell = 0;
  for (int i = 0; i < kSides; ++i) {
    for (int j = 0; j < kSides; ++j) {
      const double a = 2.0 * std::numbers::pi * i / kSides;
      const double b = 2.0 * std::numbers::pi * j / kSides;
      torus.positions.row(i * kSides + j) << (2.0 + std::cos(b)) * std::cos(a), (2.0 + std::cos(b)) * std::sin(a),
          std::sin(b);
      if (i == 0 && j == 0) continue;  // the hole
      const auto at = [&](int k, int l) { return (k % kSides) * kSides + l % kSides; };
      torus.cells.row(cell++) << at(i, j), at(i + 1, j), at(i + 1, j + 1);
      torus.cells.row(cell++) << at(i, j), at(i + 1, j + 1), at(i, j + 1);
    }
  }
  EXPECT_THAT(refused(Domain(torus)), HasSubstr("genus 1"));
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  EXPECT_THROW(default_pins(solid), UsageError);
  // An octagon in triangles around one of its vertices: every other side of it is an ear on one side of the square.
  Mesh fan{Matrix(8, 2), IndexMatrix(6, 3)};
  for (int i = 0; i < 8; ++i)
    fan.positions.row(i) << std::cos(i * std::numbers::pi / 4), std::sin(i * std::numbers::pi / 4);
  for (int i = 0; i < 6; ++i) fan.cells.row(i) << 0, i + 1, i + 2;
  const Domain octagon(fan);
  EXPECT_THAT(message_of([&] { tutte_map(octagon, TutteBoundary::square, TutteWeights::uniform, *backend); }),
              HasSubstr("use the circle"));
  EXPECT_TRUE(
      distortion(octagon, tutte_map(octagon, TutteBoundary::circle, TutteWeights::uniform, *backend)).flipped.empty());
  Mesh one{Matrix(3, 2), IndexMatrix(1, 3)};
  one.positions << 0, 0, 1, 0, 0, 1;
  one.cells << 0, 1, 2;
  EXPECT_THAT(message_of([&] { tutte_map(Domain(one), TutteBoundary::square, TutteWeights::uniform, *backend); }),
              HasSubstr("four corners"));
}

}  // namespace
}  // namespace variform
