// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/check.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {
namespace {

constexpr Index kNone = -1;

/// The first of several elements with a defect, and their number.
struct Finding {
  Index first = kNone;
  Index count = 0;

  void add(Index element) {
    if (count == 0) first = element;
    ++count;
  }
};

/// Vertices of a cell or facet in ascending order; those that it lacks come last as kNone.
template <std::size_t size>
using VertexSet = std::array<Index, size>;

/// A facet as one cell sees it.
struct Facet {
  VertexSet<3> vertices;
  Index cell;
  bool is_odd;  ///< the cell traverses the vertices in an order that is an odd permutation of the ascending one

  auto key() const { return std::tie(vertices, cell); }
};

struct CellVertices {
  VertexSet<4> vertices;
  Index cell;

  auto key() const { return std::tie(vertices, cell); }
};

/// Sorts by key: first into buckets of the smallest vertex, which are small, then each of these.
template <class Item>
void sort_by_key(std::vector<Item>& items, Index vertex_count) {
  std::vector<Index> offsets(static_cast<std::size_t>(vertex_count) + 1, 0);
  for (const Item& item : items) ++offsets[item.vertices[0] + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  std::vector<Item> sorted(items.size());
  std::vector<Index> next(offsets.begin(), offsets.end() - 1);
  for (const Item& item : items) sorted[next[item.vertices[0]]++] = item;
  parallel_for(vertex_count, [&](Index v) {
    std::sort(sorted.begin() + offsets[v], sorted.begin() + offsets[v + 1],
              [](const Item& a, const Item& b) { return a.key() < b.key(); });
  });
  items.swap(sorted);
}

/// Calls body(group) for each group of sorted items with equal vertices.
template <class Item, class Body>
void for_each_group(const std::vector<Item>& items, const Body& body) {
  for (auto begin = items.begin(); begin != items.end();) {
    const auto end =
        std::find_if(begin, items.end(), [&](const Item& item) { return item.vertices != begin->vertices; });
    body(std::span<const Item>(begin, end));
    begin = end;
  }
}

bool is_tetrahedral(const Mesh& mesh) { return mesh.cells.cols() == 4; }

/// Planar triangles and tetrahedra have a sign.
bool is_signed(const Mesh& mesh) {
  return is_tetrahedral(mesh) || mesh.positions.cols() == 2 ||
         (mesh.positions.col(2).array() == mesh.positions(0, 2)).all();
}

/// Throws DataError when the tables have the wrong number of columns.
void require_shape(const Mesh& mesh) {
  const auto columns = mesh.positions.cols();
  const auto corners = mesh.cells.cols();
  if ((corners == 3 && (columns == 2 || columns == 3)) || (corners == 4 && columns == 3)) return;
  throw DataError(fmt::format(
      "found {} coordinates per vertex and {} vertices per cell, expected 2 or 3 and 3 (triangles) or 3 and 4 "
      "(tetrahedra)",
      columns, corners));
}

Index find_vertex_out_of_range(const Mesh& mesh, Index cell) {
  for (Index k = 0; k < mesh.cells.cols(); ++k) {
    if (mesh.cells(cell, k) < 0 || mesh.cells(cell, k) >= mesh.vertex_count()) return k;
  }
  return kNone;
}

/// The place in the cell of a vertex that comes again later, kNone when all differ.
Index find_repeated_vertex(const Mesh& mesh, Index cell) {
  for (Index k = 0; k < mesh.cells.cols(); ++k) {
    for (Index l = 0; l < k; ++l) {
      if (mesh.cells(cell, k) == mesh.cells(cell, l)) return l;
    }
  }
  return kNone;
}

bool has_repeated_vertex(const Mesh& mesh, Index cell) { return find_repeated_vertex(mesh, cell) != kNone; }

/// Areas or volumes of all cells, and what follows from them.
struct Measures {
  Vector values;  ///< negative for clockwise planar triangles and for inverted tetrahedra
  double mean = 0.0;

  explicit Measures(const Mesh& mesh) : values(mesh.cell_count()) {
    const bool has_sign = is_signed(mesh);
    parallel_for(mesh.cell_count(), [&](Index c) { values(c) = measure(mesh, c, has_sign); });
    mean = parallel_sum(mesh.cell_count(), [&](Index c) { return std::abs(values(c)); }) / mesh.cell_count();
  }

  // Both are false where coordinates are not finite.
  bool is_degenerate(Index cell) const { return std::abs(values(cell)) <= kDegenerateMeasure * mean; }
  bool is_negative(Index cell) const { return values(cell) < -kDegenerateMeasure * mean; }

 private:
  static double measure(const Mesh& mesh, Index cell, bool has_sign) {
    std::array<Eigen::Vector3d, 3> edges;
    for (Index k = 0; k + 1 < mesh.cells.cols(); ++k) {
      edges[k].setZero();
      edges[k].head(mesh.positions.cols()) =
          mesh.positions.row(mesh.cells(cell, k + 1)) - mesh.positions.row(mesh.cells(cell, 0));
    }
    const Eigen::Vector3d normal = edges[0].cross(edges[1]);
    if (is_tetrahedral(mesh)) return normal.dot(edges[2]) / 6.0;
    return (has_sign ? normal.z() : normal.norm()) / 2.0;
  }
};

/// The facets of all cells without repeated vertices, sorted by their vertices.
std::vector<Facet> sorted_facets(const Mesh& mesh) {
  std::vector<Facet> facets;
  facets.reserve(static_cast<std::size_t>(mesh.cells.size()));
  const Index corners = static_cast<Index>(mesh.cells.cols());
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    if (has_repeated_vertex(mesh, c)) continue;
    for (Index opposite = 0; opposite < corners; ++opposite) {
      Facet facet{.vertices = {kNone, kNone, kNone}, .cell = c, .is_odd = opposite % 2 == 1};
      Index size = 0;
      for (Index k = 0; k < corners; ++k) {
        if (k == opposite) continue;
        // Insertion sort; each exchange changes the parity.
        facet.vertices[size] = mesh.cells(c, k);
        for (Index i = size; i > 0 && facet.vertices[i - 1] > facet.vertices[i]; --i) {
          std::swap(facet.vertices[i - 1], facet.vertices[i]);
          facet.is_odd = !facet.is_odd;
        }
        ++size;
      }
      facets.push_back(facet);
    }
  }
  sort_by_key(facets, mesh.vertex_count());
  return facets;
}

/// For each cell the first one with the same vertices (maybe itself).
std::vector<Index> first_equal_cells(const Mesh& mesh) {
  std::vector<CellVertices> cells(static_cast<std::size_t>(mesh.cell_count()));
  parallel_for(mesh.cell_count(), [&](Index c) {
    VertexSet<4> vertices{kNone, kNone, kNone, kNone};
    for (Index k = 0; k < mesh.cells.cols(); ++k) vertices[k] = mesh.cells(c, k);
    std::sort(vertices.begin(), vertices.begin() + mesh.cells.cols());
    cells[c] = {vertices, c};
  });
  sort_by_key(cells, mesh.vertex_count());
  std::vector<Index> first(cells.size());
  for_each_group(cells, [&](std::span<const CellVertices> group) {
    for (const CellVertices& cell : group) first[cell.cell] = group.front().cell;
  });
  return first;
}

std::vector<bool> referenced_vertices(const Mesh& mesh) {
  std::vector<bool> is_referenced(static_cast<std::size_t>(mesh.vertex_count()), false);
  for (const Index v : mesh.cells.reshaped()) is_referenced[v] = true;
  return is_referenced;
}

/// "; 3 cells are", nothing when there is only one.
std::string others(const Finding& finding, std::string_view what) {
  return finding.count > 1 ? fmt::format("; {} {}", finding.count, what) : "";
}

class Checker {
 public:
  explicit Checker(const Mesh& mesh) : mesh_(mesh) {}

