// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/operators/distortion.h"

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

TEST(Distortion, RefusesSurfacesAndWrongSizes) {
  const Domain surface(bar_surface_mesh(1.0, 1.0, 1.0, 0.5));
  EXPECT_THROW(distortion(surface, surface.positions()), UsageError);
  const Domain square(rectangle_mesh({.h = 0.5}));
  EXPECT_THROW(distortion(square, Matrix::Zero(3, 2)), UsageError);
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
