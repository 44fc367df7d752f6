// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "framework/base/error.h"
#include "framework/domain/check.h"
#include "framework/domain/generators.h"
#include "framework/topology/topology.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// The surface of voxels that are marked # in rows of text, one layer thick: a plate with holes.
Mesh voxel_surface(const std::vector<std::string>& rows) {
  const auto solid = [&](int x, int y, int z) {
    return z == 0 && y >= 0 && y < static_cast<int>(rows.size()) && x >= 0 && x < static_cast<int>(rows[y].size()) &&
           rows[y][x] == '#';
  };
  std::map<std::array<int, 3>, Index> numbers;
  std::vector<std::array<Index, 3>> triangles;
  for (int y = 0; y < static_cast<int>(rows.size()); ++y) {
    for (int x = 0; x < static_cast<int>(rows[y].size()); ++x) {
      if (!solid(x, y, 0)) continue;
      for (int axis = 0; axis < 3; ++axis) {
        for (const int side : {0, 1}) {
          std::array<int, 3> next = {x, y, 0};
          next[axis] += side == 1 ? 1 : -1;
          if (solid(next[0], next[1], next[2])) continue;
          std::array<Index, 4> corners{};
          constexpr std::array<std::array<int, 2>, 4> kTurns = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
          for (int k = 0; k < 4; ++k) {
            std::array<int, 3> p = {x, y, 0};
            p[axis] += side;
            p[(axis + 1) % 3] += kTurns[k][side == 1 ? 0 : 1];
            p[(axis + 2) % 3] += kTurns[k][side == 1 ? 1 : 0];
            corners[k] = numbers.try_emplace(p, static_cast<Index>(numbers.size())).first->second;
          }
          triangles.push_back({corners[0], corners[1], corners[2]});
          triangles.push_back({corners[0], corners[2], corners[3]});
        }
      }
    }
  }
  Mesh mesh{Matrix(static_cast<Index>(numbers.size()), 3), IndexMatrix(static_cast<Index>(triangles.size()), 3)};
  for (const auto& [p, v] : numbers) mesh.positions.row(v) << p[0], p[1], p[2];
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    mesh.cells.row(static_cast<Index>(t)) << triangles[t][0], triangles[t][1], triangles[t][2];
  }
  return mesh;
}

Mesh double_torus() { return voxel_surface({"#####", "#.#.#", "#####"}); }

/// Two meshes as one.
Mesh both(const Mesh& a, const Mesh& b) {
  Mesh mesh{Matrix(a.vertex_count() + b.vertex_count(), 3), IndexMatrix(a.cell_count() + b.cell_count(), 3)};
  mesh.positions << a.positions, b.positions;
  mesh.cells << a.cells, (b.cells.array() + a.vertex_count()).matrix();
  return mesh;
}

/// Two triangles that touch in vertex 0.
Mesh bow_tie() {
  Mesh mesh{Matrix(5, 2), IndexMatrix(2, 3)};
  mesh.positions << 0, 0, 1, 0, 1, 1, -1, 0, -1, -1;
  mesh.cells << 0, 1, 2, 0, 3, 4;
  return mesh;
}

