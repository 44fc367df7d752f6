// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/mesh.h"

namespace variform {

/// From where a picture of an object in space is taken.
struct Camera {
  Eigen::Vector3d direction = {1.0, -2.0, 1.2};  ///< from the object to the eye; any length but 0
  Eigen::Vector3d up = {0.0, 0.0, 1.0};          ///< points upwards in the picture; not along direction
  double zoom = 1.0;                             ///< > 0; above 1 the rim of the object is cut off
  bool perspective = false;                      ///< else orthographic
};

/// Maps space to a picture: x to the right, y upwards, the third coordinate (depth) grows towards the eye. The map is
/// projective, so planes stay planes and depth is linear in the picture, as a z-buffer wants it.
class View {
 public:
  /// centre: the point that is mapped to 0 and around which lengths are kept. eye_distance: from the eye to the centre,
  /// for perspective; points at or behind the eye are mapped to NaN. Throws UsageError for directions that are no
  /// directions.
  View(const Camera& camera, const Eigen::Vector3d& centre, double eye_distance);

  Eigen::Vector3d operator()(const Eigen::Vector3d& point) const;
  /// A direction without perspective: for normals.
  Eigen::Vector3d turned(const Eigen::Vector3d& direction) const { return axes_ * direction; }
  /// How much larger than at the centre things appear at a depth: 1 for orthographic views.
  double magnification(double depth) const { return 1.0 + depth * inverse_distance_; }

 private:
  Eigen::Matrix3d axes_;  ///< rows: right, up, towards the eye
  Eigen::Vector3d centre_;
  double inverse_distance_ = 0.0;  ///< 0: orthographic
};

/// Red, green, blue in [0, 1].
using Rgb = Eigen::Vector3f;

/// The triangles that are seen of a mesh: its cells, or the boundary of tetrahedra.
struct Surface {
  IndexMatrix triangles;     ///< triangles x 3, vertices
  std::vector<Index> cells;  ///< the cell that each belongs to
};

/// Cells with vertices whose coordinates are not finite are left out, and so do not hide others. A face of tetrahedra
/// is on the boundary if exactly one cell has it. Order follows the cells.
Surface surface_of(const Mesh& mesh);

/// Unit normals of the corners of triangles (3 rows per triangle): averages, by area, over the triangles at the vertex
/// whose normal deviates by less than 40 degrees, so that round things look round and edges of boxes sharp. Neighbours
/// of opposite orientation count with their normal reversed. 0 where a triangle has no area.
Matrix corner_normals(const Matrix& positions, const IndexMatrix& triangles);

/// What is rasterized: a triangle in picture coordinates.
struct RasterTriangle {
  std::array<Eigen::Vector3d, 3> corners;     ///< x right, y down, in pixels; depth towards the eye, any unit
  std::array<Eigen::Vector3d, 3> normals;     ///< in the view's axes; 0: of the triangle itself, up to the eye
  std::array<Eigen::Vector2d, 3> uv = {};     ///< texture coordinates, if textured; the checkerboard has unit squares
  std::array<double, 3> weights = {1, 1, 1};  ///< magnification of the corners: attributes are interpolated with it
  Rgb colour = Rgb::Ones();
  bool is_textured = false;  ///< checkerboard instead of the colour
  Rgb edge_colour = Rgb::Zero();
  float edge_opacity = 0.0f;
  double edge_width = 0.0;  ///< in pixels, of the half inside this triangle; 0: none
  bool is_lit = true;       ///< else the colour as it is
};

/// Pixels of a picture with depths, drawn by a z-buffer on a grid of samples x samples points per pixel. The same
/// triangles in the same order give the same bytes; where two lie at the same depth, the first stays.
class Raster {
 public:
  /// Throws UsageError unless width, height (pixels) and samples (per side of a pixel) are positive.
  Raster(int width, int height, int samples = 3);

  /// Shading is Lambert's for both sides with a lamp beside the eye, ambient light and a faint highlight. Triangles
  /// with corners that are not finite are left out.
  void draw(const RasterTriangle& triangle);

  int width() const { return width_; }
  int height() const { return height_; }
  /// Premultiplied alpha in the highest byte, then red, green, blue; row by row from above.
  std::vector<std::uint32_t> pixels() const;
  /// Whether a point (pixels, depth) is in front of what is drawn there, or no deeper behind it than the slack; a
  /// sample nearby is enough, so that a vertex of a drawn triangle is not hidden by it.
  bool is_visible(const Eigen::Vector3d& point, double slack) const;

 private:
  int width_;
  int height_;
  int samples_;
  std::vector<float> depths_;          ///< of samples
  std::vector<std::uint32_t> shades_;  ///< of samples: 0 where nothing is
};

/// The tones of the checkerboard.
extern const std::array<Rgb, 2> kCheckColours;

}  // namespace variform
