// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <set>

#include "framework/base/error.h"
#include "framework/domain/check.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Kind = Defect::Kind;

/// n x n squares of two counter-clockwise triangles each.
Mesh grid(Index n, int dimension = 2) {
  Mesh mesh{Matrix::Zero((n + 1) * (n + 1), dimension), IndexMatrix(2 * n * n, 3)};
  for (Index j = 0; j <= n; ++j) {
    for (Index i = 0; i <= n; ++i) mesh.positions.row(j * (n + 1) + i).head(2) << i, j;
  }
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) {
      const Index v = j * (n + 1) + i;
      mesh.cells.row(2 * (j * n + i)) << v, v + 1, v + n + 2;
      mesh.cells.row(2 * (j * n + i) + 1) << v, v + n + 2, v + n + 1;
    }
  }
  return mesh;
}

/// The same over a paraboloid: a surface.
Mesh surface_grid(Index n) {
  Mesh mesh = grid(n, 3);
  mesh.positions.col(2) = mesh.positions.col(0).array().square() + mesh.positions.col(1).array();
  return mesh;
}

/// Two tetrahedra with a common face.
Mesh tetrahedra() {
  Mesh mesh{Matrix(5, 3), IndexMatrix(2, 4)};
  mesh.positions << 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1;
  mesh.cells << 0, 1, 2, 3, 1, 2, 3, 4;
  return mesh;
}

Mesh moebius(Index n) {
  Mesh mesh{Matrix(2 * n, 3), IndexMatrix(2 * n, 3)};
  for (Index i = 0; i < n; ++i) {
    const double t = 2.0 * std::numbers::pi * i / n;
    for (Index k = 0; k < 2; ++k) {
      const double r = 2.0 + (k - 0.5) * std::cos(t / 2.0);
      mesh.positions.row(2 * i + k) << r * std::cos(t), r * std::sin(t), (k - 0.5) * std::sin(t / 2.0);
    }
    const bool is_last = i + 1 == n;
    const Index low = is_last ? 1 : 2 * i + 2;
    const Index high = is_last ? 0 : 2 * i + 3;
    mesh.cells.row(2 * i) << 2 * i, low, high;
    mesh.cells.row(2 * i + 1) << 2 * i, high, 2 * i + 1;
  }
  return mesh;
}

void reverse(Mesh& mesh, Index cell) { std::swap(mesh.cells(cell, 1), mesh.cells(cell, 2)); }

void append_cell(Mesh& mesh, const std::vector<Index>& corners) {
  mesh.cells.conservativeResize(mesh.cells.rows() + 1, Eigen::NoChange);
  for (std::size_t k = 0; k < corners.size(); ++k)
    mesh.cells(mesh.cells.rows() - 1, static_cast<Index>(k)) = corners[k];
}

void append_vertex(Mesh& mesh, double x, double y) {
  mesh.positions.conservativeResize(mesh.positions.rows() + 1, Eigen::NoChange);
  mesh.positions.row(mesh.positions.rows() - 1).setZero();
  mesh.positions.row(mesh.positions.rows() - 1).head(2) << x, y;
}

std::vector<Kind> kinds(const Mesh& mesh) {
  std::vector<Kind> result;
  for (const Defect& defect : check_mesh(mesh)) result.push_back(defect.kind);
  return result;
}

Defect only_defect(const Mesh& mesh) {
  const std::vector<Defect> defects = check_mesh(mesh);
  EXPECT_EQ(defects.size(), 1u);
  return defects.empty() ? Defect{Kind::empty, -1, 0, "no defect"} : defects.front();
}

TEST(CheckMesh, GoodMeshesHaveNoDefects) {
  EXPECT_THAT(kinds(grid(3)), IsEmpty());
  EXPECT_THAT(kinds(grid(3, 3)), IsEmpty());
  EXPECT_THAT(kinds(surface_grid(3)), IsEmpty());
  EXPECT_THAT(kinds(tetrahedra()), IsEmpty());
}