/// 3 x 3 squares without the middle one and a corner: a ring that is open there and touches itself in one vertex, 4.
Mesh pinched_ring() {
  Mesh mesh = rectangle_mesh({.width = 3.0, .height = 3.0, .h = 1.0, .tessellation = Tessellation::regular});
  std::vector<Index> kept;
  for (Index t = 2; t < mesh.cell_count(); ++t) {
    if (t / 2 != 4) kept.push_back(t);
  }
  mesh.cells = IndexMatrix(mesh.cells(kept, Eigen::all));
  return repair_mesh(mesh).mesh;
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

double length_of(const Domain& domain, const std::vector<Index>& path) {
  double length = 0.0;
  for (std::size_t k = 1; k < path.size(); ++k) {
    length += (domain.positions().row(path[k]) - domain.positions().row(path[k - 1])).norm();
  }
  return length;
}

double length_of(const Domain& domain, const std::vector<Edge>& edges) {
  double length = 0.0;
  for (const auto& [a, b] : edges) length += length_of(domain, std::vector<Index>{a, b});
  return length;
}

/// Lengths of shortest paths between all vertices (Floyd and Warshall).
Eigen::MatrixXd all_distances(const Domain& domain) {
  const Index n = domain.vertex_count();
  Eigen::MatrixXd d = Eigen::MatrixXd::Constant(n, n, std::numeric_limits<double>::infinity());
  d.diagonal().setZero();
  for (const auto cell : domain.cells().rowwise()) {
    for (const Index a : cell) {
      for (const Index b : cell) d(a, b) = (domain.positions().row(a) - domain.positions().row(b)).norm();
    }
  }
  for (Index k = 0; k < n; ++k) d = d.cwiseMin(d.col(k).replicate(1, n) + d.row(k).replicate(n, 1));
  return d;
}

struct Shape {
  std::string name;
  Mesh mesh;
  Index euler;
  Index genus;
  Index loops;
};

std::vector<Shape> shapes() {
  return {{"disk", disk_mesh(1.0, 0.2), 1, 0, 1},
          {"annulus", annulus_mesh(0.4, 1.0, 0.15), 0, 0, 2},
          {"plate", voxel_surface({"###", "###"}), 2, 0, 0},
          {"sphere", sphere_mesh(1.0, 0.3), 2, 0, 0},
          {"tetrahedron",
           {(Matrix(4, 3) << 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1).finished(),
            (IndexMatrix(4, 3) << 0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2).finished()},
           2,
           0,
           0},
          {"torus", torus_mesh(1.0, 0.4, 0.25), 0, 1, 0},
          {"coarse torus", torus_mesh(1.0, 0.4, 2.0), 0, 1, 0},
          {"double torus", double_torus(), -2, 2, 0},
          {"triple torus", voxel_surface({"#######", "#.#.#.#", "#######"}), -4, 3, 0}};
}

TEST(Topology, CountsOfKnownSurfaces) {
  for (const Shape& shape : shapes()) {
    SCOPED_TRACE(shape.name);
    ASSERT_THAT(check_mesh(shape.mesh), IsEmpty());
    const Topology t = topology(Domain(shape.mesh));
    EXPECT_EQ(t.vertices, shape.mesh.vertex_count());
    EXPECT_EQ(t.cells, shape.mesh.cell_count());
    EXPECT_EQ(t.euler_characteristic, t.vertices - t.edges + t.cells);
    EXPECT_EQ(t.euler_characteristic, shape.euler);
    EXPECT_EQ(t.genus, shape.genus);
    EXPECT_EQ(t.boundary_loops, shape.loops);
    EXPECT_EQ(t.components, 1);
    EXPECT_EQ(t.singular_vertices, 0);
    EXPECT_EQ(t.is_disk(), shape.name == "disk");
  }
}

TEST(Topology, ComponentsAddUp) {
  const Domain domain(both(double_torus(), sphere_mesh(1.0, 0.5)));
  const Topology whole = topology(domain);
  EXPECT_EQ(whole.components, 2);
  EXPECT_EQ(whole.euler_characteristic, 0);
  EXPECT_EQ(whole.genus, 2);
  const std::vector<Topology> parts = component_topologies(domain);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].euler_characteristic, -2);
  EXPECT_EQ(parts[0].genus, 2);
  EXPECT_EQ(parts[1].euler_characteristic, 2);
  EXPECT_EQ(parts[1].genus, 0);
  EXPECT_EQ(parts[0].vertices + parts[1].vertices, whole.vertices);
  EXPECT_EQ(parts[0].edges + parts[1].edges, whole.edges);
  EXPECT_EQ(parts[0].cells + parts[1].cells, whole.cells);
}