  std::vector<Defect> check() {
    if (mesh_.cell_count() == 0) return {{Defect::Kind::empty, kNone, 1, "the mesh has no cells"}};
    require_shape(mesh_);
    check_coordinates();
    check_indices();
    if (!defects_.empty() && defects_.back().kind == Defect::Kind::index_out_of_range) return std::move(defects_);
    check_repeated_vertices();
    const Measures measures(mesh_);
    check_degenerate_cells(measures);
    check_duplicate_cells();
    check_facets(measures);
    check_unreferenced_vertices();
    return std::move(defects_);
  }

 private:
  void add(Defect::Kind kind, const Finding& finding, std::string message) {
    defects_.push_back({kind, finding.first, finding.count, std::move(message)});
  }

  /// All cells of which test(cell) is true.
  template <class Test>
  Finding find_cells(const Test& test) const {
    Finding finding;
    for (Index c = 0; c < mesh_.cell_count(); ++c) {
      if (test(c)) finding.add(c);
    }
    return finding;
  }

  void check_coordinates() {
    Finding finding;
    for (Index v = 0; v < mesh_.vertex_count(); ++v) {
      if (!mesh_.positions.row(v).allFinite()) finding.add(v);
    }
    if (finding.count == 0) return;
    const auto point = mesh_.positions.row(finding.first);
    add(Defect::Kind::not_finite, finding,
        fmt::format("vertex {} (counted from 0) has coordinates that are not finite, ({}){}", finding.first,
                    fmt::join(point.begin(), point.end(), ", "), others(finding, "vertices have")));
  }

