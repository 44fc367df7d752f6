// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
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

constexpr std::array kTessellations = {Tessellation::regular, Tessellation::alternating, Tessellation::random,
                                       Tessellation::graded};

bool same(const Mesh& a, const Mesh& b) {
  return a.positions.rows() == b.positions.rows() && a.cells.rows() == b.cells.rows() && a.positions == b.positions &&
         a.cells == b.cells;
}

/// Vertices - edges + triangles.
Index euler_characteristic(const Mesh& mesh) {
  std::set<std::pair<Index, Index>> edges;
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) edges.insert(std::minmax({mesh.cells(t, i), mesh.cells(t, (i + 1) % 3)}));
  }
  return mesh.vertex_count() - static_cast<Index>(edges.size()) + mesh.cell_count();
}

/// Checks what every generator promises and gives the domain.
Domain good_domain(const Mesh& mesh, DomainKind kind) {
  for (const Defect& defect : check_mesh(mesh)) ADD_FAILURE() << defect.message;
  Domain domain(mesh);
  EXPECT_EQ(domain.kind(), kind);
  EXPECT_EQ(domain.component_count(), 1);
  if (kind != DomainKind::tetrahedral) {
    // At most one boundary edge starts at each vertex: boundaries do not touch.
    std::vector<int> starts(static_cast<std::size_t>(domain.vertex_count()), 0);
    for (Index f = 0; f < domain.boundary_facets().rows(); ++f) EXPECT_EQ(starts[domain.boundary_facets()(f, 0)]++, 0);
  }
  if (kind == DomainKind::planar) {
    for (Index t = 0; t < mesh.cell_count(); ++t) {
      const auto a = mesh.positions.row(mesh.cells(t, 0));
      const auto b = mesh.positions.row(mesh.cells(t, 1));
      const auto c = mesh.positions.row(mesh.cells(t, 2));
      EXPECT_GT((b(0) - a(0)) * (c(1) - a(1)) - (b(1) - a(1)) * (c(0) - a(0)), 0.0) << "cell " << t;
    }
  }
  return domain;
}

void expect_edges_about(const Domain& domain, double h) {
  const double mean = mesh_quality(domain).mean_edge;
  EXPECT_GT(mean, h / 1.5);
  EXPECT_LT(mean, h * 1.5);
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

/// The normals of all cells go along what `direction` gives at their centres.
template <class Direction>
void expect_normals_along(const Domain& domain, const Direction& direction) {
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::RowVector3d centre = Eigen::RowVector3d::Zero();
    for (const Index v : domain.cells().row(t)) centre += domain.positions().row(v) / 3.0;
    EXPECT_GT(domain.normals().row(t).dot(direction(centre)), 0.0) << "cell " << t;
  }
}

/// Volume that a closed surface encloses, by the divergence theorem.
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

const Eigen::RowVector3d kUp(0.0, 0.0, 1.0);

/// Area of the graph or image of a map over a rectangle, by the midpoint rule with finite differences.
template <class Map>
double area_of_image(const Map& map, double x0, double x1, double y0, double y1) {
  constexpr int kSteps = 600;
  constexpr double kDelta = 1e-5;
  const double dx = (x1 - x0) / kSteps;
  const double dy = (y1 - y0) / kSteps;
  double area = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      const double x = x0 + (i + 0.5) * dx;
      const double y = y0 + (j + 0.5) * dy;
      const Eigen::Vector3d along_x = (map(x + kDelta, y) - map(x - kDelta, y)) / (2.0 * kDelta);
      const Eigen::Vector3d along_y = (map(x, y + kDelta) - map(x, y - kDelta)) / (2.0 * kDelta);
      area += along_x.cross(along_y).norm() * dx * dy;
    }
  }
  return area;
}

TEST(Rectangle, HasTheAreaAndValidCells) {
  for (const Tessellation tessellation : kTessellations) {
    for (const double h : {0.8, 0.25, 0.1}) {
      for (const double jitter : {0.0, 0.2, 0.45}) {
        const Mesh mesh = rectangle_mesh(
            {.width = 2.0, .height = 0.75, .h = h, .tessellation = tessellation, .jitter = jitter, .grading = 1.1});
        const Domain domain = good_domain(mesh, DomainKind::planar);
        EXPECT_NEAR(domain.total_measure(), 1.5, 1e-14);
        EXPECT_EQ(euler_characteristic(mesh), 1);
        EXPECT_EQ(mesh.positions.colwise().minCoeff(), Eigen::RowVector2d(0.0, 0.0));
        EXPECT_EQ(mesh.positions.colwise().maxCoeff(), Eigen::RowVector2d(2.0, 0.75));
        expect_edges_about(domain, h);
      }
    }
  }
}

