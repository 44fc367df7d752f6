// SPDX-License-Identifier: BSD-3-Clause
#include "framework/topology/topology.h"

#include <boost/graph/adjacency_list.hpp>
#include <boost/graph/dijkstra_shortest_paths.hpp>
#include <boost/graph/kruskal_min_spanning_tree.hpp>
#include <boost/pending/disjoint_sets.hpp>
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <tuple>

#include "framework/base/error.h"

namespace variform {
namespace {

using WeightedGraph = boost::adjacency_list<boost::vecS, boost::vecS, boost::undirectedS, boost::no_property,
                                            boost::property<boost::edge_weight_t, double>>;
using RankedGraph = boost::adjacency_list<boost::vecS, boost::vecS, boost::undirectedS, boost::no_property,
                                          boost::property<boost::edge_weight_t, Index>>;

void require_triangles(Eigen::Index cell_size) {
  if (cell_size != 3) throw UsageError("topology: expected a triangle mesh");
}

std::string name_of(const Edge& edge) { return fmt::format("edge ({}, {})", edge[0], edge[1]); }

/// The edges of a triangle mesh, in ascending order of their vertices.
struct EdgeTable {
  std::vector<Edge> vertices;   ///< lower vertex first
  std::vector<Edge> cells;      ///< the one or two cells, -1 for none
  std::vector<bool> is_branch;  ///< more than two cells
  IndexMatrix of_cell;          ///< cells x 3: the edge from corner i to corner i + 1

  explicit EdgeTable(const IndexMatrix& triangles) : of_cell(triangles.rows(), 3) {
    require_triangles(triangles.cols());
    std::vector<std::tuple<Edge, Index, int>> sides;
    sides.reserve(static_cast<std::size_t>(triangles.size()));
    for (Index t = 0; t < triangles.rows(); ++t) {
      for (int i = 0; i < 3; ++i) {
        const auto [low, high] = std::minmax(triangles(t, i), triangles(t, (i + 1) % 3));
        sides.push_back({{low, high}, t, i});
      }
    }
    std::sort(sides.begin(), sides.end());
    for (const auto& [edge, t, i] : sides) {
      if (vertices.empty() || vertices.back() != edge) {
        vertices.push_back(edge);
        cells.push_back({t, -1});
        is_branch.push_back(false);
      } else if (cells.back()[1] < 0) {
        cells.back()[1] = t;
      } else {
        is_branch.back() = true;
      }
      of_cell(t, i) = count() - 1;
    }
  }

  Index count() const { return static_cast<Index>(vertices.size()); }
  bool is_boundary(Index e) const { return cells[e][1] < 0; }
  Index other_cell(Index e, Index t) const { return cells[e][0] == t ? cells[e][1] : cells[e][0]; }

  /// -1 when there is no such edge.
  Index find(const Edge& edge) const {
    const Edge sorted = {std::min(edge[0], edge[1]), std::max(edge[0], edge[1])};
    const auto found = std::lower_bound(vertices.begin(), vertices.end(), sorted);
    return found != vertices.end() && *found == sorted ? static_cast<Index>(found - vertices.begin()) : -1;
  }
};

int corner_of(const IndexMatrix& triangles, Index t, Index v) {
  return triangles(t, 0) == v ? 0 : triangles(t, 1) == v ? 1 : 2;
}

/// The fan of each corner (cells x 3): corners at one vertex are in one fan when their cells are connected across
/// interior edges at that vertex that are not cut. Fans are numbered in the order of their first corners.
struct Fans {
  IndexMatrix of_corner;
  std::vector<Index> vertex;  ///< of each fan

