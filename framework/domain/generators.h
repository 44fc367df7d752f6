// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "framework/domain/mesh.h"

namespace variform {

/// How a generated planar mesh is tessellated (Martinez Esturo 2013, Figure 55: the same shape, differently cut).
enum class Tessellation {
  regular,      ///< all diagonals the same way
  alternating,  ///< union-jack diagonals
  random,       ///< diagonal of every quad by coin flip
  graded,       ///< as regular, with columns growing along x and rows along y from the corner at the origin: each is
                ///< `grading` times as wide as the one before
};

struct RectangleOptions {
  double width = 1.0;
  double height = 1.0;
  double h = 1.0 / 32.0;  ///< target edge length of a grid cell; counts are round(width/h), at least 1
  Tessellation tessellation = Tessellation::random;
  double jitter = 0.0;    ///< interior vertices move by up to this fraction of the smaller neighbouring column and row,
                          ///< in [0, 0.45]; by less where a cell would turn over
  double grading = 1.16;  ///< only for graded; at least 1, and the widest column at most 1e5 times the narrowest one
  std::uint64_t seed = 1;
};

// All generators make at most 50 million cells, and the same mesh for the same arguments (random choices are drawn from
// `seed` alone). They throw UsageError naming the argument that is out of range: lengths must be positive, h at most
// the size of the shape.

/// [0,width] x [0,height], triangles, counter-clockwise.
Mesh rectangle_mesh(const RectangleOptions& options);

/// Disk of the given radius about the origin, concentric rings of nearly equilateral triangles of edge length about h,
/// which is at most the radius.
Mesh disk_mesh(double radius, double h);

/// Ring between two radii about the origin; a structured grid with edge length about h, which is at most the difference
/// of the radii.
Mesh annulus_mesh(double inner_radius, double outer_radius, double h);

/// Surface of the box [0,length] x [0,width] x [0,height], closed, outward normals.
Mesh bar_surface_mesh(double length, double width, double height, double h);

/// The same box filled with tetrahedra (Kuhn subdivision of a grid), all positive. Its boundary is bar_surface_mesh.
Mesh bar_tet_mesh(double length, double width, double height, double h);

/// Names of the planar silhouettes with thin limbs: "figure" (a person with thin arms and legs), "giraffe" (long neck,
/// thin legs, tail), "frog" (splayed thin legs), "cactus" (branching).
const std::vector<std::string>& silhouette_names();

/// Planar silhouette, about 1 unit across, meshed with edge length about h (inner triangles equilateral, vertices of
/// the outline on it, all angles above 15 degrees). Connected, without holes. Throws UsageError for unknown names and
/// for h too coarse to resolve the limbs: half the width of the thinnest one is the most, about 0.02.
Mesh silhouette_mesh(const std::string& name, double h);

/// Options of degrade_mesh: any combination.
struct DegradeOptions {
  double jitter = 0.0;         ///< interior vertices move by up to this fraction of their shortest edge, orientation
                               ///< kept; in [0, 1]
  double flip_fraction = 0.0;  ///< share of interior edges flipped at random where the quad is strictly convex, in
                               ///< [0, 1]; first after the jitter, then again after each round of refinement
  int refinements = 0;  ///< rounds of splitting a random fifth of the cells at their centroid: needles and a large
                        ///< ratio of areas; in [0, 20]
  std::uint64_t seed = 1;
};

/// A badly tessellated variant of a planar mesh: same outline, same shape, valid and positively oriented, worse cells.
/// The first vertices are those of the input (interior ones possibly moved by jitter). Flips and refinements make no
/// cell smaller than 1e-5 of the mean of the input or lower than 1/200 of its longest edge; with both, some 2000 cells
/// and three refinements the ratio of areas exceeds 1000 (Martinez Esturo 2013, Figure 55, reaches 1.7e3). Throws
/// UsageError unless the mesh is made of planar triangles, DataError when they are not all counter-clockwise.
Mesh degrade_mesh(const Mesh& mesh, const DegradeOptions& options);

}  // namespace variform