TEST(Rectangle, TessellationsDiffer) {
  std::vector<Mesh> meshes;
  for (const Tessellation tessellation : kTessellations) {
    meshes.push_back(rectangle_mesh({.h = 0.125, .tessellation = tessellation}));
    for (std::size_t i = 0; i + 1 < meshes.size(); ++i) EXPECT_FALSE(same(meshes[i], meshes.back()));
  }
}

TEST(Rectangle, GradedCellsGrowFromTheOriginByTheGrading) {
  const Mesh mesh = rectangle_mesh({.h = 0.125, .tessellation = Tessellation::graded, .grading = 1.5});
  for (Index i = 1; i < 8; ++i) {
    const auto x = [&](Index column) { return mesh.positions(column, 0); };
    EXPECT_NEAR((x(i + 1) - x(i)) / (x(i) - x(i - 1)), 1.5, 1e-12);
  }
  EXPECT_NEAR(mesh_quality(Domain(mesh)).measure_ratio, std::pow(1.5, 14), 1e-9 * std::pow(1.5, 14));
}

TEST(Rectangle, SeedsDecide) {
  const auto mesh = [](std::uint64_t seed) { return rectangle_mesh({.h = 0.1, .jitter = 0.2, .seed = seed}); };
  EXPECT_TRUE(same(mesh(1), mesh(1)));
  EXPECT_FALSE(same(mesh(1), mesh(2)));
  EXPECT_NE(mesh(1).positions, mesh(2).positions);
  EXPECT_NE(mesh(1).cells, mesh(2).cells);
}

TEST(Rectangle, RandomChoicesAreTheSameEverywhere) {
  // The highest bits of the first outputs of splitmix64 for seed 1, from its definition.
  const Mesh mesh = rectangle_mesh({.width = 8.0, .h = 1.0, .seed = 1});
  std::vector<int> falling;
  for (Index t = 0; t < mesh.cell_count(); t += 2) falling.push_back(mesh.cells(t, 2) == mesh.cells(t, 0) + 9 ? 1 : 0);
  EXPECT_EQ(falling, (std::vector<int>{1, 1, 1, 0, 0, 1, 1, 1}));
}

TEST(Disk, ConvergesToItsAreaWithOrderTwo) {
  std::vector<double> errors;
  for (const double h : {0.4, 0.2, 0.1, 0.05}) {
    const Mesh mesh = disk_mesh(2.0, h);
    const Domain domain = good_domain(mesh, DomainKind::planar);
    EXPECT_EQ(euler_characteristic(mesh), 1);
    EXPECT_GT(mesh_quality(domain).min_angle, 40.0);
    expect_edges_about(domain, h);
    errors.push_back(4.0 * pi - domain.total_measure());
  }
  for (std::size_t i = 1; i < errors.size(); ++i) EXPECT_NEAR(std::log2(errors[i - 1] / errors[i]), 2.0, 0.05);
}

TEST(Disk, CoarsestIsAHexagon) {
  const Mesh mesh = disk_mesh(1.0, 1.0);
  EXPECT_EQ(mesh.cell_count(), 6);
  EXPECT_NEAR(good_domain(mesh, DomainKind::planar).total_measure(), 1.5 * std::numbers::sqrt3, 1e-14);
}

TEST(Annulus, ConvergesToItsAreaWithOrderTwo) {
  std::vector<double> errors;
  for (const double h : {0.2, 0.1, 0.05, 0.025}) {
    const Mesh mesh = annulus_mesh(0.5, 1.0, h);
    const Domain domain = good_domain(mesh, DomainKind::planar);
    EXPECT_EQ(euler_characteristic(mesh), 0);
    EXPECT_GT(mesh_quality(domain).min_angle, 30.0);
    expect_edges_about(domain, h);
    errors.push_back(0.75 * pi - domain.total_measure());
  }
  for (std::size_t i = 1; i < errors.size(); ++i) EXPECT_NEAR(std::log2(errors[i - 1] / errors[i]), 2.0, 0.15);
}

TEST(Annulus, IsValidForAllRatiosOfRadii) {
  for (const double inner : {0.01, 0.1, 0.3, 0.9, 0.99}) {
    for (const double layers : {1.0, 1.4, 3.0}) {
      const Mesh mesh = annulus_mesh(inner, 1.0, (1.0 - inner) / layers);
      good_domain(mesh, DomainKind::planar);
      EXPECT_EQ(euler_characteristic(mesh), 0);
    }
  }
}