  Fans(const IndexMatrix& triangles, const EdgeTable& edges, const std::vector<bool>& is_cut)
      : of_corner(triangles.rows(), 3) {
    boost::disjoint_sets_with_storage<> sets(static_cast<std::size_t>(triangles.size()));
    const auto corner = [&](Index t, Index v) { return 3 * t + corner_of(triangles, t, v); };
    for (Index e = 0; e < edges.count(); ++e) {
      if (edges.is_boundary(e) || is_cut[e]) continue;
      const auto [s, t] = edges.cells[e];
      for (const Index v : edges.vertices[e]) sets.union_set(corner(s, v), corner(t, v));
    }
    std::vector<Index> number(static_cast<std::size_t>(triangles.size()), -1);
    for (Index c = 0; c < triangles.size(); ++c) {
      Index& fan = number[sets.find_set(c)];
      if (fan < 0) {
        fan = static_cast<Index>(vertex.size());
        vertex.push_back(triangles(c / 3, c % 3));
      }
      of_corner(c / 3, c % 3) = fan;
    }
  }

  Fans(const IndexMatrix& triangles, const EdgeTable& edges)
      : Fans(triangles, edges, std::vector<bool>(edges.vertices.size(), false)) {}
};

/// A side of a triangle: the edge from corner i to corner i + 1 of cell t.
struct Side {
  Index t;
  int i;
};

std::vector<std::vector<Side>> boundary_walks(const IndexMatrix& triangles, const EdgeTable& edges) {
  std::vector<std::pair<Index, Side>> starts;
  for (Index e = 0; e < edges.count(); ++e) {
    if (!edges.is_boundary(e)) continue;
    const Index t = edges.cells[e][0];
    for (int i = 0; i < 3; ++i) {
      if (edges.of_cell(t, i) == e) starts.push_back({triangles(t, i), {t, i}});
    }
  }
  std::sort(starts.begin(), starts.end(),
            [](const auto& a, const auto& b) { return std::tie(a.first, a.second.t) < std::tie(b.first, b.second.t); });

  std::vector<std::vector<Side>> walks;
  std::vector<bool> visited(edges.vertices.size(), false);
  for (const auto& [vertex, start] : starts) {
    if (visited[edges.of_cell(start.t, start.i)]) continue;
    auto& walk = walks.emplace_back();
    for (Side side = start; !visited[edges.of_cell(side.t, side.i)];) {
      visited[edges.of_cell(side.t, side.i)] = true;
      walk.push_back(side);
      // Turn around the end of this side, from cell to cell, to the boundary on the other side of the fan.
      const Index pivot = triangles(side.t, (side.i + 1) % 3);
      side.i = (side.i + 1) % 3;
      for (Index e = edges.of_cell(side.t, side.i); !edges.is_boundary(e); e = edges.of_cell(side.t, side.i)) {
        side.t = edges.other_cell(e, side.t);
        side.i = corner_of(triangles, side.t, pivot);
      }
    }
  }
  return walks;
}

void set_derived(Topology& topology, Index fans) {
  topology.euler_characteristic = topology.vertices - topology.edges + topology.cells;
  const Index split = fans - topology.edges + topology.cells;
  topology.genus = topology.components - (split + topology.boundary_loops) / 2;
}

/// Lengths of shortest paths from the closest of some vertices, and the vertex before each one on its path: itself for
/// a start and where no path leads.
struct ShortestPaths {
  std::vector<double> distance;
  std::vector<Index> previous;

  ShortestPaths(Index vertex_count, const EdgeTable& edges, const std::vector<double>& lengths,
                const std::vector<Index>& starts) {
    const Index source = vertex_count;  // one more vertex, at no distance from all starts
    WeightedGraph graph(static_cast<std::size_t>(vertex_count) + 1);
    for (Index e = 0; e < edges.count(); ++e) add_edge(edges.vertices[e][0], edges.vertices[e][1], lengths[e], graph);
    for (const Index v : starts) add_edge(source, v, 0.0, graph);
    distance.resize(num_vertices(graph));
    std::vector<WeightedGraph::vertex_descriptor> before(num_vertices(graph));
    dijkstra_shortest_paths(graph, source, boost::predecessor_map(before.data()).distance_map(distance.data()));
    for (Index v = 0; v < vertex_count; ++v) {
      const auto p = static_cast<Index>(before[v]);
      previous.push_back(p == source ? v : p);
    }
    distance.resize(vertex_count);
  }

