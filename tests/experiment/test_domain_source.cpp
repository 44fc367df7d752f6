// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "framework/domain/mesh_io.h"
#include "framework/experiment/domain_source.h"
#include "framework/topology/topology.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Config config_of(const std::string& domain, const std::filesystem::path& folder = {}) {
  return Config::parse("[domain]\n" + domain, "study.toml", folder);
}

LoadedDomain load(const std::string& domain, const std::filesystem::path& folder = {}) {
  return load_domain(config_of(domain, folder).root().at("domain"), folder);
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

/// What holds for a cut domain whatever is cut.
void expect_consistent(const LoadedDomain& loaded) {
  const Index count = loaded.domain.vertex_count();
  ASSERT_EQ(loaded.vertex_origin.size(), static_cast<std::size_t>(count));
  ASSERT_EQ(loaded.uncut_vertex.size(), static_cast<std::size_t>(count));
  for (Index v = 0; v < count; ++v) {
    EXPECT_EQ(loaded.domain_vertex(loaded.vertex_origin[v]), v);
    EXPECT_LT(loaded.uncut_vertex[v], loaded.uncut_vertex_count);
    if (loaded.vertex_origin[v] < loaded.uncut_vertex_count) {
      EXPECT_EQ(loaded.uncut_vertex[v], loaded.vertex_origin[v]);
    }
    EXPECT_EQ(loaded.input.positions.row(loaded.vertex_origin[v]), loaded.input.positions.row(loaded.uncut_vertex[v]));
  }
  const Mesh rest = loaded.as_input(loaded.domain.positions());
  EXPECT_EQ(rest.positions, loaded.input.positions);
  EXPECT_EQ(rest.cells, loaded.input.cells);
}

TEST(DomainSource, EveryGeneratorMakesADomainByDefault) {
  for (const GeneratorEntry& entry : generators().entries()) {
    SCOPED_TRACE(entry.name);
    EXPECT_FALSE(entry.doc.empty());
    const LoadedDomain loaded = load("generator = \"" + entry.name + "\"\n");
    EXPECT_EQ(loaded.domain.component_count(), 1);
    EXPECT_GT(loaded.domain.cell_count(), 100);
    EXPECT_LT(loaded.domain.cell_count(), 20000);
    EXPECT_EQ(loaded.uncut_vertex, loaded.vertex_origin);
    EXPECT_EQ(loaded.uncut_vertex_count, loaded.domain.vertex_count());
    EXPECT_EQ(loaded.uncut().cells, loaded.domain.cells());
  }
}

TEST(DomainSource, FlatMeshesCanBeSurfacesAndCentred) {
  const std::string strip = "generator = \"strip\"\nh = 0.125\nwidth = 5.0\ntessellation = \"alternating\"\n";
  const LoadedDomain planar = load(strip + "centred = true\n");
  EXPECT_EQ(planar.domain.kind(), DomainKind::planar);
  EXPECT_EQ(planar.domain.cell_count(), 2 * 40 * 8);
  EXPECT_EQ(planar.domain.positions().colwise().minCoeff(), Eigen::RowVector2d(-2.5, -0.5));
  EXPECT_EQ(planar.domain.positions().colwise().maxCoeff(), Eigen::RowVector2d(2.5, 0.5));
  expect_consistent(planar);

  const LoadedDomain surface = load(strip + "kind = \"surface\"\ncentred = true\nscale = 2.0\n");
  EXPECT_EQ(surface.domain.kind(), DomainKind::surface);
  EXPECT_EQ(surface.domain.positions().colwise().minCoeff(), Eigen::RowVector3d(-5.0, -1.0, 0.0));
  EXPECT_EQ(surface.domain.positions().colwise().maxCoeff(), Eigen::RowVector3d(5.0, 1.0, 0.0));
  EXPECT_EQ(surface.domain.cells(), planar.domain.cells());
  expect_consistent(surface);

  const LoadedDomain degraded = load(strip + "kind = \"surface\"\ndegrade = { flip_fraction = 0.2 }\n");
  EXPECT_EQ(degraded.domain.kind(), DomainKind::surface);
  expect_consistent(degraded);

  EXPECT_THAT(message_of([&] { load(strip + "kind = \"planar\"\n"); }), HasSubstr("expected \"surface\""));
  EXPECT_THAT(message_of([&] { load("generator = \"bar_tet\"\nkind = \"surface\"\n"); }), HasSubstr("no surface"));
}

TEST(DomainSource, ParametersReachTheSurfaces) {
  const LoadedDomain bump = load(
      "generator = \"bump\"\nheight = 0.5\nsharpness = 40\ncentre = [0.25, 0.5]\nh = 0.25\ntessellation = \"regular\"");
  EXPECT_EQ(bump.domain.vertex_count(), 25);
  EXPECT_EQ(bump.domain.positions()(11, 2), 0.5);
  EXPECT_NEAR(bump.domain.positions()(12, 2), 0.5 * std::exp(-2.5), 1e-15);
  EXPECT_THAT(message_of([] { load("generator = \"bump\"\ncentre = [0.5]"); }),
              HasSubstr("'centre': expected 2 numbers, found 1"));
  EXPECT_EQ(load("generator = \"sphere\"\nradius = 2\nh = 1").domain.vertex_count(), 42);
  EXPECT_EQ(load("generator = \"torus\"\nminor_radius = 0.9\nh = 3.8").domain.vertex_count(), 9);
  EXPECT_EQ(load("generator = \"cube_tet\"\nh = 0.5\njitter = 0").domain.cell_count(), 48);
}

TEST(DomainSource, ACutToADiskKeepsNumbersAndPlaces) {
  const LoadedDomain whole = load("generator = \"torus\"\nh = 0.3\nscale = 2");
  const LoadedDomain loaded = load("generator = \"torus\"\nh = 0.3\nscale = 2\ncut = { to_disk = true }");
  EXPECT_TRUE(topology(loaded.domain).is_disk());
  expect_consistent(loaded);
  EXPECT_EQ(loaded.uncut_vertex_count, whole.domain.vertex_count());
  EXPECT_GT(loaded.domain.vertex_count(), whole.domain.vertex_count());
  EXPECT_EQ(loaded.uncut().positions, whole.domain.positions());
  EXPECT_EQ(loaded.uncut().cells, whole.domain.cells());
  EXPECT_EQ(loaded.domain.cell_measures(), whole.domain.cell_measures());
}

TEST(DomainSource, ACutSurfaceIsWrittenWithASeam) {
  const TemporaryFolder folder;
  const LoadedDomain loaded = load("generator = \"annulus\"\nh = 0.2\ncut = { to_disk = true }");
  EXPECT_EQ(loaded.domain.kind(), DomainKind::planar);
  expect_consistent(loaded);
  const Matrix U = 0.5 * loaded.domain.positions();
  write_obj_uv(folder / "seam.obj", loaded.uncut(), U, loaded.domain.cells());
  const MeshFile file = read_mesh(folder / "seam.obj");
  EXPECT_EQ(file.mesh.positions.leftCols(2), loaded.uncut().positions);
  EXPECT_EQ(file.mesh.cells, loaded.uncut().cells);
  EXPECT_EQ(file.uv, U);
  EXPECT_EQ(file.uv_cells, loaded.domain.cells());
  EXPECT_EQ(topology(Domain(file.mesh)).boundary_loops, 2);
}

/// 3 x 3 vertices 1..9 in the plane x = 5, after and before two that no cell uses: 0 and 10.
std::filesystem::path store_square(const TemporaryFolder& folder) {
  Mesh mesh{Matrix::Constant(11, 3, 5.0), IndexMatrix(8, 3)};
  Index t = 0;
  for (Index j = 0; j < 3; ++j) {
    for (Index i = 0; i < 3; ++i) {
      const Index v = 1 + 3 * j + i;
      mesh.positions.row(v) << 5.0, i, j;
      if (i == 2 || j == 2) continue;
      mesh.cells.row(t++) << v, v + 1, v + 4;
      mesh.cells.row(t++) << v, v + 4, v + 3;
    }
  }
  mesh.positions.row(0) << 5.0, -1.0, -1.0;
  write_mesh(folder / "square.obj", mesh);
  return folder.path();
}

TEST(DomainSource, CutsNameVerticesOfTheInputWhateverWasDropped) {
  const TemporaryFolder folder;
  const std::filesystem::path place = store_square(folder);
  for (const std::string cut : {"path = [2, 8]", "edges = [[2, 5], [8, 5]]", "path = [1, 2, 5, 8]"}) {
    SCOPED_TRACE(cut);
    const LoadedDomain loaded = load("mesh = \"square.obj\"\n[domain.cut]\n" + cut, place);
    expect_consistent(loaded);
    EXPECT_EQ(loaded.domain.kind(), DomainKind::planar);
    EXPECT_EQ(loaded.domain.component_count(), 2);
    EXPECT_EQ(loaded.input.vertex_count(), 14);
    EXPECT_EQ(loaded.uncut_vertex_count, 11);
    EXPECT_EQ(loaded.domain_vertex(0), -1);
    EXPECT_EQ(loaded.domain_vertex(10), -1);
    EXPECT_THAT(loaded.vertex_origin, ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13));
    EXPECT_THAT(loaded.uncut_vertex, ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9, 2, 5, 8));
    const Matrix values = loaded.values_as_input(Matrix::Ones(12, 1));
    EXPECT_EQ(values.sum(), 12.0);
    EXPECT_EQ(values(0, 0), 0.0);
    EXPECT_EQ(values(10, 0), 0.0);
    // A state moves copies on their own and keeps the coordinate that flattening dropped.
    Matrix U = loaded.domain.positions();
    U.row(9) << -3.0, -4.0;
    const Mesh moved = loaded.as_input(U);
    EXPECT_EQ(moved.positions.row(11), Eigen::RowVector3d(5.0, -3.0, -4.0));
    EXPECT_EQ(moved.positions.row(2), loaded.input.positions.row(2));
  }
}