TEST(Bar, SurfaceIsClosedAndOutward) {
  for (const double h : {3.0, 0.7, 0.3}) {
    const Mesh mesh = bar_surface_mesh(3.0, 1.0, 0.5, h);
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(domain.boundary_facets().rows(), 0);
    EXPECT_EQ(euler_characteristic(mesh), 2);
    EXPECT_NEAR(domain.total_measure(), 2.0 * (3.0 + 0.5 + 1.5), 1e-13);
    EXPECT_NEAR(enclosed_volume(mesh), 1.5, 1e-13);
    if (h < 0.5) expect_edges_about(domain, h);
  }
}

TEST(Bar, TetrahedraFillIt) {
  for (const double h : {3.0, 0.7, 0.3}) {
    const Mesh mesh = bar_tet_mesh(3.0, 1.0, 0.5, h);
    const Domain domain = good_domain(mesh, DomainKind::tetrahedral);
    EXPECT_NEAR(domain.total_measure(), 1.5, 1e-13);
    if (h < 0.5) expect_edges_about(domain, h);

    // Its boundary is the surface mesh: as many triangles, of the same corners.
    const Mesh surface = bar_surface_mesh(3.0, 1.0, 0.5, h);
    using Corners = std::set<std::array<double, 3>>;
    const auto corners = [](const Mesh& m, const auto& triangle) {
      Corners result;
      for (const Index v : triangle) result.insert({m.positions(v, 0), m.positions(v, 1), m.positions(v, 2)});
      return result;
    };
    std::set<Corners> outer;
    for (Index f = 0; f < domain.boundary_facets().rows(); ++f)
      outer.insert(corners(mesh, domain.boundary_facets().row(f)));
    std::set<Corners> expected;
    for (Index t = 0; t < surface.cell_count(); ++t) expected.insert(corners(surface, surface.cells.row(t)));
    EXPECT_EQ(outer, expected);
  }
}

TEST(Bar, JitterMovesInteriorVerticesOnlyAndKeepsAllCellsPositive) {
  const Mesh plain = bar_tet_mesh(1.0, 1.0, 1.0, 1.0 / 6);
  const Domain before(plain);
  for (const double jitter : {0.2, 0.45}) {
    const Mesh mesh = bar_tet_mesh(1.0, 1.0, 1.0, 1.0 / 6, jitter, 3);
    EXPECT_EQ(mesh.cells, plain.cells);
    const Domain domain = good_domain(mesh, DomainKind::tetrahedral);
    EXPECT_NEAR(domain.total_measure(), 1.0, 1e-13);
    EXPECT_GT(domain.cell_measures().minCoeff(), 0.04 * before.cell_measures().minCoeff());
    EXPECT_LE((mesh.positions - plain.positions).cwiseAbs().maxCoeff(), jitter / 6.0);
    EXPECT_GT((mesh.positions - plain.positions).cwiseAbs().maxCoeff(), 0.9 * 0.2 / 6.0);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      EXPECT_EQ(mesh.positions.row(v) == plain.positions.row(v), before.boundary_vertices()[v]) << v;
    }
  }
  EXPECT_TRUE(same(bar_tet_mesh(1, 1, 1, 0.25, 0.2, 5), bar_tet_mesh(1, 1, 1, 0.25, 0.2, 5)));
  EXPECT_FALSE(same(bar_tet_mesh(1, 1, 1, 0.25, 0.2, 5), bar_tet_mesh(1, 1, 1, 0.25, 0.2, 6)));
}

TEST(Bump, IsTheGraphOfItsFunctionOverTheRectangle) {
  const RectangleOptions base = {.h = 1.0 / 32, .jitter = 0.2, .seed = 7};
  const Mesh mesh = bump_mesh({.base = base});
  const Mesh flat = rectangle_mesh(base);
  EXPECT_EQ(mesh.cells, flat.cells);
  EXPECT_EQ(mesh.positions.leftCols(2), flat.positions);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const double squared = std::pow(flat.positions(v, 0) - 0.5, 2) + std::pow(flat.positions(v, 1) - 0.5, 2);
    EXPECT_NEAR(mesh.positions(v, 2), 0.3 * std::exp(-20.0 * squared), 1e-15);
  }
  const Domain domain = good_domain(mesh, DomainKind::surface);
  EXPECT_EQ(euler_characteristic(mesh), 1);
  expect_normals_along(domain, [](const auto&) { return kUp; });
  const double area = area_of_image(
      [](double x, double y) {
        return Eigen::Vector3d(x, y, 0.3 * std::exp(-20.0 * (std::pow(x - 0.5, 2) + std::pow(y - 0.5, 2))));
      },
      0.0, 1.0, 0.0, 1.0);
  EXPECT_NEAR(domain.total_measure(), area, 0.005 * area);

  const Mesh dent = bump_mesh({.base = base, .height = -0.1, .sharpness = 50.0, .centre = {0.25, 0.75}});
  Index lowest = 0;
  dent.positions.col(2).minCoeff(&lowest);
  EXPECT_LT((dent.positions.row(lowest) - Eigen::RowVector3d(0.25, 0.75, -0.1)).norm(), 0.05);
}