  std::vector<Index> path_to(Index v) const {
    std::vector<Index> path = {v};
    for (; previous[v] != v; v = previous[v]) path.push_back(previous[v]);
    std::reverse(path.begin(), path.end());
    return path;
  }
};

std::vector<double> edge_lengths(const Domain& domain, const EdgeTable& edges) {
  std::vector<double> lengths;
  lengths.reserve(edges.vertices.size());
  for (const auto& [a, b] : edges.vertices) {
    lengths.push_back((domain.positions().row(a) - domain.positions().row(b)).norm());
  }
  return lengths;
}

/// The edges that a spanning forest of the cells crosses. Long loops, which an edge closes with the paths to its two
/// ends, are crossed first; edges of the paths themselves last.
std::vector<bool> crossed_edges(const Domain& domain, const EdgeTable& edges, const std::vector<double>& lengths,
                                const ShortestPaths& paths) {
  struct Candidate {
    bool on_path;
    double loop;
    Index edge;
  };
  std::vector<Candidate> candidates;
  for (Index e = 0; e < edges.count(); ++e) {
    if (edges.is_boundary(e)) continue;
    const auto [a, b] = edges.vertices[e];
    candidates.push_back(
        {paths.previous[a] == b || paths.previous[b] == a, paths.distance[a] + paths.distance[b] + lengths[e], e});
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return std::tuple(a.on_path, -a.loop, a.edge) < std::tuple(b.on_path, -b.loop, b.edge);
  });
  RankedGraph dual(static_cast<std::size_t>(domain.cell_count()));
  for (std::size_t rank = 0; rank < candidates.size(); ++rank) {
    const auto [s, t] = edges.cells[candidates[rank].edge];
    add_edge(s, t, static_cast<Index>(rank), dual);
  }
  std::vector<RankedGraph::edge_descriptor> tree;
  kruskal_minimum_spanning_tree(dual, std::back_inserter(tree));
  std::vector<bool> crossed(edges.vertices.size(), false);
  for (const auto& link : tree) crossed[candidates[get(boost::edge_weight, dual, link)].edge] = true;
  return crossed;
}

/// Takes out of a set of edges, which the boundary belongs to, what ends in a vertex of no other edge of the set.
void prune(std::vector<bool>& kept, Index vertex_count, const EdgeTable& edges) {
  std::vector<std::vector<Index>> around(vertex_count);
  std::vector<Index> degree(vertex_count, 0);
  for (Index e = 0; e < edges.count(); ++e) {
    if (!kept[e]) continue;
    for (const Index v : edges.vertices[e]) {
      around[v].push_back(e);
      ++degree[v];
    }
  }
  for (Index first = 0; first < vertex_count; ++first) {
    for (Index v = first; degree[v] == 1;) {
      const Index e = *std::find_if(around[v].begin(), around[v].end(), [&](Index k) { return kept[k]; });
      kept[e] = false;
      --degree[v];
      v = edges.vertices[e][0] == v ? edges.vertices[e][1] : edges.vertices[e][0];
      --degree[v];
    }
  }
}

}  // namespace

Topology topology(const Domain& domain) {
  const EdgeTable edges(domain.cells());
  const Fans fans(domain.cells(), edges);
  Topology whole;
  whole.vertices = domain.vertex_count();
  whole.edges = edges.count();
  whole.cells = domain.cell_count();
  whole.components = domain.component_count();
  whole.boundary_loops = static_cast<Index>(boundary_walks(domain.cells(), edges).size());
  std::vector<Index> fans_at(whole.vertices, 0);
  for (const Index v : fans.vertex) {
    if (++fans_at[v] == 2) ++whole.singular_vertices;
  }
  set_derived(whole, static_cast<Index>(fans.vertex.size()));
  return whole;
}