TEST(Topology, MeshesThatTouchThemselvesAreNoDisks) {
  const Topology tie = topology(Domain(bow_tie()));
  EXPECT_EQ(tie.components, 2);
  EXPECT_EQ(tie.singular_vertices, 1);
  EXPECT_EQ(tie.boundary_loops, 2);
  EXPECT_EQ(tie.genus, 0);
  for (const Topology& part : component_topologies(Domain(bow_tie()))) {
    EXPECT_EQ(part.vertices, 3);
    EXPECT_TRUE(part.is_disk());
  }
  const Domain ring(pinched_ring());
  for (const Topology& t : {topology(ring), component_topologies(ring)[0]}) {
    EXPECT_EQ(t.components, 1);
    EXPECT_EQ(t.singular_vertices, 1);
    EXPECT_EQ(t.euler_characteristic, 0);
    EXPECT_EQ(t.boundary_loops, 1);
    EXPECT_EQ(t.genus, 0);
    EXPECT_FALSE(t.is_disk());
  }
  EXPECT_THAT(message_of([&] { cut_graph(ring); }), HasSubstr("vertex 4 joins several fans of cells"));
}

TEST(BoundaryLoops, FollowTheCellsFromTheirLowestVertex) {
  Mesh square = rectangle_mesh({.h = 0.5, .tessellation = Tessellation::regular});
  EXPECT_THAT(boundary_loops(Domain(square)), ElementsAre(ElementsAre(0, 1, 2, 5, 8, 7, 6, 3)));
  EXPECT_THAT(boundary_loops(Domain(bow_tie())), ElementsAre(ElementsAre(0, 1, 2), ElementsAre(0, 3, 4)));
  EXPECT_THAT(boundary_loops(Domain(torus_mesh(1.0, 0.4, 0.5))), IsEmpty());

  const Domain annulus(annulus_mesh(0.4, 1.0, 0.15));
  const std::vector<std::vector<Index>> loops = boundary_loops(annulus);
  ASSERT_EQ(loops.size(), 2u);
  EXPECT_LT(loops[0][0], loops[1][0]);
  EXPECT_EQ(static_cast<Index>(loops[0].size() + loops[1].size()), annulus.boundary_facets().rows());
  for (const auto& loop : loops) {
    // Cells on the left: counter-clockwise outside, clockwise inside.
    double doubled_area = 0.0;
    for (std::size_t k = 0; k < loop.size(); ++k) {
      const auto a = annulus.positions().row(loop[k]);
      const auto b = annulus.positions().row(loop[(k + 1) % loop.size()]);
      doubled_area += a(0) * b(1) - a(1) * b(0);
      EXPECT_NEAR(a.norm(), annulus.positions().row(loop[0]).norm(), 1e-12);
    }
    EXPECT_EQ(doubled_area > 0.0, annulus.positions().row(loop[0]).norm() > 0.7);
  }
}

TEST(ShortestEdgePath, IsAsShortAsBruteForceFinds) {
  for (const Mesh& mesh : {rectangle_mesh({.width = 1.0, .h = 0.2, .jitter = 0.4}), double_torus()}) {
    const Domain domain(mesh);
    const Eigen::MatrixXd distances = all_distances(domain);
    for (Index a = 0; a < domain.vertex_count(); a += 5) {
      for (Index b = 0; b < domain.vertex_count(); ++b) {
        const std::vector<Index> path = shortest_edge_path(domain, a, b);
        EXPECT_EQ(path.front(), a);
        EXPECT_EQ(path.back(), b);
        EXPECT_NEAR(length_of(domain, path), distances(a, b), 1e-12);
        for (std::size_t k = 1; k < path.size(); ++k) {
          const bool is_edge = std::ranges::any_of(domain.cells().rowwise(), [&](const auto& cell) {
            return (cell.array() == path[k]).any() && (cell.array() == path[k - 1]).any();
          });
          EXPECT_TRUE(is_edge) << path[k - 1] << " " << path[k];
        }
      }
    }
  }
}

