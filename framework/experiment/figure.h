// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/mesh.h"
#include "framework/experiment/raster.h"

namespace variform {

/// Colour scale of a figure: values are mapped to [0, 1] between low and high, on a logarithmic scale if asked for.
struct ColourScale {
  double low = 0.0;
  double high = 1.0;
  bool logarithmic = false;
  std::string label = {};  ///< of the colour bar
};

/// Scale from the smallest (or 0) to the largest finite value of several fields, so that figures can be compared.
/// Logarithmic ones start at the smallest positive value, no more than 6 decades below the largest.
ColourScale common_scale(const std::vector<Vector>& fields, bool logarithmic, const std::string& label);

/// One mesh with coloured cells: planar, a surface in space, or the boundary of tetrahedra.
struct MeshFigure {
  std::string name = {};  ///< what it shows ("deformed", "uv", ...): a study has one picture for each name
  std::string title = {};
  std::string caption = {};  ///< of the picture; the runner has one for figures without
  Mesh mesh = {};            ///< planar: positions x 2; in space: positions x 3; tetrahedra show their boundary
  Vector cell_values = {};   ///< colours; empty: plain cells
  ColourScale scale = {};
  /// Texture coordinates, any count x 2: triangles then show a checkerboard instead of cell values.
  Matrix uv = {};
  IndexMatrix uv_cells = {};  ///< rows of uv, cells x 3; empty: uv has a row for each vertex
  double check_size = 0.0;    ///< side of a square of the checkerboard, in units of uv; 0: 1/24 of the largest extent
                              ///< of the uv of all figures in the picture
  std::vector<Index> fixed_vertices = {};  ///< drawn as filled squares: hard constraints that did not move
  std::vector<Index> moved_vertices = {};  ///< drawn as filled circles: hard constraints that moved
  std::vector<Index> soft_vertices = {};   ///< drawn as open circles
  std::vector<Index> flipped_cells = {};   ///< outlined in red
  bool edges = true;                       ///< draw edges of cells

  bool is_spatial() const { return mesh.positions.cols() == 3; }
};

/// Draws figures side by side in a grid (columns per row; 0: a page's shape) with one colour bar for all, titles
/// above each, and writes PATH.svg and PATH.png (path without extension). All panels share one length scale, those in
/// space the camera, and the colour scale of the first figure with values. Undefined values are grey; cells with
/// undefined positions are left out. Figures in space and checkerboards are shaded by a z-buffer (see Raster) and stand
/// in the SVG as images; their markers are hidden where something is in front. Throws DataError when a file cannot be
/// written, UsageError for figures that do not fit together (counts, indices) and impossible cameras.
void draw_meshes(const std::vector<MeshFigure>& figures, const std::filesystem::path& path, int columns = 0,
                 const Camera& camera = {});

/// Draws the states of one moving mesh, frames[i] into files[i] (.png), so that they can be played: the view, the
/// length scale and the place in the picture are those of the box around all of them, and pictures are at most 640
/// pixels wide. Colours are on the scale of each figure, so give all the same. Throws as draw_meshes does.
void draw_frames(const std::vector<MeshFigure>& frames, const std::vector<std::filesystem::path>& files,
                 const Camera& camera = {});

/// One curve of a line plot. NaN breaks the curve.
struct Curve {
  std::string label = {};
  std::vector<double> x = {};
  std::vector<double> y = {};
};

struct LinePlot {
  std::string title = {};
  std::string x_label = {};
  std::string y_label = {};
  bool log_x = false;
  bool log_y = false;
  std::vector<Curve> curves = {};
  std::vector<double> marks = {};  ///< vertical lines at these x, where they lie in the range of the curves
};

/// Draws by gnuplot: writes PATH.svg, PATH.png and PATH.gp (the script with its data inline, to be edited by hand).
/// Returns a sentence that says why there is no picture when gnuplot is not installed or fails or nothing can be drawn
/// (the .gp is written all the same).
/// Non-positive values are left out on logarithmic axes. Throws DataError when a file cannot be written.
std::optional<std::string> draw_plot(const LinePlot& plot, const std::filesystem::path& path);

/// Colour of a value in [0, 1], as "#rrggbb": perceptually uniform, dark to light, readable in grey and by the
/// colour-blind.
std::string colour_of(double value);

/// Colour of a value on a scale, red, green, blue in [0, 1]; grey for NaN.
Rgb colour_on(const ColourScale& scale, double value);

/// Colour of cells without values.
Rgb plain_colour();

/// Side of the squares of the checkerboard for figures that leave it open: 1/24 of the largest extent of their uv.
double common_check_size(const std::vector<MeshFigure>& figures);

}  // namespace variform
