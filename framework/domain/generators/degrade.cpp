// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <unordered_map>
#include <utility>
#include <vector>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/domain/generators/support.h"

namespace variform {
namespace {

using namespace generators;

/// The number of rounds is also limited by the number of cells, which grows by 2/5 in each.
constexpr int kMaxRefinements = 20;

/// No cell is made smaller than this share of the mean area of the input, nor lower than this share of its longest
/// edge: bad cells are wanted, but such that computing with them still makes sense.
constexpr double kSmallest = 1e-5;
constexpr double kLowest = 0.005;

void require_planar(const Mesh& mesh) {
  const Matrix& x = mesh.positions;
  const bool planar = x.cols() == 2 || (x.cols() == 3 && (x.col(2).array() == x(0, 2)).all());
  if (mesh.cell_count() == 0 || mesh.cells.cols() != 3 || !planar) {
    throw UsageError("degrade_mesh: expected a planar triangle mesh");
  }
  if (mesh.cells.minCoeff() < 0 || mesh.cells.maxCoeff() >= mesh.vertex_count()) {
    throw DataError("degrade_mesh: a cell names a vertex that does not exist");
  }
  Index worst = 0;
  if (!(signed_areas(mesh).minCoeff(&worst) > 0.0)) {
    throw DataError(fmt::format("degrade_mesh: cell {} is not counter-clockwise", worst));
  }
}

/// The edges of a triangle mesh with their cells, which stay right when edges flip.
class Edges {
 public:
  using Edge = std::pair<Index, Index>;
  struct Cells {
    Index first = -1;
    Index second = -1;
  };

  explicit Edges(const Mesh& mesh) {
    cells_.reserve(static_cast<std::size_t>(mesh.cell_count()) * 3 / 2);
    for (Index t = 0; t < mesh.cell_count(); ++t) {
      for (int i = 0; i < 3; ++i) {
        const Edge edge = {mesh.cells(t, i), mesh.cells(t, (i + 1) % 3)};
        const auto [entry, is_new] = cells_.try_emplace(key(edge), Cells{t, -1});
        if (is_new) continue;
        if (entry->second.second >= 0) {
          throw DataError(fmt::format("degrade_mesh: more than two cells at edge {} {}", edge.first, edge.second));
        }
        entry->second.second = t;
        interior_.push_back(edge);
      }
    }
  }

  /// Those of the mesh as it was at first.
  std::vector<Edge>& interior() { return interior_; }

  const Cells& cells(Edge edge) const { return cells_.at(key(edge)); }
  bool contains(Edge edge) const { return cells_.contains(key(edge)); }
  void replace_cell(Edge edge, Index old_cell, Index new_cell) {
    Cells& cells = cells_.at(key(edge));
    (cells.first == old_cell ? cells.first : cells.second) = new_cell;
  }
  void replace_edge(Edge old_edge, Edge new_edge) {
    const auto entry = cells_.find(key(old_edge));
    const Cells cells = entry->second;
    cells_.erase(entry);
    cells_.emplace(key(new_edge), cells);
  }

 private:
  static std::uint64_t key(Edge edge) {
    const auto [low, high] = std::minmax(edge.first, edge.second);
    return static_cast<std::uint64_t>(low) << 32U | static_cast<std::uint64_t>(high);
  }