TEST(HalfCylinder, IsBentWithoutStretch) {
  for (const double columns : {2.0, 5.0, 31.0}) {
    const Mesh mesh = half_cylinder_mesh(0.5, 1.0, {.h = 0.5 * pi / columns, .tessellation = Tessellation::regular});
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(euler_characteristic(mesh), 1);
    EXPECT_NEAR(domain.total_measure(), columns * std::sin(pi / (2.0 * columns)), 1e-13);  // chords of the arc
  }
  const Mesh mesh = half_cylinder_mesh(2.0, 3.0, {.h = 0.25, .jitter = 0.3});
  const Domain domain = good_domain(mesh, DomainKind::surface);
  expect_edges_about(domain, 0.25);
  expect_normals_along(domain, [](const auto& p) { return Eigen::RowVector3d(p.x(), 0.0, p.z()); });
  for (const auto p : mesh.positions.rowwise()) {
    EXPECT_NEAR(std::hypot(p(0), p(2)), 2.0, 1e-14);
    EXPECT_GT(p(2), -1e-14);
  }
  EXPECT_EQ(mesh.positions.col(1).maxCoeff(), 3.0);
  EXPECT_NEAR(mesh.positions.col(0).maxCoeff(), 2.0, 1e-14);
}

TEST(Sphere, IsGeodesicClosedAndOutward) {
  for (const Index n : {1, 2, 3, 8, 21}) {
    const double h = 2.0 * std::atan(2.0) / n;
    const Mesh mesh = sphere_mesh(2.0, h);
    EXPECT_EQ(mesh.vertex_count(), 10 * n * n + 2);
    EXPECT_EQ(mesh.cell_count(), 20 * n * n);
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(domain.boundary_facets().rows(), 0);
    EXPECT_EQ(euler_characteristic(mesh), 2);
    expect_edges_about(domain, h);
    EXPECT_GT(mesh_quality(domain).min_angle, 50.0);
    for (const auto p : mesh.positions.rowwise()) EXPECT_NEAR(p.norm(), 2.0, 1e-14);
    expect_normals_along(domain, [](const auto& p) { return p; });
  }
  // A regular icosahedron of this circumradius has edges of 4 / sqrt(10 + 2 sqrt 5) of it.
  const double edge = 4.0 / std::sqrt(10.0 + 2.0 * std::sqrt(5.0));
  EXPECT_NEAR(Domain(sphere_mesh(1.0, 1.0)).total_measure(), 5.0 * std::numbers::sqrt3 * edge * edge, 1e-13);
}

TEST(Sphere, ConvergesToItsAreaAndVolumeWithOrderTwo) {
  std::vector<double> areas;
  std::vector<double> volumes;
  for (const Index n : {5, 10, 20}) {
    const Mesh mesh = sphere_mesh(1.0, std::atan(2.0) / n);
    areas.push_back(4.0 * pi - Domain(mesh).total_measure());
    volumes.push_back(4.0 / 3.0 * pi - enclosed_volume(mesh));
  }
  for (std::size_t i = 1; i < areas.size(); ++i) {
    EXPECT_NEAR(std::log2(areas[i - 1] / areas[i]), 2.0, 0.05);
    EXPECT_NEAR(std::log2(volumes[i - 1] / volumes[i]), 2.0, 0.05);
  }
}

TEST(Torus, ConvergesToItsAreaAndVolumeWithOrderTwo) {
  std::vector<double> areas;
  std::vector<double> volumes;
  for (const double h : {0.2, 0.1, 0.05}) {
    const Mesh mesh = torus_mesh(1.0, 0.4, h);
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(domain.boundary_facets().rows(), 0);
    EXPECT_EQ(euler_characteristic(mesh), 0);
    expect_edges_about(domain, h);
    expect_normals_along(domain, [](const Eigen::RowVector3d& p) -> Eigen::RowVector3d {
      return p - Eigen::RowVector3d(p.x(), p.y(), 0.0).normalized();
    });
    areas.push_back(4.0 * pi * pi * 0.4 - domain.total_measure());
    volumes.push_back(2.0 * pi * pi * 0.16 - enclosed_volume(mesh));
  }
  for (std::size_t i = 1; i < areas.size(); ++i) {
    EXPECT_NEAR(std::log2(areas[i - 1] / areas[i]), 2.0, 0.2);
    EXPECT_NEAR(std::log2(volumes[i - 1] / volumes[i]), 2.0, 0.2);
  }
}

