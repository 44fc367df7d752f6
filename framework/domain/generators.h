// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

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
/// Interior vertices move by up to `jitter` of a grid cell, in [0, 0.45]; by less where a cell would turn over.
Mesh bar_tet_mesh(double length, double width, double height, double h, double jitter = 0.0, std::uint64_t seed = 1);

/// The sheet (x, y, height exp(-sharpness |(x, y) - centre|^2)) over a rectangle, which gives h, tessellation and
/// jitter; seen from above its triangles are counter-clockwise. A negative height makes a dent.
struct BumpOptions {
  RectangleOptions base = {};
  double height = 0.3;
  double sharpness = 20.0;
  Eigen::Vector2d centre = {0.5, 0.5};
};
Mesh bump_mesh(const BumpOptions& options);

/// The rectangle [0, pi radius] x [0, length], of which h, tessellation, jitter, grading and seed are taken from
/// `sheet`, bent without stretch over the upper half of the cylinder of this radius about the y axis, from x = -radius
/// to x = radius. Open, outward normals.
Mesh half_cylinder_mesh(double radius, double length, const RectangleOptions& sheet);

/// Geodesic sphere about the origin: an icosahedron, every face of which is cut into n^2 triangles, put on the sphere.
/// n is such that the edges of the icosahedron, as arcs, get steps of about h, which is at most the radius times the
/// arc, 1.107. 10 n^2 + 2 vertices, of which the first 12 are those of the icosahedron; 20 n^2 cells; outward normals.
Mesh sphere_mesh(double radius, double h);

/// Torus about the z axis, closed, outward normals: circles of the minor radius around the circle of the major one,
/// which is larger. A structured grid with steps of about h, at least 3 in each direction, where it is widest.
Mesh torus_mesh(double major_radius, double minor_radius, double h);

/// The unit square with three swellings: balls of radius 0.14 that reach up to z = 0.35 and hang over a narrower neck,
/// which a fillet joins to the sheet without a crease. A disk whose parametrization is hard: around the neck, 0.54
/// long, there is 10 times the area of the circle of that length. (In the spirit of the model "3-balls" of Martinez
/// Esturo 2013, Figure 53, of which no data is published.) The sheet is a rectangle with the h, tessellation, jitter
/// and seed of `sheet` (h at most 0.1); on the swellings edges are up to 2.5 times as long. Upward and outward normals.
Mesh three_balls_mesh(const RectangleOptions& sheet);

/// A sheet that is curved like the hood of a car (in the spirit of the beetle's in Martinez Esturo 2013, Figures 50 and
/// 51, of which no data is published): the image of u in [-1, 1], v in [0, 1] under
///   x = 0.6 u (1 - 0.3 v^2),  y = v,  z = 0.3 - 0.06 u^2 - 0.08 v^2 - 0.12 u^8 - 0.12 v^8,
/// gently curved in both directions, narrower to the front (v = 1), with a rim that bends down at the sides and the
/// front, and open at the rear. The grid of (0.6 u, v) has the h, tessellation, jitter and seed of `sheet`. Upward
/// normals.
Mesh hood_mesh(const RectangleOptions& sheet);

/// Open tube about the z axis, from z = 0 to `length`: around x along quads, each cut into two triangles, outward
/// normals. Vertex i of ring k has the number k around + i.
struct TubeOptions {
  double radius = 0.5;
  double length = 4.0;
  int around = 24;
  int along = 48;
  bool alternating = true;  ///< union-jack diagonals; else all the same way
};
Mesh tube_mesh(const TubeOptions& options);

/// Closed square tube about the z axis, from z = 0 to `length`: `along` x `across` quads on each of its four sides and
/// across x across on both caps, outward normals.
struct SquareTubeOptions {
  double length = 4.0;
  double width = 0.8;
  int along = 40;
  int across = 6;
  bool alternating = true;
};
Mesh square_tube_mesh(const SquareTubeOptions& options);

/// A rectangle with bumps x bumps half ellipsoids, one in the middle of each of as many parts: z = height sqrt(1 - (r /
/// radius)^2) within `radius` of their centres. Upward normals.
struct BumpArrayOptions {
  RectangleOptions base = {};
  int bumps = 5;
  double radius = 0.07;
  double height = 0.07;
};
Mesh bump_array_mesh(const BumpArrayOptions& options);

/// The graph of (1 - x^2) (1 - y^2) / 2 over [-1, 1]^2, tessellated as `sheet` says. Upward normals.
Mesh pillow_mesh(const RectangleOptions& sheet);

/// Tetrahedra in a body [-0.4, 0.4] x [-1, 1] x [-0.3, 0.3] with two thin wings, |x| <= 2, |y| <= 0.3, |z| <= 0.1: Kuhn
/// subdivision of a grid with steps of about h, at most 0.4, mirror symmetric about x = 0 with all its cells. Positive.
Mesh wing_tet_mesh(double h);

/// Surface of the box [0, 2] x [0, 1] x [0, 1/2] with a hood that is raised by up to 0.2 over the front half: z grows
/// by 2 z 0.2 sin^2(pi (x - 1)) sin^2(pi y) for x > 1. Closed, outward normals.
Mesh box_car_mesh(double h);

/// Surface of a cactus, closed, outward normals: a trunk of radius 0.12 along the z axis from z = 0 to 1.12 and two
/// arms of radius 0.07 (x > 0) and 0.06 (x < 0) that leave it sideways and bend upwards, with rounded corners between
/// them. Vertices lie on the surface, edges are about h long, at most 0.04.
Mesh cactus_surface_mesh(double h);
/// The part of that cactus that a point belongs to: 0 the trunk, 1 the arm with x > 0, 2 the other one.
int cactus_surface_part(const Eigen::Vector3d& point);

/// Sphere about the origin in meridians and parallels (rings between the poles): meridians parallels + 2 vertices,
/// closed, outward normals.
Mesh lattice_sphere_mesh(double radius, int meridians, int parallels);

/// Convex hull of random points on a sphere about the origin, closed, outward normals. In every round the points move
/// to the directions of the means of their neighbours: none gives very bad triangles, some make them even.
struct RandomSphereOptions {
  double radius = 1.0;
  int points = 642;
  int rounds = 1;
  std::uint64_t seed = 1;
};
Mesh random_sphere_mesh(const RandomSphereOptions& options);

/// Names of the planar silhouettes with thin limbs: "figure" (a person with thin arms and legs), "giraffe" (long neck,
/// thin legs, tail), "frog" (splayed thin legs), "cactus" (branching).
const std::vector<std::string>& silhouette_names();

/// Planar silhouette, about 1 unit across, meshed with edge length about h (inner triangles equilateral, vertices of
/// the outline on it, all angles above 15 degrees). Connected, without holes. Throws UsageError for unknown names and
/// for h too coarse to resolve the limbs: half the width of the thinnest one is the most, about 0.02. With `symmetric`
/// the cells are mirror symmetric about x = 0, too, as the shapes of figure and frog are; an error for the others.
Mesh silhouette_mesh(const std::string& name, double h, bool symmetric = false);

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