std::vector<Topology> component_topologies(const Domain& domain) {
  const EdgeTable edges(domain.cells());
  const Fans fans(domain.cells(), edges);
  const IndexVector& component = domain.cell_components();
  std::vector<Topology> parts(domain.component_count());
  for (Topology& part : parts) part.components = 1;
  for (Index t = 0; t < domain.cell_count(); ++t) ++parts[component(t)].cells;
  for (const Edge& cells : edges.cells) ++parts[component(cells[0])].edges;
  for (const auto& walk : boundary_walks(domain.cells(), edges)) ++parts[component(walk[0].t)].boundary_loops;

  std::vector<Index> component_of_fan(fans.vertex.size());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (const Index fan : fans.of_corner.row(t)) component_of_fan[fan] = component(t);
  }
  std::vector<std::pair<Index, Index>> places;  // (component, vertex) of each fan
  std::vector<Index> fan_count(parts.size(), 0);
  for (std::size_t fan = 0; fan < fans.vertex.size(); ++fan) {
    places.emplace_back(component_of_fan[fan], fans.vertex[fan]);
    ++fan_count[component_of_fan[fan]];
  }
  std::sort(places.begin(), places.end());
  for (std::size_t k = 0; k < places.size(); ++k) {
    const bool is_first = k == 0 || places[k] != places[k - 1];
    const bool is_second = !is_first && (k == 1 || places[k] != places[k - 2]);
    if (is_first) ++parts[places[k].first].vertices;
    if (is_second) ++parts[places[k].first].singular_vertices;
  }
  for (std::size_t k = 0; k < parts.size(); ++k) set_derived(parts[k], fan_count[k]);
  return parts;
}

std::vector<std::vector<Index>> boundary_loops(const Domain& domain) {
  const EdgeTable edges(domain.cells());
  std::vector<std::vector<Index>> loops;
  for (const auto& walk : boundary_walks(domain.cells(), edges)) {
    auto& loop = loops.emplace_back();
    for (const Side& side : walk) loop.push_back(domain.cells()(side.t, side.i));
  }
  return loops;
}

std::vector<Index> shortest_edge_path(const Domain& domain, Index from, Index to) {
  const EdgeTable edges(domain.cells());
  for (const Index v : {from, to}) {
    if (v < 0 || v >= domain.vertex_count()) {
      throw DataError(
          fmt::format("vertex {} does not exist; the mesh has vertices 0 to {}", v, domain.vertex_count() - 1));
    }
  }
  const ShortestPaths paths(domain.vertex_count(), edges, edge_lengths(domain, edges), {from});
  std::vector<Index> path = paths.path_to(to);
  if (path.front() != from) throw DataError(fmt::format("no path of edges joins vertices {} and {}", from, to));
  return path;
}

std::vector<Edge> cut_graph(const Domain& domain) {
  const EdgeTable edges(domain.cells());
  const Fans fans(domain.cells(), edges);
  const Index vertex_count = domain.vertex_count();
  std::vector<Index> component(vertex_count, -1);
  std::vector<bool> seen(vertex_count, false);
  for (const Index v : fans.vertex) {
    if (seen[v]) {
      throw DataError(
          fmt::format("vertex {} joins several fans of cells; expected a mesh that does not touch itself, "
                      "to cut it open to a disk",
                      v));
    }
    seen[v] = true;
  }
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (const Index v : domain.cells().row(t)) component[v] = domain.cell_components()(t);
  }

  // One start per component: the lowest vertex of its boundary if it has one, and going along the boundary is free.
  const std::vector<bool>& on_boundary = domain.boundary_vertices();
  std::vector<Index> starts(domain.component_count(), -1);
  for (Index v = 0; v < vertex_count; ++v) {
    Index& start = starts[component[v]];
    if (start < 0 || (on_boundary[v] && !on_boundary[start])) start = v;
  }
  const std::vector<double> lengths = edge_lengths(domain, edges);
  std::vector<double> costs = lengths;
  for (Index e = 0; e < edges.count(); ++e) {
    if (edges.is_boundary(e)) costs[e] = 0.0;
  }
  const ShortestPaths paths(vertex_count, edges, costs, starts);

  std::vector<bool> cut = crossed_edges(domain, edges, costs, paths);
  cut.flip();
  prune(cut, vertex_count, edges);

  // What is left of a sphere is a single vertex.
  std::vector<bool> is_sphere(starts.size(), true);
  for (Index e = 0; e < edges.count(); ++e) {
    if (cut[e]) is_sphere[component[edges.vertices[e][0]]] = false;
  }
  if (std::find(is_sphere.begin(), is_sphere.end(), true) != is_sphere.end()) {
    const auto farthest = [&](const ShortestPaths& from) {
      std::vector<Index> ends = starts;
      for (Index v = 0; v < vertex_count; ++v) {
        Index& end = ends[component[v]];
        if (from.distance[v] > from.distance[end]) end = v;
      }
      return ends;
    };
    const ShortestPaths across(vertex_count, edges, lengths, farthest(paths));
    const std::vector<Index> ends = farthest(across);
    for (std::size_t c = 0; c < ends.size(); ++c) {
      if (!is_sphere[c]) continue;
      std::vector<Index> path = across.path_to(ends[c]);
      if (path.size() == 2) {
        // A single edge does not open; go round a triangle.
        const Index t = edges.cells[edges.find({path[0], path[1]})][0];
        const auto corners = domain.cells().row(t);
        path.insert(path.begin() + 1, corners.sum() - path[0] - path[1]);
      }
      for (std::size_t k = 1; k < path.size(); ++k) cut[edges.find({path[k - 1], path[k]})] = true;
    }
  }

  std::vector<Edge> result;
  for (Index e = 0; e < edges.count(); ++e) {
    if (cut[e] && !edges.is_boundary(e)) result.push_back(edges.vertices[e]);
  }
  return result;
}