TEST(Torus, CoarsestIsValid) {
  const Mesh mesh = torus_mesh(1.0, 0.9, 3.8);
  EXPECT_EQ(mesh.vertex_count(), 9);
  good_domain(mesh, DomainKind::surface);
  EXPECT_EQ(euler_characteristic(mesh), 0);
}

TEST(ThreeBalls, SwellOverNarrowerNecks) {
  for (const double h : {0.1, 1.0 / 48, 1.0 / 100}) {
    for (const double jitter : {0.0, 0.2}) {
      const Mesh mesh = three_balls_mesh({.h = h, .jitter = jitter});
      const Domain domain = good_domain(mesh, DomainKind::surface);
      EXPECT_EQ(euler_characteristic(mesh), 1);
      EXPECT_GT(mesh.positions.col(2).maxCoeff(), 0.32);
      EXPECT_LE(mesh.positions.col(2).maxCoeff(), 0.35 + 1e-12);
      EXPECT_EQ(mesh.positions.col(2).minCoeff(), 0.0);
      EXPECT_LT(mesh_quality(domain).max_edge, 2.5 * 1.5 * std::numbers::sqrt2 * h);
    }
  }
  // Two circles that touch, of ball and fillet, and a plane (Pappus): what one ball adds to the square.
  const double turn = std::acos(-2.0 / 3.0);
  const double foot = 0.21 * std::sin(turn);
  const double ball = 2.0 * pi * 0.14 * 0.14 * (1.0 - std::cos(turn));
  const double fillet = 2.0 * pi * 0.07 * (foot * turn - 0.07 * (1.0 - std::cos(turn)));
  const Mesh mesh = three_balls_mesh({.h = 1.0 / 150});
  const Domain domain(mesh);
  const double area = 1.0 + 3.0 * (ball + fillet - pi * foot * foot);
  EXPECT_NEAR(domain.total_measure(), area, 0.002 * area);
  EXPECT_GT(mesh_quality(domain).min_angle, 5.0);

  // On the balls, above the necks, normals point away from their centres; as many look down as a ball hanging over its
  // neck makes.
  const Eigen::RowVector3d centre(0.5, 0.73, 0.21);
  Index on_ball = 0;
  Index down = 0;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    Eigen::RowVector3d p = Eigen::RowVector3d::Zero();
    for (const Index v : domain.cells().row(t)) p += mesh.positions.row(v) / 3.0;
    if ((p - centre).norm() > 0.142 || p.z() < 0.13) continue;
    ++on_ball;
    if (domain.normals()(t, 2) < 0.0) ++down;
    EXPECT_GT(domain.normals().row(t).dot((p - centre).normalized()), 0.98);
  }
  EXPECT_GT(on_ball, 1000);
  EXPECT_GT(down, 100);
}

TEST(Hood, IsASmoothSheetWithARimBentDown) {
  const auto map = [](double u, double v) {
    return Eigen::Vector3d(0.6 * u * (1.0 - 0.3 * v * v), v,
                           0.3 - 0.06 * u * u - 0.08 * v * v - 0.12 * std::pow(u, 8) - 0.12 * std::pow(v, 8));
  };
  const double area = area_of_image(map, -1.0, 1.0, 0.0, 1.0);
  for (const double jitter : {0.0, 0.2, 0.45}) {
    const Mesh mesh = hood_mesh({.h = 1.0 / 32, .jitter = jitter});
    const Domain domain = good_domain(mesh, DomainKind::surface);
    EXPECT_EQ(euler_characteristic(mesh), 1);
    EXPECT_NEAR(domain.total_measure(), area, 0.003 * area);
    expect_normals_along(domain, [](const auto&) { return kUp; });
    expect_edges_about(domain, 1.0 / 32);
    for (const auto p : mesh.positions.rowwise()) {
      EXPECT_NEAR(p(2), map(p(0) / (0.6 * (1.0 - 0.3 * p(1) * p(1))), p(1)).z(), 1e-12);
    }
  }
  EXPECT_LT(map(1.0, 1.0).z(), -0.05);
  EXPECT_GT(map(0.0, 0.5).z(), 0.25);
}