TEST(CheckMesh, Empty) {
  EXPECT_EQ(only_defect(Mesh()).message, "the mesh has no cells");
  EXPECT_EQ(only_defect({Matrix::Zero(3, 2), IndexMatrix(0, 3)}).kind, Kind::empty);
}

TEST(CheckMesh, WrongShapeIsAnError) {
  EXPECT_THROW(check_mesh({Matrix::Zero(4, 2), IndexMatrix::Zero(1, 4)}), DataError);
  EXPECT_THROW(check_mesh({Matrix::Zero(4, 3), IndexMatrix::Zero(1, 5)}), DataError);
  EXPECT_THROW(repair_mesh({Matrix::Zero(4, 1), IndexMatrix::Zero(1, 3)}), DataError);
}

TEST(CheckMesh, NotFinite) {
  Mesh mesh = surface_grid(2);
  mesh.positions(4, 1) = std::numeric_limits<double>::quiet_NaN();
  mesh.positions(7, 2) = std::numeric_limits<double>::infinity();
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::not_finite);
  EXPECT_EQ(defect.element, 4);
  EXPECT_EQ(defect.count, 2);
  EXPECT_EQ(defect.message,
            "vertex 4 (counted from 0) has coordinates that are not finite, (1, nan, 2); 2 vertices have");
}

TEST(CheckMesh, IndexOutOfRangeEndsTheCheck) {
  Mesh mesh = grid(2);
  mesh.cells(3, 1) = 9;
  mesh.cells(5, 0) = -1;
  append_vertex(mesh, 9, 9);
  mesh.cells(3, 1) = 10;
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::index_out_of_range);
  EXPECT_EQ(defect.element, 3);
  EXPECT_EQ(defect.count, 2);
  EXPECT_THAT(defect.message, HasSubstr("cell 3 (counted from 0) names vertex 10 of a mesh with 10 vertices; 2 cells"));
  EXPECT_THROW(repair_mesh(mesh), DataError);
}

TEST(CheckMesh, RepeatedVertex) {
  Mesh mesh = grid(2);
  append_cell(mesh, {4, 1, 4});
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::repeated_vertex);
  EXPECT_EQ(defect.element, 8);
  EXPECT_EQ(defect.message, "cell 8 (counted from 0) names vertex 4 more than once");
}

TEST(CheckMesh, DegenerateCell) {
  Mesh mesh = grid(2);
  append_vertex(mesh, 0.5, 0.0);  // on the edge of the first cell
  append_cell(mesh, {1, 0, 9});
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::degenerate_cell);
  EXPECT_EQ(defect.element, 8);
  EXPECT_EQ(defect.message, "cell 8 (counted from 0) is degenerate (measure 0, mean 0.444)");

  mesh.positions(9, 1) = -1e-13;
  EXPECT_THAT(kinds(mesh), ElementsAre(Kind::degenerate_cell));
  mesh.positions(9, 1) = -1e-11;
  EXPECT_THAT(kinds(mesh), IsEmpty());

  Mesh flat = tetrahedra();
  flat.positions.row(4) << 1.0 / 3, 1.0 / 3, 1.0 / 3;
  EXPECT_THAT(only_defect(flat).message, HasSubstr("cell 1 (counted from 0) is degenerate"));
}

TEST(CheckMesh, DuplicateCell) {
  Mesh mesh = surface_grid(1);
  append_cell(mesh, {3, 2, 0});
  append_cell(mesh, {0, 1, 3});
  const std::vector<Defect> defects = check_mesh(mesh);
  ASSERT_FALSE(defects.empty());
  EXPECT_EQ(defects[0].kind, Kind::duplicate_cell);
  EXPECT_EQ(defects[0].element, 2);
  EXPECT_EQ(defects[0].count, 2);
  EXPECT_EQ(defects[0].message,
            "cell 2 (counted from 0) has the same vertices as cell 1; 2 cells repeat an earlier one");
}