TEST(ShortestEdgePath, RefusesWhatIsNotThere) {
  const Domain tie(both(sphere_mesh(1.0, 0.5), sphere_mesh(2.0, 1.0)));
  EXPECT_THAT(message_of([&] { shortest_edge_path(tie, 0, 999999); }), HasSubstr("vertex 999999 does not exist"));
  EXPECT_THAT(message_of([&] { shortest_edge_path(tie, 0, tie.vertex_count() - 1); }),
              HasSubstr("no path of edges joins vertices 0 and"));
  EXPECT_THROW(shortest_edge_path(Domain(bar_tet_mesh(1, 1, 1, 1)), 0, 1), UsageError);
}

/// What cutting must keep: the same cells at the same places, copies that lie on their originals.
void expect_same_shape(const Mesh& before, const CutMesh& cut) {
  ASSERT_EQ(cut.vertex_origin.size(), static_cast<std::size_t>(cut.mesh.vertex_count()));
  ASSERT_EQ(cut.mesh.cell_count(), before.cell_count());
  for (Index v = 0; v < before.vertex_count(); ++v) EXPECT_EQ(cut.vertex_origin[v], v);
  for (Index v = 0; v < cut.mesh.vertex_count(); ++v) {
    EXPECT_EQ(cut.mesh.positions.row(v), before.positions.row(cut.vertex_origin[v]));
  }
  for (Index t = 0; t < before.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) EXPECT_EQ(cut.vertex_origin[cut.mesh.cells(t, i)], before.cells(t, i));
  }
  EXPECT_THAT(check_mesh(cut.mesh), IsEmpty());
}

TEST(CutGraph, OpensEverySurfaceToADisk) {
  for (const Shape& shape : shapes()) {
    SCOPED_TRACE(shape.name);
    const Domain domain(shape.mesh);
    const std::vector<Edge> graph = cut_graph(domain);
    EXPECT_EQ(graph.empty(), shape.name == "disk");
    EXPECT_TRUE(std::ranges::is_sorted(graph));
    EXPECT_EQ(graph, cut_graph(domain));
    const CutMesh cut = cut_along_edges(shape.mesh, graph);
    expect_same_shape(shape.mesh, cut);
    const Domain open(cut.mesh);
    const Topology t = topology(open);
    EXPECT_EQ(t.euler_characteristic, 1);
    EXPECT_EQ(t.boundary_loops, 1);
    EXPECT_TRUE(t.is_disk());
    EXPECT_EQ(open.cell_measures(), domain.cell_measures());
    // Every cut edge has become two boundary edges, and no other edge has changed.
    EXPECT_EQ(open.boundary_facets().rows(), domain.boundary_facets().rows() + 2 * static_cast<Index>(graph.size()));
    EXPECT_THAT(cut_graph(open), IsEmpty());
  }
}

TEST(CutGraph, OfAnAnnulusIsAShortestConnection) {
  Mesh mesh = annulus_mesh(0.4, 1.0, 0.12);
  mesh.positions.col(0) *= 1.7;  // shorter across than along
  const Domain domain(mesh);
  const Eigen::MatrixXd distances = all_distances(domain);
  const auto loops = boundary_loops(domain);
  double shortest = std::numeric_limits<double>::infinity();
  for (const Index a : loops[0]) {
    for (const Index b : loops[1]) shortest = std::min(shortest, distances(a, b));
  }
  EXPECT_NEAR(length_of(domain, cut_graph(domain)), shortest, 1e-12);
}

TEST(CutGraph, OfATorusIsAboutAsShortAsItsTwoShortestLoops) {
  const Domain domain(torus_mesh(1.0, 0.3, 0.1));
  const double loops = 2.0 * 3.14159265 * (0.3 + 0.7);  // around the tube, and along its inner side
  const double length = length_of(domain, cut_graph(domain));
  EXPECT_GT(length, 0.95 * loops);
  EXPECT_LT(length, 1.5 * loops);
}