TEST(Surfaces, SeedsDecide) {
  using Make = std::function<Mesh(const RectangleOptions&)>;
  const std::vector<Make> makes = {[](const auto& sheet) { return bump_mesh({.base = sheet}); },
                                   [](const auto& sheet) { return half_cylinder_mesh(0.5, 1.0, sheet); },
                                   [](const auto& sheet) { return three_balls_mesh(sheet); },
                                   [](const auto& sheet) { return hood_mesh(sheet); }};
  for (const Make& make : makes) {
    EXPECT_TRUE(same(make({.h = 0.1, .jitter = 0.2, .seed = 1}), make({.h = 0.1, .jitter = 0.2, .seed = 1})));
    EXPECT_FALSE(same(make({.h = 0.1, .jitter = 0.2, .seed = 1}), make({.h = 0.1, .jitter = 0.2, .seed = 2})));
  }
  EXPECT_TRUE(same(sphere_mesh(1.0, 0.2), sphere_mesh(1.0, 0.2)));
  EXPECT_TRUE(same(torus_mesh(1.0, 0.4, 0.2), torus_mesh(1.0, 0.4, 0.2)));
}

class Silhouette : public ::testing::TestWithParam<std::string> {
 protected:
  /// The largest h, as the message says it.
  double largest_h() const {
    const std::string message = message_of([&] { silhouette_mesh(GetParam(), 0.5); });
    EXPECT_THAT(message, HasSubstr("'h' = 0.5: too coarse for the limbs of the silhouette '" + GetParam() + "'"));
    return std::stod(message.substr(message.rfind(' ')));
  }
};

TEST_P(Silhouette, IsAGoodDiskForEveryUsableH) {
  const double largest = largest_h();
  const double area = Domain(silhouette_mesh(GetParam(), largest / 8.0)).total_measure();
  for (const double fraction : {1.0, 0.93, 0.85, 0.71, 0.58, 0.5, 0.33, 0.21}) {
    const double h = fraction * largest;
    SCOPED_TRACE(h);
    const Mesh mesh = silhouette_mesh(GetParam(), h);
    const Domain domain = good_domain(mesh, DomainKind::planar);
    EXPECT_EQ(euler_characteristic(mesh), 1);
    const MeshQuality quality = mesh_quality(domain);
    EXPECT_GT(quality.min_angle, 15.0);
    EXPECT_LT(quality.max_edge, 2.0 * h);
    expect_edges_about(domain, h);
    // A lost limb would be missed here.
    EXPECT_NEAR(domain.total_measure(), area, 0.01 * area);
    EXPECT_GT(domain.diameter(), 1.0);
    EXPECT_LT(domain.diameter(), 1.5);
  }
}

TEST_P(Silhouette, IsTheSameEveryTime) {
  EXPECT_TRUE(same(silhouette_mesh(GetParam(), 0.01), silhouette_mesh(GetParam(), 0.01)));
}

TEST_P(Silhouette, RefusesTooCoarseAndTooFineH) {
  const double largest = largest_h();
  EXPECT_GT(largest, 0.015);
  EXPECT_NO_THROW(silhouette_mesh(GetParam(), largest));
  EXPECT_THROW(silhouette_mesh(GetParam(), 1.01 * largest), UsageError);
  EXPECT_THAT(message_of([&] { silhouette_mesh(GetParam(), 1e-5); }), HasSubstr("'h' = 1e-05: this makes"));
}

INSTANTIATE_TEST_SUITE_P(All, Silhouette, ::testing::ValuesIn(silhouette_names()),
                         [](const auto& instance) { return instance.param; });

TEST(Silhouettes, AreListedAndUnknownOnesRefused) {
  EXPECT_EQ(silhouette_names(), (std::vector<std::string>{"figure", "giraffe", "frog", "cactus"}));
  EXPECT_THAT(message_of([] { silhouette_mesh("dog", 0.01); }),
              HasSubstr("unknown silhouette 'dog'; known: figure, giraffe, frog, cactus"));
}

TEST(Degrade, KeepsShapeAndValidity) {
  const std::vector<Mesh> inputs = {rectangle_mesh({.h = 1.0 / 24.0}), disk_mesh(1.0, 0.08),
                                    annulus_mesh(0.4, 1.0, 0.08), silhouette_mesh("figure", 0.02)};
  for (const Mesh& input : inputs) {
    const Domain before(input);
    for (const double jitter : {0.0, 0.4, 1.0}) {
      for (const double flips : {0.0, 0.3, 1.0}) {
        for (const int refinements : {0, 1, 4}) {
          const Mesh mesh =
              degrade_mesh(input, {.jitter = jitter, .flip_fraction = flips, .refinements = refinements, .seed = 5});
          const Domain after = good_domain(mesh, DomainKind::planar);
          EXPECT_NEAR(after.total_measure(), before.total_measure(), 1e-12 * before.total_measure());
          EXPECT_GT(after.cell_measures().minCoeff(), 1e-9 * after.cell_measures().mean());
          EXPECT_EQ(euler_characteristic(mesh), euler_characteristic(input));
          EXPECT_EQ(after.boundary_facets().rows(), before.boundary_facets().rows());
          for (Index v = 0; v < input.vertex_count(); ++v) {
            if (jitter == 0.0 || before.boundary_vertices()[v]) {
              EXPECT_EQ(mesh.positions.row(v), input.positions.row(v));
            }
          }
        }
      }
    }
  }
}