  void check_indices() {
    const Finding finding = find_cells([&](Index c) { return find_vertex_out_of_range(mesh_, c) != kNone; });
    if (finding.count == 0) return;
    const Index vertex = mesh_.cells(finding.first, find_vertex_out_of_range(mesh_, finding.first));
    add(Defect::Kind::index_out_of_range, finding,
        fmt::format("cell {} (counted from 0) names vertex {} of a mesh with {} vertices{}", finding.first, vertex,
                    mesh_.vertex_count(), others(finding, "cells name vertices that do not exist")));
  }

  void check_repeated_vertices() {
    const Finding finding = find_cells([&](Index c) { return has_repeated_vertex(mesh_, c); });
    if (finding.count == 0) return;
    const Index vertex = mesh_.cells(finding.first, find_repeated_vertex(mesh_, finding.first));
    add(Defect::Kind::repeated_vertex, finding,
        fmt::format("cell {} (counted from 0) names vertex {} more than once{}", finding.first, vertex,
                    others(finding, "cells repeat a vertex")));
  }

  void check_degenerate_cells(const Measures& measures) {
    const Finding finding =
        find_cells([&](Index c) { return measures.is_degenerate(c) && !has_repeated_vertex(mesh_, c); });
    if (finding.count == 0) return;
    add(Defect::Kind::degenerate_cell, finding,
        fmt::format("cell {} (counted from 0) is degenerate (measure {:.3g}, mean {:.3g}){}", finding.first,
                    std::abs(measures.values(finding.first)), measures.mean, others(finding, "cells are")));
  }

  void check_duplicate_cells() {
    const std::vector<Index> first = first_equal_cells(mesh_);
    const Finding finding = find_cells([&](Index c) { return first[c] != c; });
    if (finding.count == 0) return;
    add(Defect::Kind::duplicate_cell, finding,
        fmt::format("cell {} (counted from 0) has the same vertices as cell {}{}", finding.first, first[finding.first],
                    others(finding, "cells repeat an earlier one")));
  }

  void check_facets(const Measures& measures) {
    Finding crowded;  // by their first cells
    Finding twisted;
    std::string crowded_message;
    std::string twisted_message;
    const std::string_view facet_name = is_tetrahedral(mesh_) ? "face" : "edge";
    for_each_group(sorted_facets(mesh_), [&](std::span<const Facet> group) {
      const auto vertices = std::span(group[0].vertices).first(static_cast<std::size_t>(mesh_.cells.cols()) - 1);
      if (group.size() > 2) {
        if (crowded.count == 0) {
          std::vector<Index> cells;
          for (const Facet& facet : group.first(3)) cells.push_back(facet.cell);
          crowded_message = fmt::format("the {} of vertices {} (counted from 0) belongs to {} cells, {}{}", facet_name,
                                        fmt::join(vertices, ", "), group.size(), fmt::join(cells, ", "),
                                        group.size() > 3 ? ", ..." : "");
        }
        crowded.add(group[0].cell);
      } else if (group.size() == 2 && group[0].is_odd == group[1].is_odd) {
        if (twisted.count == 0) {
          twisted_message = fmt::format(
              "cells {} and {} (counted from 0) are oriented inconsistently at their common {} of vertices {}",
              group[0].cell, group[1].cell, facet_name, fmt::join(vertices, ", "));
        }
        twisted.add(group[0].cell);
      }
    });
    if (crowded.count > 0) {
      add(Defect::Kind::non_manifold_facet, crowded,
          crowded_message + others(crowded, fmt::format("{}s belong to more than two", facet_name)));
    }

    // A negative cell says more than the facets at which it differs from its neighbours.
    const Finding negative = find_cells([&](Index c) { return is_signed(mesh_) && measures.is_negative(c); });
    if (negative.count > 0) {
      add(Defect::Kind::inconsistent_orientation, negative,
          fmt::format("cell {} (counted from 0) is {} (signed measure {:.3g}){}", negative.first,
                      is_tetrahedral(mesh_) ? "inverted" : "clockwise", measures.values(negative.first),
                      others(negative, "cells are")));
    } else if (twisted.count > 0) {
      add(Defect::Kind::inconsistent_orientation, twisted,
          twisted_message + others(twisted, fmt::format("{}s are inconsistent", facet_name)));
    }
  }