TEST(CutGraph, OfASphereJoinsFarPoints) {
  const Domain domain(sphere_mesh(1.0, 0.2));
  const double length = length_of(domain, cut_graph(domain));
  EXPECT_GT(length, 0.9 * 3.14159265);
  EXPECT_LT(length, 1.25 * 3.14159265);
}

TEST(CutGraph, OpensEveryComponent) {
  const Mesh mesh = both(both(double_torus(), sphere_mesh(1.0, 0.5)), torus_mesh(3.0, 1.0, 1.0));
  const CutMesh cut = cut_along_edges(mesh, cut_graph(Domain(mesh)));
  expect_same_shape(mesh, cut);
  const std::vector<Topology> parts = component_topologies(Domain(cut.mesh));
  ASSERT_EQ(parts.size(), 3u);
  for (const Topology& part : parts) EXPECT_TRUE(part.is_disk());
}

TEST(CutAlongEdges, SplitsFansOnly) {
  // 3 x 3 vertices, the middle one 4: from the boundary to the middle, and through.
  const Mesh square = rectangle_mesh({.h = 0.5, .tessellation = Tessellation::regular});
  const CutMesh slit = cut_along_edges(square, {{4, 1}});
  expect_same_shape(square, slit);
  EXPECT_EQ(slit.mesh.vertex_count(), 10);
  EXPECT_EQ(slit.vertex_origin.back(), 1);
  EXPECT_TRUE(topology(Domain(slit.mesh)).is_disk());

  const CutMesh halves = cut_along_edges(square, {{4, 1}, {4, 7}, {1, 4}});
  expect_same_shape(square, halves);
  EXPECT_EQ(halves.vertex_origin, (std::vector<Index>{0, 1, 2, 3, 4, 5, 6, 7, 8, 1, 4, 7}));
  EXPECT_EQ(topology(Domain(halves.mesh)).components, 2);

  const CutMesh same = cut_along_edges(square, {});
  EXPECT_EQ(same.mesh.cells, square.cells);
  EXPECT_EQ(same.mesh.vertex_count(), 9);
}

TEST(CutAlongEdges, ThreeCutsAtAVertexGiveThreeCopies) {
  const Mesh disk = disk_mesh(1.0, 1.0);  // a hexagon around vertex 0
  const CutMesh cut = cut_along_edges(disk, {{0, 1}, {0, 3}, {0, 5}});
  expect_same_shape(disk, cut);
  EXPECT_EQ(cut.vertex_origin, (std::vector<Index>{0, 1, 2, 3, 4, 5, 6, 0, 0, 1, 3, 5}));
  EXPECT_EQ(topology(Domain(cut.mesh)).components, 3);
}

TEST(CutAlongEdges, NamesBadEdges) {
  const Mesh square = rectangle_mesh({.h = 0.25, .tessellation = Tessellation::regular});
  const std::vector<std::pair<std::vector<Edge>, std::string>> table = {
      {{{0, 12}}, "edge (0, 12) is not in the mesh"},
      {{{-1, 99}}, "edge (-1, 99) is not in the mesh"},
      {{{3, 3}}, "edge (3, 3) is not in the mesh"},
      {{{1, 0}}, "edge (1, 0) is on the boundary; expected an interior edge"},
      {{{11, 12}}, "edge (11, 12) cannot be opened alone; expected that it meets the boundary or another cut edge"},
  };
  for (const auto& [edges, message] : table) {
    EXPECT_THAT(message_of([&] { cut_along_edges(square, edges); }), HasSubstr(message));
    EXPECT_THROW(cut_along_edges(square, edges), DataError);
  }
  Mesh branch{Matrix::Random(5, 3), IndexMatrix(3, 3)};
  branch.cells << 0, 1, 2, 1, 0, 3, 0, 1, 4;
  EXPECT_THAT(message_of([&] { cut_along_edges(branch, {{0, 1}}); }), HasSubstr("more than two cells"));
  EXPECT_THROW(cut_along_edges(bar_tet_mesh(1, 1, 1, 1), {{0, 1}}), UsageError);
}

}  // namespace
}  // namespace variform