CutMesh cut_along_edges(const Mesh& mesh, const std::vector<Edge>& cuts) {
  const EdgeTable edges(mesh.cells);
  std::vector<bool> is_cut(edges.vertices.size(), false);
  std::vector<bool> is_end(mesh.vertex_count(), false);
  for (const Edge& cut : cuts) {
    const Index e = edges.find(cut);
    if (e < 0) throw DataError(fmt::format("{} is not in the mesh", name_of(cut)));
    if (edges.is_branch[e]) throw DataError(fmt::format("{} has more than two cells", name_of(cut)));
    if (edges.is_boundary(e)) {
      throw DataError(fmt::format("{} is on the boundary; expected an interior edge to cut", name_of(cut)));
    }
    is_cut[e] = true;
    for (const Index v : cut) is_end[v] = true;
  }

  const Fans fans(mesh.cells, edges, is_cut);
  CutMesh result{mesh, std::vector<Index>(mesh.vertex_count())};
  std::iota(result.vertex_origin.begin(), result.vertex_origin.end(), 0);
  std::vector<std::pair<Index, Index>> places;  // (vertex, fan) where vertices may be copied
  for (std::size_t fan = 0; fan < fans.vertex.size(); ++fan) {
    if (is_end[fans.vertex[fan]]) places.emplace_back(fans.vertex[fan], static_cast<Index>(fan));
  }
  std::sort(places.begin(), places.end());
  std::vector<Index> number = fans.vertex;
  for (std::size_t k = 1; k < places.size(); ++k) {
    const auto [v, fan] = places[k];
    if (places[k - 1].first != v) continue;
    number[fan] = static_cast<Index>(result.vertex_origin.size());
    result.vertex_origin.push_back(v);
  }
  result.mesh.cells = fans.of_corner.unaryExpr([&](Index fan) { return number[fan]; });
  result.mesh.positions = mesh.positions(result.vertex_origin, Eigen::all);

  const auto same_on_both_sides = [&](Index e, Index v) {
    const auto [s, t] = edges.cells[e];
    return result.mesh.cells(s, corner_of(mesh.cells, s, v)) == result.mesh.cells(t, corner_of(mesh.cells, t, v));
  };
  for (const Edge& cut : cuts) {
    const Index e = edges.find(cut);
    if (same_on_both_sides(e, cut[0]) && same_on_both_sides(e, cut[1])) {
      throw DataError(fmt::format("{} cannot be opened alone; expected that it meets the boundary or another cut edge",
                                  name_of(cut)));
    }
  }
  return result;
}

}  // namespace variform