  void check_unreferenced_vertices() {
    const std::vector<bool> is_referenced = referenced_vertices(mesh_);
    Finding finding;
    for (Index v = 0; v < mesh_.vertex_count(); ++v) {
      if (!is_referenced[v]) finding.add(v);
    }
    if (finding.count == 0) return;
    add(Defect::Kind::unreferenced_vertex, finding,
        fmt::format("vertex {} (counted from 0) belongs to no cell{}", finding.first, others(finding, "vertices do")));
  }

  const Mesh& mesh_;
  std::vector<Defect> defects_;
};

/// Components of cells that know for each cell whether it is oriented like the first cell of its component.
class OrientedComponents {
 public:
  explicit OrientedComponents(Index count) : parents_(count), is_flipped_(count, 0), is_orientable_(count, 1) {
    std::iota(parents_.begin(), parents_.end(), 0);
  }

  struct Place {
    Index root;       ///< first cell of the component
    bool is_flipped;  ///< against the root
  };

  Place find(Index cell) {
    // Two walks: the first finds the root and the parity of the way, the second shortens the way.
    Index root = cell;
    bool parity = false;
    for (; parents_[root] != root; root = parents_[root]) parity ^= is_flipped_[root] != 0;
    const Place place{root, parity};
    while (parents_[cell] != root && cell != root) {
      const Index next = std::exchange(parents_[cell], root);
      parity ^= std::exchange(is_flipped_[cell], parity ? 1 : 0) != 0;
      cell = next;
    }
    return place;
  }

  /// Joins two cells that agree in orientation or are opposite.
  void join(Index a, Index b, bool is_opposite) {
    Place first = find(a);
    Place second = find(b);
    const bool parity = first.is_flipped ^ second.is_flipped ^ is_opposite;
    if (first.root == second.root) {
      if (parity) is_orientable_[first.root] = 0;
      return;
    }
    if (first.root > second.root) std::swap(first, second);
    parents_[second.root] = first.root;
    is_flipped_[second.root] = parity ? 1 : 0;
    is_orientable_[first.root] &= is_orientable_[second.root];
  }

  bool is_orientable(Index root) const { return is_orientable_[root] != 0; }

 private:
  std::vector<Index> parents_;
  std::vector<char> is_flipped_;  ///< against the parent
  std::vector<char> is_orientable_;
};

/// Cells to turn so that each orientable component is consistent: positive where cells have a sign, else as most of its
/// cells were.
std::vector<bool> cells_to_flip(const Mesh& mesh) {
  OrientedComponents components(mesh.cell_count());
  for_each_group(sorted_facets(mesh), [&](std::span<const Facet> group) {
    if (group.size() == 2) components.join(group[0].cell, group[1].cell, group[0].is_odd == group[1].is_odd);
  });

  const bool has_sign = is_signed(mesh);
  const Measures measures(mesh);
  std::vector<double> votes(static_cast<std::size_t>(mesh.cell_count()), 0.0);  // of roots, to keep their orientation
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    const auto [root, is_flipped] = components.find(c);
    const double vote = has_sign ? measures.values(c) : 1.0;
    votes[root] += is_flipped ? -vote : vote;
  }
  std::vector<bool> flips(votes.size(), false);
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    const auto [root, is_flipped] = components.find(c);
    flips[c] = components.is_orientable(root) && is_flipped != (votes[root] < 0.0);
  }
  return flips;
}

/// "dropped 1 degenerate cell", "dropped 3 degenerate cells".
std::string action(std::string_view verb, std::ptrdiff_t count, std::string_view one, std::string_view many) {
  return fmt::format("{} {} {}", verb, count, count == 1 ? one : many);
}