TEST(CheckMesh, NonManifoldFacet) {
  Mesh mesh = surface_grid(1);
  append_vertex(mesh, 5, 5);
  append_cell(mesh, {0, 3, 4});
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::non_manifold_facet);
  EXPECT_EQ(defect.element, 0);
  EXPECT_EQ(defect.count, 1);
  EXPECT_EQ(defect.message, "the edge of vertices 0, 3 (counted from 0) belongs to 3 cells, 0, 1, 2");

  Mesh volume = tetrahedra();
  append_vertex(volume, -1, -1);
  append_cell(volume, {1, 2, 3, 5});
  EXPECT_THAT(kinds(volume), ElementsAre(Kind::non_manifold_facet, Kind::inconsistent_orientation));
  EXPECT_THAT(check_mesh(volume)[0].message, HasSubstr("the face of vertices 1, 2, 3"));
}

TEST(CheckMesh, InconsistentOrientationOfSurfaces) {
  Mesh mesh = surface_grid(2);
  reverse(mesh, 2);
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::inconsistent_orientation);
  EXPECT_EQ(defect.count, 1);  // a corner of the grid: one interior edge
  EXPECT_THAT(defect.message, HasSubstr("are oriented inconsistently at their common edge of vertices"));
}

TEST(CheckMesh, ClockwisePlanarCells) {
  for (const int dimension : {2, 3}) {
    Mesh mesh = grid(2, dimension);
    reverse(mesh, 2);
    EXPECT_EQ(only_defect(mesh).message, "cell 2 (counted from 0) is clockwise (signed measure -0.5)");
    for (Index c = 0; c < mesh.cell_count(); ++c) {
      if (c != 2) reverse(mesh, c);
    }
    const Defect defect = only_defect(mesh);
    EXPECT_EQ(defect.kind, Kind::inconsistent_orientation);
    EXPECT_EQ(defect.element, 0);
    EXPECT_EQ(defect.count, 8);
    EXPECT_EQ(defect.message, "cell 0 (counted from 0) is clockwise (signed measure -0.5); 8 cells are");
  }
}

TEST(CheckMesh, FoldsOfPlanarMeshes) {
  // Both triangles are counter-clockwise and on the same side of their common edge.
  Mesh mesh{Matrix(4, 2), IndexMatrix(2, 3)};
  mesh.positions << 0, 0, 1, 0, 0, 1, 1, 1;
  mesh.cells << 0, 1, 2, 0, 1, 3;
  EXPECT_THAT(kinds(mesh), ElementsAre(Kind::inconsistent_orientation));
  EXPECT_THAT(kinds(repair_mesh(mesh).mesh), ElementsAre(Kind::inconsistent_orientation));
}

TEST(CheckMesh, InvertedTetrahedra) {
  Mesh mesh = tetrahedra();
  reverse(mesh, 1);
  EXPECT_THAT(only_defect(mesh).message, HasSubstr("cell 1 (counted from 0) is inverted (signed measure -0.333)"));
}

TEST(CheckMesh, UnreferencedVertex) {
  Mesh mesh = grid(1);
  append_vertex(mesh, 7, 7);
  append_vertex(mesh, 8, 8);
  const Defect defect = only_defect(mesh);
  EXPECT_EQ(defect.kind, Kind::unreferenced_vertex);
  EXPECT_EQ(defect.element, 4);
  EXPECT_EQ(defect.count, 2);
  EXPECT_EQ(defect.message, "vertex 4 (counted from 0) belongs to no cell; 2 vertices do");
}

TEST(CheckMesh, WorstDefectFirst) {
  Mesh mesh = surface_grid(2);
  reverse(mesh, 5);
  append_cell(mesh, {0, 0, 1});
  append_cell(mesh, {0, 1, 4});
  append_vertex(mesh, 7, 7);
  EXPECT_THAT(kinds(mesh), ElementsAre(Kind::repeated_vertex, Kind::duplicate_cell, Kind::non_manifold_facet,
                                       Kind::inconsistent_orientation, Kind::unreferenced_vertex));
}

