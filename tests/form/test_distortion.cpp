// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/operators/distortion.h"
#include "tests/energies/curved_meshes.h"

namespace variform {
namespace {

TEST(Distortion, OfAnAffineMapFollowsFromItsSingularValues) {
  const Domain square(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  Matrix U = square.positions();
  U.col(0) *= 2.0;
  U.col(1) *= 0.5;
  const Distortion stretched = distortion(square, U);
  EXPECT_NEAR(stretched.isometric, 1.0 + 0.25, 1e-12);
  EXPECT_NEAR(stretched.conformal, 0.5 * 1.5 * 1.5, 1e-12);
  EXPECT_NEAR(stretched.authalic, 0.0, 1e-12);
  EXPECT_NEAR(stretched.metric, 1.25 - 0.25 * 1.5 * 1.5, 1e-12);
  EXPECT_NEAR(stretched.area_ratio, 1.0, 1e-12);
  EXPECT_TRUE(stretched.flipped.empty());
}

TEST(Distortion, ReflectionsAreFlipsWithASignedSingularValue) {
  const Domain square(rectangle_mesh({.h = 0.25}));
  Matrix U = square.positions();
  U.col(0) *= -1.0;
  const Distortion mirrored = distortion(square, U);
  EXPECT_EQ(static_cast<Index>(mirrored.flipped.size()), square.cell_count());
  EXPECT_NEAR(mirrored.min_determinant, -1.0, 1e-12);
  EXPECT_NEAR(mirrored.isometric, 4.0, 1e-12);  // (1-1)^2 + (-1-1)^2
  EXPECT_NEAR(mirrored.conformal, 2.0, 1e-12);
}

TEST(Distortion, OfTetrahedraUsesThreeSingularValues) {
  const Domain bar(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  Matrix U = bar.positions();
  U.col(2) *= 3.0;
  const Distortion stretched = distortion(bar, U);
  EXPECT_NEAR(stretched.isometric, 4.0, 1e-12);
  EXPECT_NEAR(stretched.conformal, (4.0 + 4.0) / 3.0, 1e-12);
  EXPECT_NEAR(stretched.authalic, 4.0, 1e-12);
  EXPECT_NEAR(stretched.metric, 4.0 - 8.0 / 5.0, 1e-12);
}

TEST(Distortion, OfMirroredTetrahedraHasTheSignOnTheSmallestSingularValue) {
  const Domain bar(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  Matrix U = bar.positions();
  U.col(0) *= -3.0;
  U.col(1) *= 2.0;
  const CellDistortion cells = cell_distortion(bar, U);
  for (Index t = 0; t < bar.cell_count(); ++t) {
    EXPECT_LT((cells.singular_values.row(t) - Eigen::RowVector3d(3.0, 2.0, -1.0)).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_NEAR(cells.determinant[t], -6.0, 1e-12);
  }
  EXPECT_EQ(static_cast<Index>(cells.flipped.size()), bar.cell_count());
}

// det F is the signed ratio of volumes whatever the map: the sum over cells is the volume of the image.
TEST(Distortion, OfTetrahedraAddsUpToTheImage) {
  const Domain bar(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  Matrix U = bar.positions() + 0.05 * Matrix::Random(bar.vertex_count(), 3);
  for (Index v = 0; v < bar.vertex_count(); ++v) {
    if (bar.boundary_vertices()[v]) U.row(v) = 2.0 * bar.positions().row(v);
  }
  EXPECT_NEAR(distortion(bar, U).area_ratio, 8.0, 1e-12);
}

TEST(Distortion, OfAShearIsAuthalic) {
  const Domain square(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  Matrix U = square.positions();
  U.col(0) += U.col(1);
  const Distortion sheared = distortion(square, U);
  const double golden = 0.5 * (1.0 + std::sqrt(5.0));  // singular values of [1 1; 0 1] and their inverses
  EXPECT_NEAR(sheared.authalic, 0.0, 1e-24);
  EXPECT_NEAR(sheared.max_conformal_ratio, golden * golden, 1e-12);
  EXPECT_NEAR(sheared.symmetric_dirichlet, 2.0 * (golden * golden + 1.0 / (golden * golden)), 1e-12);
  EXPECT_NEAR(sheared.isometric, (golden - 1) * (golden - 1) + (1 / golden - 1) * (1 / golden - 1), 1e-12);
}

// m times the mean over directions of (r'(Sigma - I) r)^2, by quadrature.
TEST(Distortion, MetricIsADirectionalMean) {
  const auto mean2 = [](double a, double b) {
    const int steps = 64;
    double sum = 0.0;
    for (int i = 0; i < steps; ++i) {
      const double c = std::cos(2.0 * std::numbers::pi * i / steps);
      sum += std::pow(a * c * c + b * (1.0 - c * c), 2) / steps;
    }
    return sum;
  };
  const Domain square(rectangle_mesh({.h = 0.5}));
  Matrix U = square.positions();
  U.col(0) *= 1.7;
  U.col(1) *= 0.6;
  EXPECT_NEAR(distortion(square, U).metric, 2.0 * mean2(0.7, -0.4), 1e-12);
  const Domain bar(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  Matrix V = bar.positions();
  V.col(0) *= 1.7;
  V.col(1) *= 0.6;
  V.col(2) *= 1.2;
  // Midpoint rule in z (exact up to 1/n^2) and around.
  double sum = 0.0;
  const int steps = 4000;
  for (int i = 0; i < steps; ++i) {
    const double z = -1.0 + (2.0 * i + 1.0) / steps;
    for (int k = 0; k < 8; ++k) {
      const double c = std::cos(std::numbers::pi * k / 8.0 + 0.1);
      const double xy = 1.0 - z * z;
      sum += std::pow(0.7 * xy * c * c - 0.4 * xy * (1.0 - c * c) + 0.2 * z * z, 2) / (8.0 * steps);
    }
  }
  EXPECT_NEAR(distortion(bar, V).metric, 3.0 * sum, 1e-6);
}

TEST(Distortion, OfSurfaceToPlaneKnowsIsometriesAndMirrors) {
  Matrix unrolled;
  const Domain cylinder(testing::half_cylinder_mesh(0.125, &unrolled));
  const Eigen::Rotation2Dd turn(2.2);
  for (const bool mirrored : {false, true}) {
    Matrix U = 3.0 * unrolled * turn.toRotationMatrix().transpose();
    if (mirrored) U.col(1) *= -1.0;
    // The cells' normals point outwards where the flat mesh looks at the viewer, or all of them inwards.
    const CellDistortion cells = cell_distortion(cylinder, U);
    const double sign = mirrored ? -1.0 : 1.0;
    EXPECT_LT((cells.singular_values.col(0).array() - 3.0).abs().maxCoeff(), 1e-12);
    EXPECT_LT((cells.singular_values.col(1).array() - 3.0 * sign).abs().maxCoeff(), 1e-12);
    EXPECT_EQ(static_cast<Index>(cells.flipped.size()), mirrored ? cylinder.cell_count() : 0);
    const Distortion errors = distortion(cylinder, cells);
    EXPECT_NEAR(errors.conformal, mirrored ? 18.0 : 0.0, 1e-10);
    EXPECT_NEAR(errors.area_ratio, 9.0 * sign, 1e-11);
    if (mirrored) {
      EXPECT_TRUE(std::isinf(errors.symmetric_dirichlet));
      EXPECT_TRUE(std::isinf(errors.max_conformal_ratio));
    } else {
      EXPECT_NEAR(errors.symmetric_dirichlet, 2.0 * (9.0 + 1.0 / 9.0), 1e-11);
      EXPECT_NEAR(errors.max_conformal_ratio, 1.0, 1e-11);
    }
  }
  EXPECT_LT(distortion(cylinder, unrolled).isometric, 1e-24);
}

// Stereographic projection is conformal with factor (1 + r^2) / 2; on a mesh up to its size.
TEST(Distortion, OfStereographicProjectionIsConformalInTheLimit) {
  double last = 1.0;
  for (const double h : {0.2, 0.1, 0.05}) {
    const Domain cap(testing::stereographic_cap_mesh(1.0, h));
    const Mesh disk = disk_mesh(1.0, h);
    const CellDistortion cells = cell_distortion(cap, disk.positions);
    const double worst = (cells.conformal_ratio.array() - 1.0).maxCoeff();
    EXPECT_LT(worst, 0.6 * last) << h;
    EXPECT_TRUE(cells.flipped.empty());
    for (Index t = 0; t < cap.cell_count(); ++t) {
      double r2 = 0.0;
      for (int i = 0; i < 3; ++i) r2 += disk.positions.row(cap.cells()(t, i)).squaredNorm() / 3.0;
      EXPECT_NEAR(std::sqrt(cells.determinant[t]), 0.5 * (1.0 + r2), h);
    }
    last = worst;
  }
}

TEST(Distortion, OfSurfaceToSurfaceHasTwoSingularValuesAndNoFlips) {
  const Domain bump(testing::bump_mesh(0.1));
  const Eigen::Matrix3d Q = Eigen::AngleAxisd(1.1, Eigen::Vector3d(1.0, -2.0, 0.5).normalized()).toRotationMatrix();
  const Matrix turned = 2.0 * bump.positions() * Q.transpose();
  const Distortion scaled = distortion(bump, turned);
  EXPECT_NEAR(scaled.isometric, 2.0, 1e-11);
  EXPECT_NEAR(scaled.conformal, 0.0, 1e-20);
  EXPECT_NEAR(scaled.authalic, 9.0, 1e-11);
  EXPECT_NEAR(scaled.area_ratio, 4.0, 1e-12);
  EXPECT_TRUE(scaled.flipped.empty());
  // A mirror image in space is congruent, for all that a surface can tell.
  Matrix mirrored = bump.positions();
  mirrored.col(0) *= -1.0;
  EXPECT_LT(distortion(bump, mirrored).isometric, 1e-24);
  // Projected along z: one singular value stays 1, the other is the cosine of the slope.
  Matrix projected = bump.positions();
  projected.col(2).setZero();
  const CellDistortion flattened = cell_distortion(bump, projected);
  for (Index t = 0; t < bump.cell_count(); ++t) {
    EXPECT_NEAR(flattened.singular_values(t, 0), 1.0, 1e-12);
    EXPECT_NEAR(flattened.singular_values(t, 1), std::abs(bump.normals()(t, 2)), 1e-12);
  }
  // Projected to a line: every image triangle is degenerate.
  projected.col(1).setZero();
  EXPECT_EQ(static_cast<Index>(cell_distortion(bump, projected).flipped.size()), bump.cell_count());
  EXPECT_EQ(static_cast<Index>(cell_distortion(bump, Matrix::Zero(bump.vertex_count(), 3)).flipped.size()),
            bump.cell_count());
}

TEST(Distortion, MeansAreThoseOfTheCells) {
  const Domain bump(testing::bump_mesh(0.2));
  const Matrix U = bump.positions().leftCols(2) + 0.02 * Matrix::Random(bump.vertex_count(), 2);
  const CellDistortion cells = cell_distortion(bump, U);
  const Distortion means = distortion(bump, U);
  const Vector weights = bump.cell_measures() / bump.total_measure();
  for (const auto& [mean, field] : {std::pair<double, const Vector*>(means.isometric, &cells.isometric),
                                    {means.conformal, &cells.conformal},
                                    {means.authalic, &cells.authalic},
                                    {means.metric, &cells.metric},
                                    {means.symmetric_dirichlet, &cells.symmetric_dirichlet},
                                    {means.area_ratio, &cells.determinant}}) {
    EXPECT_NEAR(mean, weights.dot(*field), 1e-13);
    EXPECT_GT(mean, 0.0);
  }
}

TEST(Distortion, RefusesWrongSizes) {
  const Domain surface(bar_surface_mesh(1.0, 1.0, 1.0, 0.5));
  EXPECT_THROW(distortion(surface, Matrix::Zero(surface.vertex_count(), 1)), UsageError);
  const Domain square(rectangle_mesh({.h = 0.5}));
  EXPECT_THROW(distortion(square, Matrix::Zero(3, 2)), UsageError);
  EXPECT_THROW(distortion(square, Matrix::Zero(square.vertex_count(), 3)), UsageError);
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  EXPECT_THROW(distortion(solid, Matrix::Zero(solid.vertex_count(), 2)), UsageError);
  EXPECT_THROW(boundary_crossings(solid, Matrix::Zero(solid.vertex_count(), 2)), UsageError);
}

TEST(BoundaryCrossings, CountsProperIntersections) {
  const Domain strip(rectangle_mesh({.width = 4.0, .h = 1.0}));
  EXPECT_EQ(boundary_crossings(strip, strip.positions()), 0);
  // Fold the strip over itself: the right end comes to lie across the left one.
  Matrix folded(strip.vertex_count(), 2);
  for (Index v = 0; v < strip.vertex_count(); ++v) {
    const double x = strip.positions()(v, 0);
    const double y = strip.positions()(v, 1);
    if (x <= 2.0)
      folded.row(v) << x, y;
    else if (x <= 3.0)
      folded.row(v) << 2.0, y + 3.0;
    else
      folded.row(v) << 0.5 + 0.2 * y, 0.5 - 3.0 * (y - 0.5);
  }
  EXPECT_GT(boundary_crossings(strip, folded), 0);
}

}  // namespace
}  // namespace variform