TEST(Degrade, ReachesTheRatiosOfTheSource) {
  // Martinez Esturo 2013, Figure 55: areas up to 1.7e3 times as large as others, radius ratios up to 38.8.
  const Mesh inputs[] = {rectangle_mesh({.jitter = 0.2}), silhouette_mesh("figure", 0.015)};
  for (const Mesh& input : inputs) {
    for (const std::uint64_t seed : {1, 2, 3}) {
      const MeshQuality quality =
          mesh_quality(Domain(degrade_mesh(input, {.flip_fraction = 0.5, .refinements = 3, .seed = seed})));
      EXPECT_GT(quality.measure_ratio, 1000.0);
      EXPECT_GT(quality.max_radius_ratio, 38.0);
    }
  }
}

TEST(Degrade, OptionsDoWhatTheySay) {
  const Mesh input = rectangle_mesh({.h = 0.1});
  EXPECT_TRUE(same(degrade_mesh(input, {}), input));

  const Mesh jittered = degrade_mesh(input, {.jitter = 0.3});
  EXPECT_EQ(jittered.cells, input.cells);
  EXPECT_NE(jittered.positions, input.positions);
  EXPECT_LE((jittered.positions - input.positions).cwiseAbs().maxCoeff(), 0.3 * 0.1 + 1e-15);

  const Mesh flipped = degrade_mesh(input, {.flip_fraction = 0.3});
  EXPECT_EQ(flipped.positions, input.positions);
  EXPECT_NE(flipped.cells, input.cells);

  const Mesh refined = degrade_mesh(input, {.refinements = 1});
  EXPECT_EQ(refined.vertex_count(), input.vertex_count() + 40);
  EXPECT_EQ(refined.cell_count(), 280);
}

TEST(Degrade, SeedsDecide) {
  const Mesh input = rectangle_mesh({.h = 0.1});
  const auto mesh = [&](std::uint64_t seed) {
    return degrade_mesh(input, {.jitter = 0.2, .flip_fraction = 0.2, .refinements = 1, .seed = seed});
  };
  EXPECT_TRUE(same(mesh(3), mesh(3)));
  EXPECT_FALSE(same(mesh(3), mesh(4)));
}

TEST(Degrade, RefusesOtherMeshes) {
  Mesh clockwise = rectangle_mesh({.h = 0.5});
  std::swap(clockwise.cells(3, 0), clockwise.cells(3, 1));
  EXPECT_THAT(message_of([&] { degrade_mesh(clockwise, {}); }), HasSubstr("cell 3 is not counter-clockwise"));
  EXPECT_THROW(degrade_mesh(clockwise, {}), DataError);
  EXPECT_THROW(degrade_mesh(bar_surface_mesh(1, 1, 1, 1), {}), UsageError);
  EXPECT_THROW(degrade_mesh(bar_tet_mesh(1, 1, 1, 1), {}), UsageError);
  EXPECT_THROW(degrade_mesh(Mesh{}, {}), UsageError);
  Mesh broken = rectangle_mesh({.h = 0.5});
  broken.cells(0, 0) = 99;
  EXPECT_THROW(degrade_mesh(broken, {}), DataError);
}

