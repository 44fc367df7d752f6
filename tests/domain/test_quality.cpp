// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "framework/domain/domain.h"
#include "framework/domain/mesh.h"
#include "framework/domain/quality.h"

namespace variform {
namespace {

constexpr double kTolerance = 1e-12;
const double kSqrt2 = std::numbers::sqrt2;
const double kSqrt3 = std::numbers::sqrt3;

/// Domain of a single cell whose corners are the rows.
Domain single_cell(const Matrix& corners, DomainKind kind) {
  Mesh mesh{corners, IndexMatrix(1, corners.rows())};
  for (Index i = 0; i < corners.rows(); ++i) mesh.cells(0, i) = i;
  return Domain(mesh, kind);
}

Matrix rows(std::initializer_list<std::initializer_list<double>> values) {
  Matrix matrix(static_cast<Index>(values.size()), static_cast<Index>(values.begin()->size()));
  Index i = 0;
  for (const auto& row : values) {
    Index j = 0;
    for (const double value : row) matrix(i, j++) = value;
    ++i;
  }
  return matrix;
}

TEST(Quality, EquilateralTriangle) {
  const MeshQuality quality = mesh_quality(single_cell(rows({{0, 0}, {2, 0}, {1, kSqrt3}}), DomainKind::planar));
  EXPECT_NEAR(quality.min_angle, 60.0, kTolerance * 60);
  EXPECT_NEAR(quality.max_angle, 60.0, kTolerance * 60);
  EXPECT_NEAR(quality.min_measure, kSqrt3, kTolerance);
  EXPECT_NEAR(quality.max_radius_ratio, 2.0, kTolerance);
  EXPECT_NEAR(quality.min_mean_ratio, 1.0, kTolerance);
  EXPECT_NEAR(quality.mean_edge, 2.0, kTolerance);
  EXPECT_EQ(quality.measure_ratio, 1.0);
}

TEST(Quality, RightTriangleInThePlaneAndInSpace) {
  // Sides 3, 4, 5: circumradius 5/2, inradius 1.
  const Domain domains[] = {
      single_cell(rows({{0, 0}, {4, 0}, {0, 3}}), DomainKind::planar),
      single_cell(rows({{1, 1, 1}, {1, 5, 1}, {1, 1, 4}}), DomainKind::surface),
  };
  for (const Domain& domain : domains) {
    const MeshQuality quality = mesh_quality(domain);
    EXPECT_NEAR(quality.min_angle, std::atan2(3.0, 4.0) * 180.0 / std::numbers::pi, 1e-10);
    EXPECT_NEAR(quality.max_angle, 90.0, 1e-10);
    EXPECT_NEAR(quality.min_measure, 6.0, kTolerance);
    EXPECT_NEAR(quality.max_radius_ratio, 2.5, kTolerance);
    EXPECT_NEAR(quality.min_mean_ratio, 4.0 * kSqrt3 * 6.0 / 50.0, kTolerance);
    EXPECT_NEAR(quality.min_edge, 3.0, kTolerance);
    EXPECT_NEAR(quality.max_edge, 5.0, kTolerance);
    EXPECT_NEAR(quality.mean_edge, 4.0, kTolerance);
  }
}

TEST(Quality, RegularTetrahedron) {
  // Every other corner of a cube.
  const Domain domain = single_cell(rows({{0, 0, 0}, {1, 1, 0}, {0, 1, 1}, {1, 0, 1}}), DomainKind::tetrahedral);
  const MeshQuality quality = mesh_quality(domain);
  const double dihedral = std::acos(1.0 / 3.0) * 180.0 / std::numbers::pi;
  EXPECT_NEAR(quality.min_angle, dihedral, 1e-10);
  EXPECT_NEAR(quality.max_angle, dihedral, 1e-10);
  EXPECT_NEAR(quality.min_measure, 1.0 / 3.0, kTolerance);
  EXPECT_NEAR(quality.max_radius_ratio, 3.0, kTolerance);
  EXPECT_NEAR(quality.min_mean_ratio, 1.0, kTolerance);
  EXPECT_NEAR(quality.min_edge, kSqrt2, kTolerance);
  EXPECT_NEAR(quality.max_edge, kSqrt2, kTolerance);
}

TEST(Quality, CubeCorner) {
  const Domain domain = single_cell(rows({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}), DomainKind::tetrahedral);
  const MeshQuality quality = mesh_quality(domain);
  // Circumradius sqrt(3)/2, volume 1/6, surface 3/2 + sqrt(3)/2; the oblique face meets the others at acos(1/sqrt(3)).
  const double inradius = 3.0 * (1.0 / 6.0) / (1.5 + kSqrt3 / 2.0);
  EXPECT_NEAR(quality.max_radius_ratio, kSqrt3 / 2.0 / inradius, kTolerance);
  EXPECT_NEAR(quality.min_angle, std::acos(1.0 / kSqrt3) * 180.0 / std::numbers::pi, 1e-10);
  EXPECT_NEAR(quality.max_angle, 90.0, 1e-10);
  // 12 (3V)^(2/3) / sum of squared edges.
  EXPECT_NEAR(quality.min_mean_ratio, 12.0 * std::pow(0.5, 2.0 / 3.0) / 9.0, kTolerance);
  EXPECT_NEAR(quality.mean_edge, (1.0 + kSqrt2) / 2.0, kTolerance);
}

TEST(Quality, WorstAndBestOfSeveralCells) {
  Mesh mesh{rows({{0, 0}, {4, 0}, {0, 3}, {4, 6}}), IndexMatrix(2, 3)};
  mesh.cells << 0, 1, 2, 1, 3, 2;
  const Domain domain(mesh);
  const MeshQuality quality = mesh_quality(domain);
  EXPECT_NEAR(quality.measure_ratio, 2.0, kTolerance);
  EXPECT_NEAR(quality.min_measure, 6.0, kTolerance);
  EXPECT_NEAR(quality.max_measure, 12.0, kTolerance);
  const Vector ratios = radius_ratios(domain);
  ASSERT_EQ(ratios.size(), 2);
  EXPECT_NEAR(ratios(0), 2.5, kTolerance);
  EXPECT_NEAR(ratios(1), 5.0 * 5.0 * 6.0 * 16.0 / (8.0 * 144.0), kTolerance);  // sides 5, 5, 6
  EXPECT_NEAR(quality.max_radius_ratio, ratios.maxCoeff(), kTolerance);
  EXPECT_NEAR(quality.mean_edge, (3.0 + 4.0 + 5.0 + 5.0 + 5.0 + 6.0) / 6.0, kTolerance);
}

}  // namespace
}  // namespace variform
