// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include "framework/base/error.h"
#include "framework/experiment/raster.h"

namespace variform {
namespace {

using Eigen::Vector3d;

RasterTriangle triangle(const Vector3d& a, const Vector3d& b, const Vector3d& c, const Rgb& colour) {
  RasterTriangle result;
  result.corners = {a, b, c};
  result.normals = {Vector3d::Zero(), Vector3d::Zero(), Vector3d::Zero()};
  result.colour = colour;
  result.is_lit = false;
  return result;
}

const Rgb kRed(1, 0, 0);
const Rgb kGreen(0, 1, 0);

std::uint32_t pixel(const Raster& raster, int x, int y) {
  return raster.pixels()[static_cast<std::size_t>(y * raster.width() + x)];
}

double alpha_sum(const Raster& raster) {
  double sum = 0.0;
  for (const std::uint32_t value : raster.pixels()) sum += (value >> 24) / 255.0;
  return sum;
}

/// Sphere of radius 1 around the origin, n circles of latitude and 2 n of longitude.
Mesh sphere(int n) {
  Mesh mesh;
  mesh.positions.resize(2 * n * (n - 1) + 2, 3);
  std::vector<std::array<Index, 3>> cells;
  const auto at = [n](int i, int j) {  // i: 1 ... n - 1 from the north pole
    return static_cast<Index>((i - 1) * 2 * n + (j % (2 * n)));
  };
  const auto north = static_cast<Index>(2 * n * (n - 1));
  for (int i = 1; i < n; ++i) {
    for (int j = 0; j < 2 * n; ++j) {
      const double theta = std::numbers::pi * i / n;
      const double phi = std::numbers::pi * j / n;
      mesh.positions.row(at(i, j)) << std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta);
    }
  }
  mesh.positions.row(north) << 0, 0, 1;
  mesh.positions.row(north + 1) << 0, 0, -1;
  for (int j = 0; j < 2 * n; ++j) {
    cells.push_back({north, at(1, j), at(1, j + 1)});
    cells.push_back({north + 1, at(n - 1, j + 1), at(n - 1, j)});
    for (int i = 1; i + 1 < n; ++i) {
      cells.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      cells.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  mesh.cells.resize(static_cast<Eigen::Index>(cells.size()), 3);
  for (std::size_t c = 0; c < cells.size(); ++c) {
    for (int k = 0; k < 3; ++k) mesh.cells(static_cast<Eigen::Index>(c), k) = cells[c][static_cast<std::size_t>(k)];
  }
  return mesh;
}

/// The mesh in the middle of a picture of size x size pixels; colours by triangle.
Raster picture_of(const Mesh& mesh, const View& view, int size, double scale, bool lit = true) {
  Raster raster(size, size);
  const Surface surface = surface_of(mesh);
  const Matrix normals = corner_normals(mesh.positions, surface.triangles);
  for (Eigen::Index t = 0; t < surface.triangles.rows(); ++t) {
    RasterTriangle drawn;
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const Vector3d seen = view(mesh.positions.row(surface.triangles(t, k)));
      drawn.corners[i] = Vector3d(size / 2.0 + scale * seen.x(), size / 2.0 - scale * seen.y(), scale * seen.z());
      drawn.normals[i] = view.turned(normals.row(3 * t + k));
    }
    drawn.is_lit = lit;
    raster.draw(drawn);
  }
  return raster;
}

TEST(Raster, TheNearerTriangleIsSeenWhateverTheOrder) {
  const RasterTriangle near = triangle({0, 0, 2}, {40, 0, 2}, {0, 40, 2}, kRed);
  const RasterTriangle far = triangle({0, 0, 1}, {40, 0, 1}, {0, 40, 1}, kGreen);
  for (const bool near_first : {true, false}) {
    Raster raster(40, 40);
    raster.draw(near_first ? near : far);
    raster.draw(near_first ? far : near);
    EXPECT_EQ(pixel(raster, 10, 10), 0xffff0000u);
    EXPECT_EQ(pixel(raster, 39, 39), 0u) << "nothing there";
  }
}

TEST(Raster, TrianglesThatCrossAreSeenOnTheirOwnSides) {
  // Both fill the left upper half; one rises to the right, the other falls.
  Raster raster(40, 40);
  raster.draw(triangle({-40, 0, -40}, {80, 0, 80}, {-40, 120, -40}, kRed));
  raster.draw(triangle({-40, 0, 80}, {80, 0, -40}, {-40, 120, 80}, kGreen));
  EXPECT_EQ(pixel(raster, 5, 5), 0xff00ff00u);
  EXPECT_EQ(pixel(raster, 34, 5), 0xffff0000u);
}

TEST(Raster, CoverageIsTheAreaAndNeighboursLeaveNoSeam) {
  Raster raster(50, 50);
  raster.draw(triangle({3.3, 4.1, 0}, {41.7, 9.9, 0}, {12.2, 44.4, 0}, kRed));
  const double area = 0.5 * ((41.7 - 3.3) * (44.4 - 4.1) - (12.2 - 3.3) * (9.9 - 4.1));
  EXPECT_NEAR(alpha_sum(raster), area, 0.01 * area);

  Raster square(20, 20);
  square.draw(triangle({0, 0, 0}, {20, 0, 0}, {20, 20, 0}, kRed));
  square.draw(triangle({0, 0, 0}, {20, 20, 0}, {0, 20, 0}, kRed));
  for (const std::uint32_t value : square.pixels()) EXPECT_EQ(value, 0xffff0000u);
}

TEST(Raster, TheSilhouetteOfASphereHasTheAreaOfItsDisc) {
  const Mesh mesh = sphere(60);
  constexpr double kRadius = 60.0;
  for (const Vector3d& direction : {Vector3d(1, 0, 0.3), Vector3d(-2, 1, 1), Vector3d(0.1, 0.2, -1)}) {
    const View view({.direction = direction}, Vector3d::Zero(), 5.0);
    const double area = alpha_sum(picture_of(mesh, view, 140, kRadius));
    EXPECT_NEAR(area, std::numbers::pi * kRadius * kRadius, 0.01 * std::numbers::pi * kRadius * kRadius);
  }
  // In perspective the silhouette is the cone that touches: its radius at the centre is d / sqrt(d^2 - 1).
  const View view({.perspective = true}, Vector3d::Zero(), 5.0);
  const double expected = std::numbers::pi * kRadius * kRadius * 25.0 / 24.0;
  EXPECT_NEAR(alpha_sum(picture_of(mesh, view, 140, kRadius)), expected, 0.01 * expected);
}

TEST(Raster, TheLitSideIsBrighterAndBothSidesAreLit) {
  const Mesh mesh = sphere(40);
  const View view({}, Vector3d::Zero(), 5.0);
  const Raster raster = picture_of(mesh, view, 100, 45.0);
  const auto green = [](std::uint32_t value) { return value >> 8 & 255u; };
  EXPECT_GT(green(pixel(raster, 40, 40)), green(pixel(raster, 72, 72)) + 30) << "the lamp is above left";

  Mesh inside_out = mesh;
  inside_out.cells.col(0).swap(inside_out.cells.col(1));
  EXPECT_EQ(picture_of(inside_out, view, 100, 45.0).pixels(), raster.pixels());
}

TEST(Raster, TheSamePictureHasTheSameBytes) {
  const Mesh mesh = sphere(20);
  const View view({.perspective = true}, Vector3d::Zero(), 4.0);
  EXPECT_EQ(picture_of(mesh, view, 64, 25.0).pixels(), picture_of(mesh, view, 64, 25.0).pixels());
}

TEST(Raster, TheCheckerboardHasUnitSquaresAndIsLinearOnTheTriangleInPerspective) {
  RasterTriangle drawn = triangle({0, 0, 0}, {80, 0, 0}, {0, 80, 0}, kRed);
  drawn.is_textured = true;
  drawn.uv = {Eigen::Vector2d(0, 0), Eigen::Vector2d(4, 0), Eigen::Vector2d(0, 4)};
  Raster raster(80, 80);
  raster.draw(drawn);
  const std::uint32_t light = pixel(raster, 10, 10);
  const std::uint32_t dark = pixel(raster, 30, 10);
  EXPECT_NE(light, dark);
  EXPECT_EQ(pixel(raster, 10, 30), dark);
  EXPECT_EQ(pixel(raster, 30, 30), light);
  EXPECT_EQ(pixel(raster, 50, 10), light);

  // The corner with u = 4 is farther away: u = 1 moves from 20 pixels to 32.
  drawn.weights = {1.0, 0.5, 1.0};
  Raster perspective(80, 80);
  perspective.draw(drawn);
  for (const int x : {5, 24, 56, 66}) {
    const double b = (x + 0.5) / 80.0;
    const double u = 4.0 * 0.5 * b / (0.5 * b + (1.0 - b));
    EXPECT_EQ(pixel(perspective, x, 1), std::fmod(std::floor(u), 2.0) == 0.0 ? light : dark) << x;
  }
  EXPECT_EQ(pixel(perspective, 24, 1), light) << "where it would be dark without perspective";
}

TEST(Raster, EdgesAreInsideTheTriangleAndNoWiderThanAsked) {
  RasterTriangle drawn = triangle({0, 0, 0}, {80, 0, 0}, {0, 80, 0}, Rgb::Ones());
  drawn.edge_opacity = 1.0f;
  drawn.edge_width = 3.0;
  drawn.edge_colour = kRed;
  Raster raster(80, 80);
  raster.draw(drawn);
  EXPECT_EQ(pixel(raster, 20, 1), 0xffff0000u);
  EXPECT_EQ(pixel(raster, 1, 20), 0xffff0000u);
  EXPECT_EQ(pixel(raster, 20, 4), 0xffffffffu);
}

TEST(Raster, PointsBehindSomethingAreHidden) {
  Raster raster(40, 40);
  raster.draw(triangle({0, 0, 10}, {40, 0, 10}, {0, 40, 10}, kRed));
  EXPECT_TRUE(raster.is_visible({10, 10, 11}, 0.0));
  EXPECT_TRUE(raster.is_visible({10, 10, 9.8}, 0.5)) << "within the slack";
  EXPECT_FALSE(raster.is_visible({10, 10, 5}, 0.5));
  EXPECT_TRUE(raster.is_visible({35, 35, 5}, 0.0)) << "beside it";
  EXPECT_FALSE(raster.is_visible(Vector3d::Constant(std::nan("")), 0.0));
}

TEST(Raster, LeavesOutWhatIsNoTriangleAndRefusesPicturesWithoutPixels) {
  Raster raster(10, 10);
  raster.draw(triangle({0, 0, 0}, {std::nan(""), 0, 0}, {0, 10, 0}, kRed));
  raster.draw(triangle({0, 0, 0}, {5, 5, 0}, {10, 10, 0}, kRed));
  raster.draw(triangle({-1e9, -1e9, 0}, {-1e8, -1e9, 0}, {-1e9, -1e8, 0}, kRed));
  EXPECT_EQ(alpha_sum(raster), 0.0);
  EXPECT_THROW(Raster(0, 10), UsageError);
}

TEST(View, ShowsTheSideThatTheCameraIsOn) {
  const Vector3d centre(1, 2, 3);
  const View front({.direction = {0, -3, 0}, .up = {0, 0, 1}}, centre, 1.0);
  EXPECT_TRUE(front(centre).isZero());
  EXPECT_TRUE(front(centre + Vector3d(1, 0, 0)).isApprox(Vector3d(1, 0, 0))) << "x to the right";
  EXPECT_TRUE(front(centre + Vector3d(0, 0, 1)).isApprox(Vector3d(0, 1, 0))) << "z upwards";
  EXPECT_TRUE(front(centre + Vector3d(0, -1, 0)).isApprox(Vector3d(0, 0, 1))) << "what faces the eye is near";
  const View side({.direction = {5, 0, 0}, .up = {0, 1, 1}}, centre, 1.0);
  EXPECT_NEAR(side(centre + Vector3d(0, 1, 1)).x(), 0.0, 1e-12);
  EXPECT_GT(side(centre + Vector3d(0, 1, 1)).y(), 0.0);
  EXPECT_THROW(View({.direction = {0, 0, 1}, .up = {0, 0, 2}}, centre, 1.0), UsageError);
  EXPECT_THROW(View({.direction = {0, 0, 0}}, centre, 1.0), UsageError);
  EXPECT_THROW(View({.zoom = 0.0}, centre, 1.0), UsageError);
}

TEST(View, InPerspectiveNearThingsAreLargerAndPlanesStayPlanes) {
  const View view({.direction = {0, 0, 1}, .up = {0, 1, 0}, .perspective = true}, Vector3d::Zero(), 4.0);
  EXPECT_TRUE(view({1, 1, 0}).isApprox(Vector3d(1, 1, 0)));
  EXPECT_TRUE(view({1, 1, 2}).isApprox(Vector3d(2, 2, 4)));
  EXPECT_TRUE(view({1, 1, 5}).array().isNaN().all()) << "behind the eye";
  // Images of four points of a plane lie in a plane.
  const auto at = [&view](double x, double y) { return view({x, y, 0.5 * x - 0.2 * y + 0.3}); };
  const Vector3d a = at(0, 0);
  Eigen::Matrix3d edges;
  edges << at(1, 0) - a, at(0, 1) - a, at(0.7, -0.6) - a;
  EXPECT_NEAR(edges.determinant(), 0.0, 1e-12);
  EXPECT_NEAR(view.magnification(view({0, 0, 2}).z()), 2.0, 1e-12);
}

TEST(Surface, OfTetrahedraIsTheirBoundary) {
  // Two tetrahedra with a common face: six faces are seen, each with its cell.
  Mesh mesh;
  mesh.positions = (Matrix(5, 3) << 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1).finished();
  mesh.cells = (IndexMatrix(2, 4) << 0, 1, 2, 3, 1, 2, 3, 4).finished();
  const Surface surface = surface_of(mesh);
  ASSERT_EQ(surface.triangles.rows(), 6);
  std::map<Index, int> faces;
  for (std::size_t t = 0; t < 6; ++t) {
    ++faces[surface.cells[t]];
    for (int k = 0; k < 3; ++k) {
      const auto cell = mesh.cells.row(surface.cells[t]);
      EXPECT_TRUE((cell.array() == surface.triangles(static_cast<Eigen::Index>(t), k)).any());
    }
    std::array<Index, 3> sorted = {surface.triangles(static_cast<Eigen::Index>(t), 0),
                                   surface.triangles(static_cast<Eigen::Index>(t), 1),
                                   surface.triangles(static_cast<Eigen::Index>(t), 2)};
    std::sort(sorted.begin(), sorted.end());
    EXPECT_NE(sorted, (std::array<Index, 3>{1, 2, 3})) << "the common face is inside";
  }
  EXPECT_EQ(faces, (std::map<Index, int>{{0, 3}, {1, 3}}));

  // A cell without place hides nothing.
  mesh.positions(4, 1) = std::nan("");
  EXPECT_EQ(surface_of(mesh).triangles.rows(), 4);
}

TEST(CornerNormals, AreRoundOnASphereAndSharpOnABox) {
  const Mesh mesh = sphere(30);
  const Matrix round = corner_normals(mesh.positions, mesh.cells);
  for (Eigen::Index t = 0; t < mesh.cells.rows(); ++t) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_GT(std::abs(round.row(3 * t + k).dot(mesh.positions.row(mesh.cells(t, k)))), 0.99);
    }
  }
  // Two squares at a right angle.
  const Matrix positions = (Matrix(4, 3) << 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1).finished();
  const IndexMatrix triangles = (IndexMatrix(2, 3) << 0, 2, 1, 0, 1, 3).finished();
  const Matrix sharp = corner_normals(positions, triangles);
  for (int k = 0; k < 3; ++k) {
    EXPECT_TRUE(sharp.row(k).isApprox(Eigen::RowVector3d(0, 0, 1)));
    EXPECT_TRUE(sharp.row(3 + k).isApprox(Eigen::RowVector3d(1, 0, 0)));
  }
}

}  // namespace
}  // namespace variform
