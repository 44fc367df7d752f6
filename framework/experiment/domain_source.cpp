// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/domain_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>

#include "framework/base/error.h"
#include "framework/domain/check.h"
#include "framework/domain/generators.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/pipeline.h"
#include "framework/topology/topology.h"

namespace variform {
namespace {

const std::vector<std::string> kTessellations = {"regular", "alternating", "random", "graded"};

Parameter positive(const std::string& name, double value, const std::string& doc) {
  return {.name = name, .value = value, .doc = doc, .min = 0.0};
}

Parameter edge_length(double value) { return positive("h", value, "edge length of the cells"); }

Parameter jitter_parameter(double value) {
  return {.name = "jitter",
          .value = value,
          .doc = "interior vertices move by up to this fraction of a grid cell",
          .min = 0.0,
          .max = 0.45};
}

Parameter seed_parameter() {
  return {.name = "seed", .value = std::int64_t{1}, .doc = "of the random numbers", .min = 0.0};
}

/// How a rectangle, flat or bent, is cut into triangles.
std::vector<Parameter> sheet_parameters(double h) {
  return {edge_length(h),
          {.name = "tessellation",
           .value = std::string("random"),
           .doc = "how quads are cut into triangles",
           .choices = kTessellations},
          jitter_parameter(0.0),
          {.name = "grading",
           .value = 1.16,
           .doc = "ratio of neighbouring columns and rows, for tessellation = \"graded\"",
           .min = 1.0},
          seed_parameter()};
}

std::vector<Parameter> operator+(std::vector<Parameter> a, const std::vector<Parameter>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

std::vector<Parameter> rectangle_parameters(double width, double height) {
  return std::vector<Parameter>{positive("width", width, "extent in x"), positive("height", height, "extent in y")} +
         sheet_parameters(1.0 / 32);
}

RectangleOptions sheet_options(const Parameters& p) {
  const auto at = std::find(kTessellations.begin(), kTessellations.end(), p.string("tessellation"));
  return {.h = p.number("h"),
          .tessellation = static_cast<Tessellation>(at - kTessellations.begin()),
          .jitter = p.number("jitter"),
          .grading = p.number("grading"),
          .seed = static_cast<std::uint64_t>(p.integer("seed"))};
}

Mesh make_rectangle(const Parameters& p) {
  RectangleOptions options = sheet_options(p);
  options.width = p.number("width");
  options.height = p.number("height");
  return rectangle_mesh(options);
}

Mesh make_bump(const Parameters& p) {
  const std::vector<double>& centre = p.numbers("centre");
  if (centre.size() != 2) throw UsageError(fmt::format("'centre': expected 2 numbers, found {}", centre.size()));
  return bump_mesh({.base = sheet_options(p),
                    .height = p.number("height"),
                    .sharpness = p.number("sharpness"),
                    .centre = {centre[0], centre[1]}});
}

std::vector<Parameter> bar_parameters(double length, double h) {
  return {positive("length", length, "extent in x"), positive("width", 1.0, "extent in y"),
          positive("height", 1.0, "extent in z"), edge_length(h)};
}

std::vector<Parameter> bar_tet_parameters(double length, double h, double jitter) {
  return bar_parameters(length, h) + std::vector<Parameter>{jitter_parameter(jitter), seed_parameter()};
}

Mesh make_bar_tet(const Parameters& p) {
  return bar_tet_mesh(p.number("length"), p.number("width"), p.number("height"), p.number("h"), p.number("jitter"),
                      static_cast<std::uint64_t>(p.integer("seed")));
}

Parameter count(const std::string& name, std::int64_t value, const std::string& doc) {
  return {.name = name, .value = value, .doc = doc, .min = 1.0, .max = 1e6};
}

Parameter alternating_parameter() {
  return {.name = "alternating", .value = true, .doc = "diagonals in turns; false: all the same way"};
}

std::vector<GeneratorEntry> make_generators() {
  std::vector<GeneratorEntry> entries = {
      {"square", "[0,width] x [0,height], by default the unit square", rectangle_parameters(1.0, 1.0), make_rectangle},
      {"strip", "the same with other defaults: a bar of 4 x 1", rectangle_parameters(4.0, 1.0), make_rectangle},
      {"disk",
       "disk about the origin",
       {positive("radius", 1.0, "of the disk"), edge_length(1.0 / 16)},
       [](const Parameters& p) { return disk_mesh(p.number("radius"), p.number("h")); }},
      {"annulus",
       "ring about the origin",
       {positive("inner_radius", 0.5, "of the hole"), positive("outer_radius", 1.0, "of the ring"),
        edge_length(1.0 / 16)},
       [](const Parameters& p) {
         return annulus_mesh(p.number("inner_radius"), p.number("outer_radius"), p.number("h"));
       }},
      {"bar_surface", "surface of a box", bar_parameters(4.0, 0.125),
       [](const Parameters& p) {
         return bar_surface_mesh(p.number("length"), p.number("width"), p.number("height"), p.number("h"));
       }},
      {"bar_tet", "box filled with tetrahedra", bar_tet_parameters(4.0, 0.125, 0.0), make_bar_tet},
      {"cube_tet", "the same with other defaults: a unit cube with jitter", bar_tet_parameters(1.0, 1.0 / 6, 0.2),
       make_bar_tet},
      {"bump", "the unit square with z = height exp(-sharpness |x - centre|^2)",
       std::vector<Parameter>{
           {.name = "height", .value = 0.3, .doc = "of the bump"},
           positive("sharpness", 20.0, "of the bump, larger is narrower"),
           {.name = "centre", .value = std::vector<double>{0.5, 0.5}, .doc = "of the bump, [x, y]"}} +
           sheet_parameters(1.0 / 32),
       make_bump},
      {"half_cylinder", "open sheet bent over half a cylinder about the y axis",
       std::vector<Parameter>{positive("radius", 0.5, "of the cylinder"), positive("length", 1.0, "extent in y")} +
           sheet_parameters(1.0 / 32),
       [](const Parameters& p) {
         return half_cylinder_mesh(p.number("radius"), p.number("length"), sheet_options(p));
       }},
      {"sphere",
       "geodesic sphere about the origin, 10 n^2 + 2 vertices",
       {positive("radius", 1.0, "of the sphere"), edge_length(1.0 / 8)},
       [](const Parameters& p) { return sphere_mesh(p.number("radius"), p.number("h")); }},
      {"torus",
       "torus about the z axis",
       {positive("major_radius", 1.0, "of the circle in the middle of the tube"),
        positive("minor_radius", 0.4, "of the tube"), edge_length(1.0 / 8)},
       [](const Parameters& p) {
         return torus_mesh(p.number("major_radius"), p.number("minor_radius"), p.number("h"));
       }},
      {"three_balls", "the unit square with three steep swellings like balls, hard to parametrize",
       sheet_parameters(1.0 / 48), [](const Parameters& p) { return three_balls_mesh(sheet_options(p)); }},
      {"hood", "sheet of 1.2 x 1 curved like the hood of a car, with a rim bent down", sheet_parameters(1.0 / 32),
       [](const Parameters& p) { return hood_mesh(sheet_options(p)); }},
      {"tube",
       "open round tube about the z axis",
       {positive("radius", 0.5, "of the tube"), positive("length", 4.0, "extent in z"), count("around", 24, "quads"),
        count("along", 48, "quads"), alternating_parameter()},
       [](const Parameters& p) {
         return tube_mesh({.radius = p.number("radius"),
                           .length = p.number("length"),
                           .around = static_cast<int>(p.integer("around")),
                           .along = static_cast<int>(p.integer("along")),
                           .alternating = p.boolean("alternating")});
       }},
      {"square_tube",
       "closed square tube about the z axis, with caps",
       {positive("length", 4.0, "extent in z"), positive("width", 0.8, "extent in x and y"),
        count("along", 40, "quads of each side"), count("across", 6, "quads of each side and cap"),
        alternating_parameter()},
       [](const Parameters& p) {
         return square_tube_mesh({.length = p.number("length"),
                                  .width = p.number("width"),
                                  .along = static_cast<int>(p.integer("along")),
                                  .across = static_cast<int>(p.integer("across")),
                                  .alternating = p.boolean("alternating")});
       }},
      {"bump_array", "rectangle with a regular array of half ellipsoids",
       rectangle_parameters(1.0, 1.0) +
           std::vector<Parameter>{count("bumps", 5, "in each direction"),
                                  positive("radius", 0.07, "of a bump"),
                                  {.name = "bump_height", .value = 0.07, .doc = "of a bump"}},
       [](const Parameters& p) {
         BumpArrayOptions options{.base = sheet_options(p),
                                  .bumps = static_cast<int>(p.integer("bumps")),
                                  .radius = p.number("radius"),
                                  .height = p.number("bump_height")};
         options.base.width = p.number("width");
         options.base.height = p.number("height");
         return bump_array_mesh(options);
       }},
      {"pillow", "the graph of (1 - x^2) (1 - y^2) / 2 over [-1, 1]^2", sheet_parameters(1.0 / 16),
       [](const Parameters& p) { return pillow_mesh(sheet_options(p)); }},
      {"wing_tet",
       "body with two thin wings filled with tetrahedra, mirror symmetric about x = 0",
       {edge_length(0.1)},
       [](const Parameters& p) { return wing_tet_mesh(p.number("h")); }},
      {"box_car",
       "surface of a box of 2 x 1 x 0.5 with a raised hood",
       {edge_length(1.0 / 24)},
       [](const Parameters& p) { return box_car_mesh(p.number("h")); }},
      {"cactus_surface",
       "surface of a trunk with two bent arms, 1.1 high",
       {edge_length(0.0182)},
       [](const Parameters& p) { return cactus_surface_mesh(p.number("h")); }},
      {"lattice_sphere",
       "sphere about the origin in meridians and parallels",
       {positive("radius", 1.0, "of the sphere"), count("meridians", 36, "at least 3"),
        count("parallels", 17, "rings between the poles")},
       [](const Parameters& p) {
         return lattice_sphere_mesh(p.number("radius"), static_cast<int>(p.integer("meridians")),
                                    static_cast<int>(p.integer("parallels")));
       }},
      {"random_sphere",
       "convex hull of random points on a sphere about the origin",
       {positive("radius", 1.0, "of the sphere"),
        count("points", 642, "12 to 20000"),
        {.name = "rounds",
         .value = std::int64_t{1},
         .doc = "of smoothing: every point to the mean of its neighbours",
         .min = 0.0,
         .max = 1000.0},
        seed_parameter()},
       [](const Parameters& p) {
         return random_sphere_mesh({.radius = p.number("radius"),
                                    .points = static_cast<int>(p.integer("points")),
                                    .rounds = static_cast<int>(p.integer("rounds")),
                                    .seed = static_cast<std::uint64_t>(p.integer("seed"))});
       }}};
  for (const std::string& name : silhouette_names()) {
    entries.push_back(
        {name,
         fmt::format("planar silhouette of a {} with thin limbs, about 1 unit across", name),
         {edge_length(0.015),
          {.name = "symmetric",
           .value = false,
           .doc = "cells mirror symmetric about x = 0, as the shapes of figure and frog are"}},
         [name](const Parameters& p) { return silhouette_mesh(name, p.number("h"), p.boolean("symmetric")); }});
  }
  return entries;
}

const std::vector<std::string> kCommonKeys = {"generator", "mesh",  "triangulate", "repair", "kind",
                                              "centred",   "scale", "degrade",     "cut"};

const GeneratorEntry& generator_of(const ConfigNode& node) {
  const ConfigNode name = node.at("generator");
  return name.located([&]() -> const GeneratorEntry& { return generators().find(name.string()); });
}

Mesh generated(const ConfigNode& node) {
  const GeneratorEntry& entry = generator_of(node);
  const Parameters parameters = node.parameters(entry.parameters, kCommonKeys);
  return node.located([&] { return entry.make(parameters); });
}

RepairOptions read_repairs(const ConfigNode& node) {
  if (!node.has("repair")) return {true, false, false, true};
  RepairOptions repairs{false, false, false, false};
  for (const ConfigNode& kind : node.at("repair").elements()) {
    const std::string name = kind.string();
    if (name == "orientation")
      repairs.orientation = true;
    else if (name == "unreferenced_vertices")
      repairs.unreferenced_vertices = true;
    else if (name == "degenerate_cells")
      repairs.degenerate_cells = true;
    else if (name == "duplicate_cells")
      repairs.duplicate_cells = true;
    else
      kind.fail("expected orientation, unreferenced_vertices, degenerate_cells or duplicate_cells");
  }
  return repairs;
}

double read_scale(const ConfigNode& node) {
  const double scale = node.number_or("scale", 1.0);
  if (!(scale > 0.0 && std::isfinite(scale))) node.at("scale").fail("expected a positive number");
  return scale;
}

/// Whether a flat mesh is to be a surface in space.
bool read_surface(const ConfigNode& node) {
  if (!node.has("kind")) return false;
  if (node.at("kind").string() != "surface") {
    node.at("kind").fail("expected \"surface\"; other kinds follow from the mesh");
  }
  return true;
}

const DomainModifier& modifier(const std::string& name) {
  const std::vector<DomainModifier>& all = domain_modifiers();
  return *std::find_if(all.begin(), all.end(), [&](const DomainModifier& m) { return m.name == name; });
}

Parameters read_degrade(const ConfigNode& node) { return node.parameters(modifier("degrade").parameters); }

/// [domain.cut], in vertices of the input.
struct Cut {
  std::vector<std::int64_t> path;
  std::vector<std::array<std::int64_t, 2>> edges;
  bool to_disk = false;
};

Cut read_cut(const ConfigNode& node) {
  std::vector<std::string> keys;
  for (const Parameter& p : modifier("cut").parameters) keys.push_back(p.name);
  node.accept_keys(keys);
  if (std::count_if(keys.begin(), keys.end(), [&](const std::string& key) { return node.has(key); }) != 1) {
    node.fail("expected one of 'path', 'edges' and 'to_disk'");
  }
  Cut cut;
  if (node.has("path")) {
    cut.path = node.at("path").integers();
    if (cut.path.size() < 2) node.at("path").fail("expected at least 2 vertices");
  } else if (node.has("edges")) {
    for (const ConfigNode& edge : node.at("edges").elements()) {
      const std::vector<std::int64_t> ends = edge.integers();
      if (ends.size() != 2) edge.fail("expected an edge as [vertex, vertex]");
      cut.edges.push_back({ends[0], ends[1]});
    }
    if (cut.edges.empty()) node.at("edges").fail("expected at least one edge [vertex, vertex]");
  } else {
    cut.to_disk = node.at("to_disk").boolean();
    if (!cut.to_disk) node.at("to_disk").fail("expected true; leave [domain.cut] out where nothing is cut");
  }
  return cut;
}

// The input as it is and as repaired: a planar mesh flattened, everything unscaled.
struct Source {
  Mesh input;
  MeshRepair repaired;
};

std::vector<Index> identity(Index count) {
  std::vector<Index> numbers(count);
  std::iota(numbers.begin(), numbers.end(), 0);
  return numbers;
}

Source generated_source(const ConfigNode& node) {
  Mesh mesh = generated(node);
  MeshRepair untouched{mesh, identity(mesh.vertex_count()), identity(mesh.cell_count()), {}};
  return {std::move(mesh), std::move(untouched)};
}

Source read_and_repaired(const ConfigNode& node, const std::filesystem::path& folder,
                         std::vector<std::string>& warnings) {
  const std::filesystem::path file = find_input(node.at("mesh").string(), folder);
  MeshFile read = read_mesh(file, {.triangulate_polygons = node.boolean_or("triangulate", false)});
  for (const std::string& warning : read.warnings) warnings.push_back(file.filename().string() + ": " + warning);
  const RepairOptions repairs = read_repairs(node);
  try {
    MeshRepair repaired = repair_mesh(read_surface(node) ? read.mesh : flattened(read.mesh), repairs);
    for (const std::string& warning : repaired.warnings) warnings.push_back(file.filename().string() + ": " + warning);
    return {std::move(read.mesh), std::move(repaired)};
  } catch (const DataError& error) {
    throw DataError(fmt::format("{}: {}", file.string(), error.what()));
  }
}

/// Puts the centre of the bounding box of the input into the origin.
void centre(Source& source) {
  const Matrix& x = source.input.positions;
  const Eigen::RowVectorXd middle = 0.5 * (x.colwise().minCoeff() + x.colwise().maxCoeff());
  const int flat = source.repaired.mesh.positions.cols() == x.cols() ? -1 : flat_axis(source.input);
  for (int c = 0, to = 0; c < x.cols(); ++c) {
    if (c != flat) source.repaired.mesh.positions.col(to++).array() -= middle[c];
  }
  source.input.positions.rowwise() -= middle;
}

/// With a third coordinate, 0 where there was none.
Mesh in_space(Mesh mesh) {
  if (mesh.positions.cols() == 2) {
    mesh.positions.conservativeResize(Eigen::NoChange, 3);
    mesh.positions.col(2).setZero();
  }
  return mesh;
}

/// The edges to cut, in vertices of the input.
std::vector<Edge> cut_edges(const LoadedDomain& loaded, const ConfigNode& node) {
  const Cut cut = read_cut(node);
  const auto domain_vertex = [&](const ConfigNode& place, std::int64_t input_vertex) {
    return place.located([&] {
      const Index v = loaded.domain_vertex(input_vertex);
      if (v < 0) throw DataError(fmt::format("vertex {} is in no cell", input_vertex));
      return v;
    });
  };
  std::vector<Edge> edges;
  if (cut.to_disk) {
    edges = node.at("to_disk").located([&] { return cut_graph(loaded.domain); });
  } else if (!cut.path.empty()) {
    const ConfigNode place = node.at("path");
    for (std::size_t k = 1; k < cut.path.size(); ++k) {
      const Index from = domain_vertex(place, cut.path[k - 1]);
      const Index to = domain_vertex(place, cut.path[k]);
      const std::vector<Index> path = place.located([&] { return shortest_edge_path(loaded.domain, from, to); });
      for (std::size_t i = 1; i < path.size(); ++i) edges.push_back({path[i - 1], path[i]});
    }
    std::set<Edge> boundary;  // which is open already
    for (const auto side : loaded.domain.boundary_facets().rowwise()) {
      boundary.insert({side(0), side(1)});
      boundary.insert({side(1), side(0)});
    }
    std::erase_if(edges, [&](const Edge& edge) { return boundary.count(edge) > 0; });
    if (edges.empty()) place.fail("the path has no interior edge; expected one to cut");
  } else {
    const std::vector<ConfigNode> places = node.at("edges").elements();
    for (std::size_t k = 0; k < places.size(); ++k) {
      const auto [a, b] = cut.edges[k];
      edges.push_back({domain_vertex(places[k], a), domain_vertex(places[k], b)});
    }
  }
  for (auto& [a, b] : edges) {
    a = loaded.vertex_origin[a];
    b = loaded.vertex_origin[b];
  }
  return edges;
}

/// Cuts a domain of triangles; copies of vertices are appended to the domain and to its input.
void cut_open(LoadedDomain& loaded, const ConfigNode& node) {
  if (loaded.domain.kind() == DomainKind::tetrahedral) node.fail("only triangle meshes can be cut");
  const std::vector<Edge> edges = cut_edges(loaded, node);
  const Mesh uncut = loaded.uncut();
  CutMesh cut = node.located([&] { return cut_along_edges(uncut, edges); });

  const Index uncut_count = uncut.vertex_count();
  const Index domain_count = loaded.domain.vertex_count();
  const auto domain_vertex = [&](Index v) {
    return v < uncut_count ? loaded.domain_vertex(v) : domain_count + v - uncut_count;
  };
  Mesh open{Matrix(domain_count + cut.mesh.vertex_count() - uncut_count, loaded.domain.positions().cols()),
            cut.mesh.cells.unaryExpr(domain_vertex)};
  open.positions.topRows(domain_count) = loaded.domain.positions();
  for (Index v = uncut_count; v < cut.mesh.vertex_count(); ++v) {
    const Index origin = cut.vertex_origin[v];
    open.positions.row(domain_vertex(v)) = loaded.domain.positions().row(domain_vertex(origin));
    loaded.vertex_origin.push_back(v);
    loaded.uncut_vertex.push_back(origin);
  }
  loaded.domain = Domain(open, loaded.domain.kind());
  loaded.input = std::move(cut.mesh);
}

}  // namespace

const std::vector<DomainModifier>& domain_modifiers() {
  static const std::vector<DomainModifier> modifiers = {
      {"degrade",
       "a badly tessellated variant of a planar mesh",
       {{.name = "jitter",
         .value = 0.0,
         .doc = "interior vertices move by up to this fraction of their shortest edge",
         .min = 0.0,
         .max = 1.0},
        {.name = "flip_fraction",
         .value = 0.0,
         .doc = "share of the interior edges that are flipped",
         .min = 0.0,
         .max = 1.0},
        {.name = "refinements",
         .value = std::int64_t{0},
         .doc = "rounds of splitting a random fifth of the cells",
         .min = 0.0,
         .max = 20.0},
        seed_parameter()}},
      {"cut",
       "a triangle mesh cut along edges; one of",
       {{.name = "path",
         .value = std::vector<double>{},
         .doc = "vertices, joined by shortest paths along edges; boundary edges are left out"},
        {.name = "edges", .value = std::vector<double>{}, .doc = "pairs of vertices, [[a, b], ...]"},
        {.name = "to_disk", .value = false, .doc = "opens every component to a disk"}}}};
  return modifiers;
}

const Registry<GeneratorEntry>& generators() {
  static const Registry<GeneratorEntry> registry("generator", make_generators());
  return registry;
}

void check_domain(const ConfigNode& node) {
  if (node.has("generator") == node.has("mesh")) node.fail("expected either 'generator' or 'mesh'");
  if (node.has("generator")) {
    node.parameters(generator_of(node).parameters, kCommonKeys);
  } else {
    node.accept_keys(kCommonKeys);
    node.at("mesh").string();
  }
  node.boolean_or("triangulate", false);
  read_repairs(node);
  read_surface(node);
  node.boolean_or("centred", false);
  read_scale(node);
  if (node.has("degrade")) read_degrade(node.at("degrade"));
  if (node.has("cut")) read_cut(node.at("cut"));
}

LoadedDomain load_domain(const ConfigNode& node, const std::filesystem::path& config_folder) {
  check_domain(node);
  std::vector<std::string> warnings;
  Source source = node.has("generator") ? generated_source(node) : read_and_repaired(node, config_folder, warnings);
  if (node.boolean_or("centred", false)) centre(source);
  const double scale = read_scale(node);
  source.input.positions *= scale;
  source.repaired.mesh.positions *= scale;
  const std::string where = node.has("mesh") ? node.at("mesh").string() + ": " : "";
  const bool surface = read_surface(node);
  if (surface && source.input.cells.cols() == 4) node.at("kind").fail("a mesh of tetrahedra is no surface");
  const auto checked = [&](const Mesh& m) {
    try {
      return surface && m.positions.cols() == 3 ? Domain(m, DomainKind::surface) : Domain(m);
    } catch (const DataError& error) {
      throw DataError(where + error.what());
    }
  };
  Domain domain = checked(source.repaired.mesh);
  if (node.has("degrade")) {
    const ConfigNode degrade = node.at("degrade");
    const Parameters p = read_degrade(degrade);
    if (domain.kind() != DomainKind::planar) degrade.fail("only planar meshes can be degraded");
    const DegradeOptions options{.jitter = p.number("jitter"),
                                 .flip_fraction = p.number("flip_fraction"),
                                 .refinements = static_cast<int>(p.integer("refinements")),
                                 .seed = static_cast<std::uint64_t>(p.integer("seed"))};
    // A degraded mesh is an input of its own: it has more vertices.
    source.input = degrade.located([&] { return degrade_mesh({domain.positions(), domain.cells()}, options); });
    source.repaired.vertex_origin = identity(source.input.vertex_count());
    domain = checked(source.input);
  }
  if (surface && domain.kind() == DomainKind::planar) {
    source.input = in_space(std::move(source.input));
    domain = checked(in_space({domain.positions(), domain.cells()}));
  }
  LoadedDomain loaded{std::move(domain),
                      std::move(warnings),
                      std::move(source.input),
                      source.repaired.vertex_origin,
                      source.repaired.vertex_origin,
                      0};
  loaded.uncut_vertex_count = loaded.input.vertex_count();
  if (node.has("cut")) cut_open(loaded, node.at("cut"));
  return loaded;
}

Index LoadedDomain::domain_vertex(std::int64_t input_vertex) const {
  if (input_vertex < 0 || input_vertex >= input.vertex_count()) {
    throw DataError(
        fmt::format("vertex {} does not exist; the mesh has vertices 0 to {}", input_vertex, input.vertex_count() - 1));
  }
  // Repairs keep the order of vertices.
  const auto found = std::lower_bound(vertex_origin.begin(), vertex_origin.end(), static_cast<Index>(input_vertex));
  return found != vertex_origin.end() && *found == input_vertex ? static_cast<Index>(found - vertex_origin.begin())
                                                                : -1;
}

Mesh LoadedDomain::as_input(const Matrix& U) const {
  Mesh mesh{input.positions, domain.cells()};
  const int flat = domain.kind() == DomainKind::planar ? flat_axis(input) : -1;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    auto to = mesh.positions.row(vertex_origin[v]);
    if (flat < 0) {
      to = U.row(v);
    } else {
      to[flat == 0 ? 1 : 0] = U(v, 0);
      to[flat == 2 ? 1 : 2] = U(v, 1);
    }
  }
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    for (int i = 0; i < domain.cell_size(); ++i) mesh.cells(t, i) = vertex_origin[mesh.cells(t, i)];
  }
  return mesh;
}

Mesh LoadedDomain::uncut() const {
  return {input.positions.topRows(uncut_vertex_count),
          domain.cells().unaryExpr([&](Index v) { return uncut_vertex[v]; })};
}

Matrix LoadedDomain::values_as_input(const Matrix& values) const {
  Matrix result = Matrix::Zero(input.vertex_count(), values.cols());
  for (Index v = 0; v < domain.vertex_count(); ++v) result.row(vertex_origin[v]) = values.row(v);
  return result;
}

}  // namespace variform