TEST(DomainSource, ADegradedMeshCanBeCut) {
  const LoadedDomain loaded = load(
      "generator = \"annulus\"\nh = 0.2\ndegrade = { refinements = 1, flip_fraction = 0.2 }\ncut = { to_disk = true }");
  expect_consistent(loaded);
  EXPECT_TRUE(topology(loaded.domain).is_disk());
}

TEST(DomainSource, BadCutsAreToldWithTheirKey) {
  const TemporaryFolder folder;
  const std::filesystem::path place = store_square(folder);
  const std::string square = "mesh = \"square.obj\"\n[domain.cut]\n";
  const std::string any = "generator = \"torus\"\n[domain.cut]\n";
  // Wrong whatever the mesh.
  const std::vector<std::pair<std::string, std::string>> senseless = {
      {any, "key 'domain.cut': expected one of 'path', 'edges' and 'to_disk'"},
      {any + "to_disk = true\npath = [0, 1]", "key 'domain.cut': expected one of"},
      {any + "paths = [0, 1]", "paths"},
      {any + "path = [0]", "key 'domain.cut.path': expected at least 2 vertices"},
      {any + "path = [0, 0.5]", "domain.cut.path"},
      {any + "edges = []", "key 'domain.cut.edges': expected at least one edge"},
      {any + "edges = [[0, 1], [1, 2, 3]]", "expected an edge as [vertex, vertex]"},
      {any + "edges = [0, 1]", "domain.cut.edges"},
      {any + "to_disk = false", "key 'domain.cut.to_disk': expected true"},
      {any + "to_disk = 1", "domain.cut.to_disk"},
  };
  for (const auto& [text, expected] : senseless) {
    EXPECT_THAT(message_of([&] { check_domain(config_of(text).root().at("domain")); }), HasSubstr(expected)) << text;
    EXPECT_THROW(check_domain(config_of(text).root().at("domain")), UsageError) << text;
  }
  const std::vector<std::pair<std::string, std::string>> unfit = {
      {square + "path = [2, 99]", "key 'domain.cut.path': vertex 99 does not exist; the mesh has vertices 0 to 10"},
      {square + "path = [0, 5]", "key 'domain.cut.path': vertex 0 is in no cell"},
      {square + "path = [1, 3]", "key 'domain.cut.path': the path has no interior edge"},
      {square + "edges = [[2, 5], [5, -1]]", "vertex -1 does not exist"},
      {square + "edges = [[2, 5], [2, 3]]", "key 'domain.cut': edge (2, 3) is on the boundary"},
      {square + "edges = [[1, 9]]", "key 'domain.cut': edge (1, 9) is not in the mesh"},
      {"generator = \"bar_tet\"\ncut = { to_disk = true }", "key 'domain.cut': only triangle meshes can be cut"},
      {"generator = \"sphere\"\ncut = { edges = [[0, 12]] }", "edge (0, 12) cannot be opened alone"},
  };
  for (const auto& [text, expected] : unfit) {
    EXPECT_NO_THROW(check_domain(config_of(text).root().at("domain"))) << text;
    EXPECT_THAT(message_of([&] { load(text, place); }), HasSubstr(expected)) << text;
  }
}

TEST(DomainSource, ModifiersListTheKeysThatTheyTake) {
  for (const DomainModifier& modifier : domain_modifiers()) {
    EXPECT_FALSE(modifier.doc.empty());
    for (const Parameter& p : modifier.parameters) EXPECT_FALSE(p.doc.empty()) << p.name;
  }
}

}  // namespace
}  // namespace variform