TEST(Generators, BadOptionsAreNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Mesh square = rectangle_mesh({.h = 0.25});
  const std::vector<std::pair<std::function<void()>, std::string>> table = {
      {[] { rectangle_mesh({.width = 0.0}); }, "'width' = 0: expected a positive number"},
      {[] { rectangle_mesh({.height = -1.0}); }, "'height' = -1: expected a positive number"},
      {[] { rectangle_mesh({.width = std::numeric_limits<double>::infinity()}); }, "'width' = inf"},
      {[=] { rectangle_mesh({.h = nan}); }, "'h' = nan: expected a positive number"},
      {[] { rectangle_mesh({.h = 1.5}); }, "'h' = 1.5: expected at most 1, the size of the shape"},
      {[] { rectangle_mesh({.h = 1e-4}); }, "'h' = 0.0001: this makes 2e+08 cells; expected at most 50000000"},
      {[] { rectangle_mesh({.h = 1e-300}); }, "'h' = 1e-300: this makes inf cells"},
      {[] { rectangle_mesh({.jitter = 0.46}); }, "'jitter' = 0.46: expected a value in [0, 0.45]"},
      {[=] { rectangle_mesh({.jitter = nan}); }, "'jitter' = nan"},
      {[] { rectangle_mesh({.tessellation = Tessellation::graded, .grading = 0.9}); }, "'grading' = 0.9"},
      {[] { rectangle_mesh({.h = 0.01, .tessellation = Tessellation::graded}); },
       "'grading' = 1.16: expected at most 1.123 for 100 cells in a row"},
      {[] { disk_mesh(0.0, 0.1); }, "'radius' = 0"},
      {[] { disk_mesh(1.0, 1.1); }, "'h' = 1.1"},
      {[] { disk_mesh(1.0, 1e-4); }, "'h' = 0.0001: this makes 6e+08 cells"},
      {[] { annulus_mesh(0.0, 1.0, 0.1); }, "'inner_radius' = 0"},
      {[] { annulus_mesh(1.0, 1.0, 0.1); }, "'inner_radius' = 1: expected less than the outer radius 1"},
      {[] { annulus_mesh(1.0, -2.0, 0.1); }, "'outer_radius' = -2"},
      {[] { annulus_mesh(0.5, 1.0, 0.6); }, "'h' = 0.6: expected at most 0.5"},
      {[] { bar_surface_mesh(0.0, 1.0, 1.0, 0.1); }, "'length' = 0"},
      {[] { bar_surface_mesh(1.0, 1.0, 1.0, 1e-4); }, "'h' = 0.0001: this makes 1.2e+09 cells"},
      {[] { bar_tet_mesh(1.0, 0.0, 1.0, 0.1); }, "'width' = 0"},
      {[] { bar_tet_mesh(1.0, 1.0, -1.0, 0.1); }, "'height' = -1"},
      {[] { bar_tet_mesh(1.0, 1.0, 1.0, 2.0); }, "'h' = 2: expected at most 1"},
      {[] { bar_tet_mesh(1.0, 1.0, 1.0, 0.001); }, "'h' = 0.001: this makes 6e+09 cells"},
      {[] { bar_tet_mesh(1.0, 1.0, 1.0, 0.5, 0.5); }, "'jitter' = 0.5: expected a value in [0, 0.45]"},
      {[] { bump_mesh({.sharpness = 0.0}); }, "'sharpness' = 0: expected a positive number"},
      {[=] { bump_mesh({.height = nan}); }, "'height' = nan: expected a finite number"},
      {[=] {
         bump_mesh({.centre = {0.5, nan}});
       },
       "'centre' = [0.5, nan]: expected finite numbers"},
      {[] { bump_mesh({.base = {.h = 2.0}}); }, "'h' = 2: expected at most 1"},
      {[] { half_cylinder_mesh(-1.0, 1.0, {}); }, "'radius' = -1"},
      {[] { half_cylinder_mesh(1.0, 0.0, {}); }, "'length' = 0"},
      {[] { sphere_mesh(0.0, 0.1); }, "'radius' = 0"},
      {[] { sphere_mesh(1.0, 1.2); }, "'h' = 1.2: expected at most 1.107"},
      {[] { sphere_mesh(1.0, 1e-4); }, "'h' = 0.0001: this makes 2.45e+09 cells"},
      {[] { torus_mesh(1.0, 1.0, 0.1); }, "'minor_radius' = 1: expected less than the major radius 1"},
      {[] { torus_mesh(-1.0, 0.5, 0.1); }, "'major_radius' = -1"},
      {[] { torus_mesh(1.0, 0.0, 0.1); }, "'minor_radius' = 0"},
      {[] { torus_mesh(1.0, 0.5, 4.0); }, "'h' = 4: expected at most 3"},
      {[] { torus_mesh(1.0, 0.5, 1e-4); }, "'h' = 0.0001: this makes"},
      {[] { three_balls_mesh({.h = 0.2}); }, "'h' = 0.2: expected a value in [0, 0.1]"},
      {[] { three_balls_mesh({.h = -0.2}); }, "'h' = -0.2: expected a positive number"},
      {[] { hood_mesh({.h = 1.5}); }, "'h' = 1.5: expected at most 1.2"},
      {[] { silhouette_mesh("frog", 0.0); }, "'h' = 0: expected a positive number"},
      {[&] { degrade_mesh(square, {.jitter = 1.5}); }, "'jitter' = 1.5"},
      {[&] { degrade_mesh(square, {.flip_fraction = -0.1}); }, "'flip_fraction' = -0.1: expected a value in [0, 1]"},
      {[&] { degrade_mesh(square, {.refinements = -1}); }, "'refinements' = -1: expected a value in [0, 20]"},
  };
  for (const auto& [action, expected] : table) {
    EXPECT_THROW(action(), UsageError) << expected;
    EXPECT_THAT(message_of(action), HasSubstr(expected));
  }
}

}  // namespace
}  // namespace variform