/// Drops the marked cells. The warning is about `one` or `many` cells.
void drop_cells(MeshRepair& repair, const std::vector<bool>& is_dropped, std::string_view one, std::string_view many) {
  const auto count = std::count(is_dropped.begin(), is_dropped.end(), true);
  if (count == 0) return;
  Index kept = 0;
  for (Index c = 0; c < repair.mesh.cell_count(); ++c) {
    if (is_dropped[c]) continue;
    repair.mesh.cells.row(kept) = repair.mesh.cells.row(c);
    repair.cell_origin[kept++] = repair.cell_origin[c];
  }
  repair.mesh.cells.conservativeResize(kept, Eigen::NoChange);
  repair.cell_origin.resize(kept);
  repair.warnings.push_back(action("dropped", count, one, many));
}

void drop_degenerate_cells(MeshRepair& repair) {
  const Mesh& mesh = repair.mesh;
  const Measures measures(mesh);
  std::vector<bool> is_dropped(static_cast<std::size_t>(mesh.cell_count()));
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    is_dropped[c] = measures.is_degenerate(c) || has_repeated_vertex(mesh, c);
  }
  drop_cells(repair, is_dropped, "degenerate cell", "degenerate cells");
}

void drop_duplicate_cells(MeshRepair& repair) {
  const std::vector<Index> first = first_equal_cells(repair.mesh);
  std::vector<bool> is_dropped(first.size());
  for (std::size_t c = 0; c < first.size(); ++c) is_dropped[c] = first[c] != static_cast<Index>(c);
  drop_cells(repair, is_dropped, "duplicate cell", "duplicate cells");
}

void orient_cells(MeshRepair& repair) {
  const std::vector<bool> flips = cells_to_flip(repair.mesh);
  for (std::size_t c = 0; c < flips.size(); ++c) {
    const auto row = static_cast<Index>(c);
    if (flips[c]) std::swap(repair.mesh.cells(row, 1), repair.mesh.cells(row, 2));
  }
  const auto count = std::count(flips.begin(), flips.end(), true);
  if (count > 0) repair.warnings.push_back(action("reversed the orientation of", count, "cell", "cells"));
}

void drop_unreferenced_vertices(MeshRepair& repair) {
  Mesh& mesh = repair.mesh;
  const std::vector<bool> is_referenced = referenced_vertices(mesh);
  const auto count = std::count(is_referenced.begin(), is_referenced.end(), false);
  if (count == 0) return;
  std::vector<Index> new_numbers(is_referenced.size(), kNone);
  Index kept = 0;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    if (!is_referenced[v]) continue;
    mesh.positions.row(kept) = mesh.positions.row(v);
    repair.vertex_origin[kept] = v;
    new_numbers[v] = kept++;
  }
  mesh.positions.conservativeResize(kept, Eigen::NoChange);
  repair.vertex_origin.resize(kept);
  for (Index& v : mesh.cells.reshaped()) v = new_numbers[v];
  repair.warnings.push_back(action("dropped", count, "unreferenced vertex", "unreferenced vertices"));
}

}  // namespace

std::vector<Defect> check_mesh(const Mesh& mesh) { return Checker(mesh).check(); }

MeshRepair repair_mesh(const Mesh& mesh, const RepairOptions& options) {
  if (mesh.cell_count() > 0) require_shape(mesh);
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    const Index k = find_vertex_out_of_range(mesh, c);
    if (k == kNone) continue;
    throw DataError(fmt::format("cell {} (counted from 0) names vertex {} of a mesh with {} vertices", c,
                                mesh.cells(c, k), mesh.vertex_count()));
  }

  MeshRepair repair;
  repair.mesh = mesh;
  repair.vertex_origin.resize(static_cast<std::size_t>(mesh.vertex_count()));
  repair.cell_origin.resize(static_cast<std::size_t>(mesh.cell_count()));
  std::iota(repair.vertex_origin.begin(), repair.vertex_origin.end(), 0);
  std::iota(repair.cell_origin.begin(), repair.cell_origin.end(), 0);

  const auto has_cells = [&] { return repair.mesh.cell_count() > 0; };
  if (options.degenerate_cells && has_cells()) drop_degenerate_cells(repair);
  if (options.duplicate_cells && has_cells()) drop_duplicate_cells(repair);
  if (options.orientation && has_cells()) orient_cells(repair);
  if (options.unreferenced_vertices) drop_unreferenced_vertices(repair);  // last: dropped cells leave some
  return repair;
}

}  // namespace variform