TEST(CheckMesh, NonOrientableSurfacesStayReported) {
  for (const Index n : {5, 12}) {
    const Mesh mesh = moebius(n);
    EXPECT_THAT(kinds(mesh), ElementsAre(Kind::inconsistent_orientation));
    const MeshRepair repair = repair_mesh(mesh);
    EXPECT_EQ(repair.mesh.cells, mesh.cells);
    EXPECT_THAT(repair.warnings, IsEmpty());
    EXPECT_THAT(kinds(repair.mesh), ElementsAre(Kind::inconsistent_orientation));
  }
}

TEST(RepairMesh, GoodMeshesStayAsTheyAre) {
  for (const Mesh& mesh : {grid(3), surface_grid(3), tetrahedra()}) {
    const MeshRepair repair = repair_mesh(mesh, {.degenerate_cells = true, .duplicate_cells = true});
    EXPECT_EQ(repair.mesh.positions, mesh.positions);
    EXPECT_EQ(repair.mesh.cells, mesh.cells);
    EXPECT_THAT(repair.warnings, IsEmpty());
    EXPECT_EQ(repair.vertex_origin.size(), static_cast<std::size_t>(mesh.vertex_count()));
    EXPECT_EQ(repair.cell_origin.back(), mesh.cell_count() - 1);
  }
  EXPECT_EQ(repair_mesh(Mesh()).mesh.vertex_count(), 0);
}

TEST(RepairMesh, DropsUnreferencedVertices) {
  Mesh mesh = grid(1);
  mesh.positions.conservativeResize(6, Eigen::NoChange);
  mesh.positions.bottomRows(2) << 8, 8, 9, 9;
  mesh.positions.row(1).swap(mesh.positions.row(5));
  for (Index& v : mesh.cells.reshaped()) v = v == 1 ? 5 : v;
  const MeshRepair repair = repair_mesh(mesh);
  EXPECT_THAT(kinds(repair.mesh), IsEmpty());
  EXPECT_THAT(repair.vertex_origin, ElementsAre(0, 2, 3, 5));
  EXPECT_THAT(repair.warnings, ElementsAre("dropped 2 unreferenced vertices"));
  for (Index v = 0; v < 4; ++v) EXPECT_EQ(repair.mesh.positions.row(v), mesh.positions.row(repair.vertex_origin[v]));
  EXPECT_THAT(kinds(repair_mesh(mesh, {.unreferenced_vertices = false}).mesh), ElementsAre(Kind::unreferenced_vertex));
}

TEST(RepairMesh, DropsDegenerateCellsAndTheirVertices) {
  Mesh mesh = grid(2);
  append_vertex(mesh, 0.5, 0.0);
  append_cell(mesh, {1, 0, 9});
  append_cell(mesh, {4, 4, 1});
  EXPECT_THAT(kinds(repair_mesh(mesh).mesh), ElementsAre(Kind::repeated_vertex, Kind::degenerate_cell));
  const MeshRepair repair = repair_mesh(mesh, {.degenerate_cells = true});
  EXPECT_THAT(kinds(repair.mesh), IsEmpty());
  EXPECT_EQ(repair.mesh.cells, grid(2).cells);
  EXPECT_THAT(repair.warnings, ElementsAre("dropped 2 degenerate cells", "dropped 1 unreferenced vertex"));
}

TEST(RepairMesh, DropsDuplicateCells) {
  Mesh mesh = surface_grid(1);
  append_cell(mesh, {3, 2, 0});
  append_cell(mesh, {0, 1, 3});
  mesh.cells.row(0).swap(mesh.cells.row(2));
  const MeshRepair repair = repair_mesh(mesh, {.duplicate_cells = true});
  EXPECT_THAT(kinds(repair.mesh), IsEmpty());
  EXPECT_THAT(repair.cell_origin, ElementsAre(0, 2));
  EXPECT_THAT(repair.warnings, ElementsAre("dropped 2 duplicate cells"));
}