  std::unordered_map<std::uint64_t, Cells> cells_;  // never iterated: its order differs between platforms
  std::vector<Edge> interior_;
};

/// The vertex of cell t that is not on the edge.
Index opposite(const Mesh& mesh, Index t, const Edges::Edge& edge) {
  for (const Index v : mesh.cells.row(t)) {
    if (v != edge.first && v != edge.second) return v;
  }
  return -1;
}

template <class Entry>
void shuffle(std::vector<Entry>& entries, Random& random) {
  for (auto i = static_cast<Index>(entries.size()); i > 1; --i) std::swap(entries[i - 1], entries[random.below(i)]);
}

/// Shortest edge at each interior vertex, 0 on the boundary.
Vector shortest_interior_edges(const Mesh& mesh) {
  Vector shortest = Vector::Constant(mesh.vertex_count(), std::numeric_limits<double>::infinity());
  const Edges edges(mesh);
  for (Index t = 0; t < mesh.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) {
      const Index a = mesh.cells(t, i);
      const Index b = mesh.cells(t, (i + 1) % 3);
      const bool boundary = edges.cells({a, b}).second < 0;
      const double length = boundary ? 0.0 : (mesh.positions.row(a) - mesh.positions.row(b)).norm();
      shortest(a) = std::min(shortest(a), length);
      shortest(b) = std::min(shortest(b), length);
    }
  }
  return shortest;
}

/// Whether a counter-clockwise triangle with these corners may be made.
bool allowed(const Matrix& positions, Index a, Index b, Index c, double smallest_area) {
  const auto squared_length = [&](Index v, Index w) { return (positions.row(v) - positions.row(w)).squaredNorm(); };
  const double longest = std::max({squared_length(a, b), squared_length(b, c), squared_length(c, a)});
  return signed_area(positions, a, b, c) >= std::max(smallest_area, 0.5 * kLowest * longest);
}

void flip_edges(Mesh& mesh, double fraction, double smallest_area, Random& random) {
  Edges edges(mesh);
  std::vector<Edges::Edge>& candidates = edges.interior();
  auto wanted = static_cast<Index>(std::lround(fraction * static_cast<double>(candidates.size())));
  shuffle(candidates, random);
  for (const Edges::Edge& edge : candidates) {
    if (wanted == 0) break;
    const auto [t, u] = edges.cells(edge);
    // Cell t has the corners a, b, c and cell u the corners b, a, d, both counter-clockwise.
    auto [a, b] = edge;
    const Index c = opposite(mesh, t, edge);
    const Index d = opposite(mesh, u, edge);
    if (signed_area(mesh.positions, a, b, c) < 0.0) std::swap(a, b);
    // Both are counter-clockwise exactly when the quad is strictly convex.
    if (!allowed(mesh.positions, a, d, c, smallest_area) || !allowed(mesh.positions, d, b, c, smallest_area)) continue;
    if (edges.contains({c, d})) continue;
    mesh.cells.row(t) << a, d, c;
    mesh.cells.row(u) << d, b, c;
    edges.replace_edge(edge, {c, d});
    edges.replace_cell({a, d}, u, t);
    edges.replace_cell({b, c}, t, u);
    --wanted;
  }
}

/// Splits a random fifth of the cells at their centroids, passing over those whose parts would be too small or low.
void split_cells(Mesh& mesh, double smallest_area, Random& random) {
  const Index cell_count = mesh.cell_count();
  const Index wanted = (cell_count + 4) / 5;
  Index v = mesh.vertex_count();
  Index end = cell_count;
  mesh.positions.conservativeResize(v + wanted, Eigen::NoChange);
  mesh.cells.conservativeResize(cell_count + 2 * wanted, Eigen::NoChange);

  std::vector<Index> candidates(static_cast<std::size_t>(cell_count));
  std::iota(candidates.begin(), candidates.end(), Index{0});
  shuffle(candidates, random);
  for (const Index t : candidates) {
    if (end == mesh.cell_count()) break;
    const Index a = mesh.cells(t, 0);
    const Index b = mesh.cells(t, 1);
    const Index c = mesh.cells(t, 2);
    mesh.positions.row(v) = (mesh.positions.row(a) + mesh.positions.row(b) + mesh.positions.row(c)) / 3.0;
    if (!allowed(mesh.positions, a, b, v, smallest_area) || !allowed(mesh.positions, b, c, v, smallest_area) ||
        !allowed(mesh.positions, c, a, v, smallest_area)) {
      continue;
    }
    mesh.cells.row(t) << a, b, v;
    mesh.cells.row(end++) << b, c, v;
    mesh.cells.row(end++) << c, a, v;
    ++v;
  }
  mesh.positions.conservativeResize(v, Eigen::NoChange);
  mesh.cells.conservativeResize(end, Eigen::NoChange);
}

}  // namespace

Mesh degrade_mesh(const Mesh& mesh, const DegradeOptions& options) {
  require_range("jitter", options.jitter, 0.0, 1.0);
  require_range("flip_fraction", options.flip_fraction, 0.0, 1.0);
  require_range("refinements", options.refinements, 0, kMaxRefinements);
  require_cell_count("refinements", options.refinements, mesh.cell_count() * std::pow(1.4, options.refinements));
  require_planar(mesh);

  // Far above what counts as degenerate, also relative to the mean of the input, which refinement makes smaller.
  const double smallest_area = kSmallest * signed_areas(mesh).mean();
  Random random(options.seed);
  Mesh result = mesh;
  if (options.jitter > 0.0) {
    const Vector reach = options.jitter * shortest_interior_edges(mesh);
    jitter_vertices(result, reach.replicate(1, 2), random);
  }
  if (options.flip_fraction > 0.0) flip_edges(result, options.flip_fraction, smallest_area, random);
  for (int round = 0; round < options.refinements; ++round) {
    split_cells(result, smallest_area, random);
    if (options.flip_fraction > 0.0) flip_edges(result, options.flip_fraction, smallest_area, random);
  }
  return result;
}

}  // namespace variform
