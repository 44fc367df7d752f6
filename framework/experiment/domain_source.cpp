// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/domain_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "framework/base/error.h"
#include "framework/domain/check.h"
#include "framework/domain/generators.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/pipeline.h"

namespace variform {
namespace {

const std::vector<std::string> kTessellations = {"regular", "alternating", "random", "graded"};

Parameter positive(const std::string& name, double value, const std::string& doc) {
  return {.name = name, .value = value, .doc = doc, .min = 0.0};
}

Parameter edge_length(double value) { return positive("h", value, "edge length of the cells"); }

std::vector<Parameter> rectangle_parameters(double width, double height) {
  return {positive("width", width, "extent in x"),
          positive("height", height, "extent in y"),
          edge_length(1.0 / 32),
          {.name = "tessellation",
           .value = std::string("random"),
           .doc = "how quads are cut into triangles",
           .choices = kTessellations},
          {.name = "jitter",
           .value = 0.0,
           .doc = "interior vertices move by up to this fraction of a grid cell",
           .min = 0.0,
           .max = 0.45},
          {.name = "grading",
           .value = 1.16,
           .doc = "ratio of neighbouring columns and rows, for tessellation = \"graded\"",
           .min = 1.0},
          {.name = "seed", .value = std::int64_t{1}, .doc = "of the random numbers", .min = 0.0}};
}

Mesh make_rectangle(const Parameters& p) {
  const auto at = std::find(kTessellations.begin(), kTessellations.end(), p.string("tessellation"));
  return rectangle_mesh({.width = p.number("width"),
                         .height = p.number("height"),
                         .h = p.number("h"),
                         .tessellation = static_cast<Tessellation>(at - kTessellations.begin()),
                         .jitter = p.number("jitter"),
                         .grading = p.number("grading"),
                         .seed = static_cast<std::uint64_t>(p.integer("seed"))});
}

std::vector<Parameter> bar_parameters() {
  return {positive("length", 4.0, "extent in x"), positive("width", 1.0, "extent in y"),
          positive("height", 1.0, "extent in z"), edge_length(0.125)};
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
      {"bar_surface", "surface of a box", bar_parameters(),
       [](const Parameters& p) {
         return bar_surface_mesh(p.number("length"), p.number("width"), p.number("height"), p.number("h"));
       }},
      {"bar_tet", "box filled with tetrahedra", bar_parameters(), [](const Parameters& p) {
         return bar_tet_mesh(p.number("length"), p.number("width"), p.number("height"), p.number("h"));
       }}};
  for (const std::string& name : silhouette_names()) {
    entries.push_back({name,
                       fmt::format("planar silhouette of a {} with thin limbs, about 1 unit across", name),
                       {edge_length(0.015)},
                       [name](const Parameters& p) { return silhouette_mesh(name, p.number("h")); }});
  }
  return entries;
}

const std::vector<std::string> kCommonKeys = {"generator", "mesh", "triangulate", "repair", "scale", "degrade"};

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

Parameters read_degrade(const ConfigNode& node) {
  return node.parameters({{.name = "jitter", .value = 0.0, .doc = "", .min = 0.0, .max = 1.0},
                          {.name = "flip_fraction", .value = 0.0, .doc = "", .min = 0.0, .max = 1.0},
                          {.name = "refinements", .value = std::int64_t{0}, .doc = "", .min = 0.0, .max = 20.0},
                          {.name = "seed", .value = std::int64_t{1}, .doc = "", .min = 0.0}});
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
    MeshRepair repaired = repair_mesh(flattened(read.mesh), repairs);
    for (const std::string& warning : repaired.warnings) warnings.push_back(file.filename().string() + ": " + warning);
    return {std::move(read.mesh), std::move(repaired)};
  } catch (const DataError& error) {
    throw DataError(fmt::format("{}: {}", file.string(), error.what()));
  }
}

}  // namespace

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
  read_scale(node);
  if (node.has("degrade")) read_degrade(node.at("degrade"));
}

LoadedDomain load_domain(const ConfigNode& node, const std::filesystem::path& config_folder) {
  check_domain(node);
  std::vector<std::string> warnings;
  Source source = node.has("generator") ? generated_source(node) : read_and_repaired(node, config_folder, warnings);
  const double scale = read_scale(node);
  source.input.positions *= scale;
  source.repaired.mesh.positions *= scale;
  const std::string where = node.has("mesh") ? node.at("mesh").string() + ": " : "";
  const auto checked = [&](const Mesh& m) {
    try {
      return Domain(m);
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
  return {std::move(domain), std::move(warnings), std::move(source.input), std::move(source.repaired.vertex_origin)};
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

Matrix LoadedDomain::values_as_input(const Matrix& values) const {
  Matrix result = Matrix::Zero(input.vertex_count(), values.cols());
  for (Index v = 0; v < domain.vertex_count(); ++v) result.row(vertex_origin[v]) = values.row(v);
  return result;
}

}  // namespace variform