TEST(RepairMesh, OrientsRandomlyReversedCells) {
  std::mt19937 random(3);
  for (const Mesh& good : {grid(6), grid(6, 3), surface_grid(6), tetrahedra()}) {
    Mesh mesh = good;
    for (Index c = 0; c < mesh.cell_count(); ++c) {
      if (random() % 3 == 0) reverse(mesh, c);
    }
    const MeshRepair repair = repair_mesh(mesh);
    EXPECT_THAT(kinds(repair.mesh), IsEmpty());
    EXPECT_EQ(repair.mesh.cells, good.cells);
    EXPECT_EQ(repair.warnings.size(), mesh.cells == good.cells ? 0u : 1u);
  }
}

TEST(RepairMesh, TurnsClockwiseMeshes) {
  for (Mesh mesh : {grid(3), grid(3, 3), tetrahedra()}) {
    const Mesh good = mesh;
    for (Index c = 0; c < mesh.cell_count(); ++c) reverse(mesh, c);
    const MeshRepair repair = repair_mesh(mesh);
    EXPECT_EQ(repair.mesh.cells, good.cells);
    EXPECT_THAT(repair.warnings, ElementsAre(HasSubstr("reversed the orientation of")));
    EXPECT_THAT(kinds(repair_mesh(mesh, {.orientation = false}).mesh), ElementsAre(Kind::inconsistent_orientation));
  }
}

TEST(RepairMesh, SurfacesKeepTheOrientationOfTheMajority) {
  Mesh mesh = surface_grid(2);
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    if (c > 2) reverse(mesh, c);
  }
  const MeshRepair repair = repair_mesh(mesh);
  EXPECT_THAT(kinds(repair.mesh), IsEmpty());
  EXPECT_EQ(repair.mesh.cells.bottomRows(5), mesh.cells.bottomRows(5));
  EXPECT_THAT(repair.warnings, ElementsAre("reversed the orientation of 3 cells"));
}

TEST(RepairMesh, ComponentsAreOrientedOnTheirOwn) {
  Mesh mesh = grid(1);
  Mesh other = grid(1);
  mesh.positions.conservativeResize(8, Eigen::NoChange);
  mesh.positions.bottomRows(4) = other.positions.array() + 5.0;
  for (Index c = 0; c < 2; ++c)
    append_cell(mesh, {other.cells(c, 0) + 4, other.cells(c, 2) + 4, other.cells(c, 1) + 4});
  const MeshRepair repair = repair_mesh(mesh);
  EXPECT_THAT(kinds(repair.mesh), IsEmpty());
  EXPECT_THAT(repair.warnings, ElementsAre("reversed the orientation of 2 cells"));
}

TEST(RepairMesh, NeverMendsCoordinatesAndNonManifoldFacets) {
  Mesh mesh = surface_grid(1);
  append_vertex(mesh, 5, 5);
  append_cell(mesh, {0, 3, 4});
  mesh.positions(1, 1) = std::numeric_limits<double>::quiet_NaN();
  const MeshRepair repair = repair_mesh(mesh, {.degenerate_cells = true, .duplicate_cells = true});
  EXPECT_THAT(kinds(repair.mesh), ElementsAre(Kind::not_finite, Kind::non_manifold_facet));
  EXPECT_THAT(repair.warnings, IsEmpty());
}

TEST(RepairMesh, LargeMeshesInReasonableTime) {
  Mesh mesh = surface_grid(300);
  for (Index c = 0; c < mesh.cell_count(); c += 7) reverse(mesh, c);
  EXPECT_THAT(kinds(repair_mesh(mesh).mesh), IsEmpty());
}

}  // namespace
}  // namespace variform
