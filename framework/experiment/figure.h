// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/mesh.h"

namespace variform {

/// Colour scale of a figure: values are mapped to [0, 1] between low and high, on a logarithmic scale if asked for.
struct ColourScale {
  double low = 0.0;
  double high = 1.0;
  bool logarithmic = false;
  std::string label = {};  ///< of the colour bar
};

/// Scale from the smallest (or 0) to the largest finite value of several fields, so that figures can be compared.
/// Logarithmic ones start at the smallest positive value, no more than 12 decades below the largest.
ColourScale common_scale(const std::vector<Vector>& fields, bool logarithmic, const std::string& label);

/// One planar mesh with coloured cells.
struct MeshFigure {
  std::string title = {};
  Mesh mesh = {};           ///< planar: positions x 2 (a third column is ignored)
  Vector cell_values = {};  ///< colours; empty: plain cells
  ColourScale scale = {};
  std::vector<Index> fixed_vertices = {};  ///< drawn as filled squares: hard constraints that did not move
  std::vector<Index> moved_vertices = {};  ///< drawn as filled circles: hard constraints that moved
  std::vector<Index> soft_vertices = {};   ///< drawn as open circles
  std::vector<Index> flipped_cells = {};   ///< outlined in red
  bool edges = true;                       ///< draw edges of cells
};

/// Draws figures side by side in a grid (columns per row; 0: as square as possible) with one colour bar for all, titles
/// above each, and writes PATH.svg and PATH.png (path without extension). All panels share one length scale and the
/// colour scale of the first figure with values. Undefined values are grey; cells with undefined positions are left
/// out. Throws DataError when a file cannot be written, UsageError for figures that do not fit together (counts,
/// indices).
void draw_meshes(const std::vector<MeshFigure>& figures, const std::filesystem::path& path, int columns = 0);

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
};

/// Draws by gnuplot: writes PATH.svg, PATH.png and PATH.gp (the script with its data inline, to be edited by hand).
/// Returns a sentence that says why there is no picture when gnuplot is not installed or fails or nothing can be drawn
/// (the .gp is written all the same).
/// Non-positive values are left out on logarithmic axes. Throws DataError when a file cannot be written.
std::optional<std::string> draw_plot(const LinePlot& plot, const std::filesystem::path& path);

/// Colour of a value in [0, 1], as "#rrggbb": perceptually uniform, dark to light, readable in grey and by the
/// colour-blind.
std::string colour_of(double value);

}  // namespace variform
