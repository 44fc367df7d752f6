// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "framework/domain/mesh.h"

/// What the generators share. Not part of the interface of the library.
namespace variform::generators {

/// Generators refuse to make more cells than this: their indices and the matrices made from them would not fit.
inline constexpr double kMaxCells = 50e6;

/// splitmix64: the same numbers on every platform, unlike the distributions of the standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t next() {
    state_ += 0x9e3779b97f4a7c15U;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31U);
  }

  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(next() >> 11U) * 0x1p-53; }
  /// Uniform in [-1, 1).
  double symmetric() { return 2.0 * uniform() - 1.0; }
  bool coin() { return (next() >> 63U) != 0; }
  /// Uniform in {0, ..., count - 1}.
  Index below(Index count) { return static_cast<Index>(uniform() * count); }

 private:
  std::uint64_t state_;
};

/// Throw UsageError naming the option unless it is a positive number, or in [min, max].
void require_positive(std::string_view option, double value);
void require_range(std::string_view option, double value, double min, double max);
/// Throws UsageError unless 0 < h <= extent, the size of the shape.
void require_h(double h, double extent);
/// Throws UsageError naming the option when a mesh would have more than kMaxCells cells.
void require_cell_count(std::string_view option, double value, double cells);

/// How many steps of about h make up a length, at least 1. A double, since it may be too large for an Index.
double steps(double length, double h);

/// Area of the triangle with these vertices, seen from above; negative when clockwise.
double signed_area(const Matrix& positions, Index a, Index b, Index c);
/// Signed area of every cell of a planar mesh.
Vector signed_areas(const Mesh& mesh);

/// Area of a triangle in the plane (the first two coordinates), or volume of a tetrahedron; negative when turned over.
double signed_measure(const Mesh& mesh, Index cell);

/// The cells around each vertex.
class VertexCells {
 public:
  explicit VertexCells(const Mesh& mesh);
  std::span<const Index> operator[](Index v) const {
    return std::span<const Index>(cells_).subspan(first_[v], first_[v + 1] - first_[v]);
  }

 private:
  std::vector<std::size_t> first_;
  std::vector<Index> cells_;
};

/// Moves every vertex of a planar or tetrahedral mesh at random, by up to reach(v, d) along axis d (2 or 3 columns);
/// vertices with zero reach stay. Moves that would turn a cell over or almost flatten it are shortened.
void jitter_vertices(Mesh& mesh, const Matrix& reach, Random& random);

}  // namespace variform::generators
