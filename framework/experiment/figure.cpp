// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/figure.h"

#include <Eigen/Dense>
#include <cairo-svg.h>
#include <cairo.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <sstream>
#include <utility>

#include "framework/base/error.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/ticks.h"

namespace variform {
namespace {

// All lengths are in pixels of the SVG; the PNG has `resolution` times as many.
constexpr double kPngScale = 2.0;
constexpr double kMargin = 16.0;
constexpr double kGap = 24.0;
constexpr double kMaxContentWidth = 960.0;
constexpr double kMaxContentHeight = 4000.0;
constexpr double kMaxPanelWidth = 640.0;
constexpr double kMaxPanelHeight = 480.0;
constexpr double kMaxFrameWidth = 640.0;  // of the whole picture
constexpr double kMaxFrameHeight = 480.0;
constexpr double kMinColumnWidth = 140.0;  // titles need room
constexpr double kTitleSize = 13.0;
constexpr double kTitleLine = 17.0;
constexpr double kTitleGap = 7.0;
constexpr double kBarGap = 26.0;
constexpr double kBarWidth = 13.0;
constexpr double kMinBarHeight = 120.0;
constexpr double kMaxBarHeight = 300.0;
constexpr double kTickLength = 4.0;
constexpr double kTickSize = 11.0;
constexpr double kLabelSize = 12.0;
constexpr double kLabelGap = 10.0;

// Cells below this size have no edges: there would be nothing but edges.
constexpr double kMinCellSize = 2.0;

/// Squares of a checkerboard along the larger extent.
constexpr double kChecks = 24.0;

constexpr double kEdgeOpacity = 0.45;

/// Room around what is rasterized, for markers at the rim.
constexpr double kImageMargin = 4.0;

/// Extent that meshes of less are given, so that lengths in pixels stay finite.
constexpr double kMinExtent = 1e-100;

/// Cells are grouped by this many colours, one path each, to keep files small.
constexpr int kColourCount = 64;
constexpr int kUndefinedColour = kColourCount;
constexpr int kPlainColour = kColourCount + 1;

/// Logarithmic scales end here below the largest value: zeros up to rounding would stretch them beyond use.
constexpr double kMaxDecades = 6.0;

struct Colour {
  double red, green, blue;
};

constexpr Colour rgb(unsigned code) {
  return {(code >> 16 & 255u) / 255.0, (code >> 8 & 255u) / 255.0, (code & 255u) / 255.0};
}

constexpr Colour kInk = rgb(0x222222);
constexpr Colour kFlipped = rgb(0xe6001a);
constexpr Colour kUndefined = rgb(0xbdbdbd);
constexpr Colour kPlain = rgb(0xdfe6ee);

/// Equal steps of lightness from 0.27 to 0.92 in Oklab, from violet over blue and green to yellow.
constexpr std::array<unsigned, 16> kColourMap = {0x3b0452, 0x3f0775, 0x391e91, 0x2b3a9b, 0x0b50a2, 0x0f6599,
                                                 0x13769a, 0x17869c, 0x1b979e, 0x1fa79e, 0x23b999, 0x3fc98c,
                                                 0x6fd57b, 0x9cdf61, 0xcae737, 0xf8ea2f};

Colour mapped_colour(double value) {
  if (std::isnan(value)) return kUndefined;
  const double position = std::clamp(value, 0.0, 1.0) * (kColourMap.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(position), kColourMap.size() - 2);
  const double t = position - static_cast<double>(i);
  const Colour a = rgb(kColourMap[i]);
  const Colour b = rgb(kColourMap[i + 1]);
  return {std::lerp(a.red, b.red, t), std::lerp(a.green, b.green, t), std::lerp(a.blue, b.blue, t)};
}

/// Where a value is on a scale, 0 at its low end, 1 at its high end.
double position_on(const ColourScale& scale, double value) {
  if (std::isnan(value)) return value;
  if (value <= scale.low) return 0.0;
  if (value >= scale.high) return 1.0;
  return scale.logarithmic ? std::log(value / scale.low) / std::log(scale.high / scale.low)
                           : (value - scale.low) / (scale.high - scale.low);
}

using Point = Eigen::Vector2d;
using Box = Eigen::AlignedBox2d;

struct SurfaceDeleter {
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
struct ContextDeleter {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
};
struct PatternDeleter {
  void operator()(cairo_pattern_t* pattern) const { cairo_pattern_destroy(pattern); }
};
using Picture = std::unique_ptr<cairo_surface_t, SurfaceDeleter>;
using Pattern = std::unique_ptr<cairo_pattern_t, PatternDeleter>;

/// A Cairo context with what all drawing here needs.
class Canvas {
 public:
  explicit Canvas(cairo_surface_t* surface) : context_(cairo_create(surface)) {
    cairo_set_line_join(get(), CAIRO_LINE_JOIN_ROUND);
  }

  cairo_t* get() const { return context_.get(); }
  cairo_status_t status() const { return cairo_status(get()); }

  void set_colour(const Colour& colour, double alpha = 1.0) {
    cairo_set_source_rgba(get(), colour.red, colour.green, colour.blue, alpha);
  }

  void set_font(double size, bool is_bold = false) {
    cairo_select_font_face(get(), "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                           is_bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(get(), size);
  }

  double text_width(const std::string& text) {
    cairo_text_extents_t extents;
    cairo_text_extents(get(), text.c_str(), &extents);
    return extents.x_advance;
  }

  /// Text with its base line at y; align 0: starts at x, 0.5: centred, 1: ends at x.
  void draw_text(double x, double y, const std::string& text, double align) {
    cairo_move_to(get(), x - align * text_width(text), y);
    cairo_show_text(get(), text.c_str());
  }

  void stroke(double width) {
    cairo_set_line_width(get(), width);
    cairo_stroke(get());
  }

  /// Adds a closed triangle to the path, always with the same sense, so that overlapping ones do not cancel.
  void add_triangle(Point a, Point b, const Point& c) {
    const Point ab = b - a;
    const Point ac = c - a;
    if (ab.x() * ac.y() < ab.y() * ac.x()) std::swap(a, b);
    cairo_move_to(get(), a.x(), a.y());
    cairo_line_to(get(), b.x(), b.y());
    cairo_line_to(get(), c.x(), c.y());
    cairo_close_path(get());
  }

 private:
  std::unique_ptr<cairo_t, ContextDeleter> context_;
};

// ---------------------------------------------------------------------------------------------------------------------
// Layout

struct Panel {
  const MeshFigure* figure;
  double resolution = kPngScale;
  std::optional<View> view = {};        ///< for what is rasterized
  Surface surface = {};                 ///< the triangles that are drawn
  std::vector<Eigen::Vector3d> seen;    ///< vertices in the view, in units of the mesh; x and y of planar meshes
  Box bounds = {};                      ///< of them
  std::vector<std::string> title = {};  ///< lines
  Point title_bottom = Point::Zero();   ///< base line of the last line, at its middle
  Point middle = Point::Zero();         ///< in pixels, where the middle of the bounds goes
  std::vector<Point> points = {};       ///< of the vertices, in pixels

  // Of rasterized panels:
  Point image_corner = Point::Zero();      ///< upper left
  int image_width = 0;                     ///< in pixels of the PNG
  std::vector<std::uint32_t> pixels = {};  ///< as Cairo has them
  std::vector<char> is_hidden = {};        ///< vertices behind something
};

struct ColourBar {
  ColourScale scale;
  std::vector<Tick> ticks;
  double tick_width = 0.0;  ///< of the widest label
  double x = 0.0;
  double y = 0.0;
  double height = 0.0;
};

struct Layout {
  double width = 0.0;
  double height = 0.0;
  double scale = 1.0;  ///< pixels per unit of the meshes
  std::vector<Panel> panels;
  std::optional<ColourBar> bar;
};

Eigen::Vector3d position_of(const Mesh& mesh, Index vertex) {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  position.head(mesh.positions.cols()) = mesh.positions.row(vertex).transpose();
  return position;
}

Eigen::AlignedBox3d extent_of(const Mesh& mesh) {
  Eigen::AlignedBox3d box;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Eigen::Vector3d position = position_of(mesh, v);
    if (position.allFinite()) box.extend(position);
  }
  if (box.isEmpty()) box.extend(Eigen::Vector3d::Zero());
  return box;
}

/// The eye of perspective views is this many radii of the largest object away from it.
constexpr double kEyeDistance = 5.0;

// box: what the view is centred on; radius: of the largest object.
Panel panel_of(const MeshFigure& figure, const Camera& camera, const Eigen::AlignedBox3d& box, double radius) {
  Panel panel{.figure = &figure, .seen = {}};
  const Mesh& mesh = figure.mesh;
  if (figure.is_spatial()) {
    panel.view.emplace(camera, box.center(), kEyeDistance * radius);
  } else if (figure.uv.size() > 0) {
    panel.view.emplace(Camera{.direction = {0, 0, 1}, .up = {0, 1, 0}}, box.center(), 1.0);
  }
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Eigen::Vector3d position = position_of(mesh, v);
    panel.seen.push_back(panel.view ? (*panel.view)(position) : position);
    if (panel.seen.back().allFinite()) panel.bounds.extend(Point(panel.seen.back().head<2>()));
  }
  if (panel.bounds.isEmpty()) panel.bounds.extend(Point::Zero());
  return panel;
}

// The part of what is seen that a figure in space is cut to.
Box zoomed(const Box& bounds, const MeshFigure& figure, const Camera& camera) {
  if (!figure.is_spatial()) return bounds;
  const Point centre = bounds.center();
  const Point half = bounds.sizes() / (2.0 * camera.zoom);
  return {Point(centre - half), Point(centre + half)};
}

double radius_of(const Eigen::AlignedBox3d& box) { return std::max(kMinExtent, 0.5 * box.diagonal().norm()); }

std::vector<Panel> panels_of(const std::vector<MeshFigure>& figures, const Camera& camera) {
  double radius = kMinExtent;
  for (const MeshFigure& figure : figures) radius = std::max(radius, radius_of(extent_of(figure.mesh)));
  std::vector<Panel> panels;
  for (const MeshFigure& figure : figures) {
    panels.push_back(panel_of(figure, camera, extent_of(figure.mesh), radius));
    panels.back().bounds = zoomed(panels.back().bounds, figure, camera);
    panels.back().surface = surface_of(figure.mesh);
  }
  return panels;
}

/// Lines of a title, broken between words where it is wider than allowed.
std::vector<std::string> wrapped(Canvas& canvas, const std::string& title, double width) {
  std::vector<std::string> lines;
  std::istringstream paragraphs(title);
  for (std::string paragraph; std::getline(paragraphs, paragraph);) {
    std::istringstream words(paragraph);
    std::string line;
    for (std::string word; words >> word;) {
      const std::string longer = line.empty() ? word : fmt::format("{} {}", line, word);
      if (!line.empty() && canvas.text_width(longer) > width) {
        lines.emplace_back(std::exchange(line, word));
      } else {
        line = longer;
      }
    }
    lines.push_back(line);
  }
  return lines;
}

/// Widths of columns and heights of rows in a grid filled row by row.
struct Grid {
  std::vector<double> widths;
  std::vector<double> heights;

  Grid(const std::vector<Point>& sizes, std::size_t columns)
      : widths(columns, 0.0), heights((sizes.size() + columns - 1) / columns, 0.0) {
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      widths[i % columns] = std::max(widths[i % columns], sizes[i].x());
      heights[i / columns] = std::max(heights[i / columns], sizes[i].y());
    }
  }

  double width() const { return sum(widths); }
  double height() const { return sum(heights); }

 private:
  static double sum(const std::vector<double>& lengths) {
    double total = 0.0;
    for (const double length : lengths) total += length;
    return total;
  }
};

constexpr double kPageAspect = 1.5;

/// The number of columns whose grid is closest to the shape of a page on its side: two panels stand side by side.
std::size_t best_columns(const std::vector<Point>& sizes) {
  std::size_t best = 1;
  double best_excess = std::numeric_limits<double>::infinity();
  for (std::size_t columns = 1; columns <= sizes.size(); ++columns) {
    const Grid grid(sizes, columns);
    const double excess = std::abs(std::log(grid.width() / grid.height() / kPageAspect));
    if (excess < best_excess) {
      best = columns;
      best_excess = excess;
    }
  }
  return best;
}

/// Pixels per unit of the mesh.
double length_scale(const std::vector<Point>& sizes, const Grid& grid, const Point& most) {
  double scale = std::min(kMaxContentWidth / grid.width(), kMaxContentHeight / grid.height());
  for (const Point& size : sizes) scale = std::min({scale, most.x() / size.x(), most.y() / size.y()});
  return scale;
}

ColourBar bar_of(Canvas& canvas, const ColourScale& scale) {
  ColourBar bar{.scale = scale, .ticks = axis_ticks(scale.low, scale.high, scale.logarithmic)};
  canvas.set_font(kTickSize);
  for (const Tick& tick : bar.ticks) bar.tick_width = std::max(bar.tick_width, canvas.text_width(tick.label));
  return bar;
}

/// With the gap before it.
double bar_width(const ColourBar& bar) {
  return kBarGap + kBarWidth + 2 * kTickLength + bar.tick_width +
         (bar.scale.label.empty() ? 0.0 : kLabelGap + kLabelSize);
}

bool has_colours(const MeshFigure& figure) { return figure.cell_values.size() > 0 && figure.uv.size() == 0; }

/// most: width and height of a panel.
Layout layout_of(Canvas& canvas, std::vector<Panel> panels, int columns_wanted, const Point& most) {
  Layout layout;
  layout.panels = std::move(panels);
  std::vector<Point> sizes;
  // Meshes without extent are points in a panel of some size.
  for (const Panel& panel : layout.panels) sizes.emplace_back(panel.bounds.sizes().cwiseMax(kMinExtent));
  const std::size_t columns =
      columns_wanted > 0 ? std::min(static_cast<std::size_t>(columns_wanted), sizes.size()) : best_columns(sizes);
  const double scale = length_scale(sizes, Grid(sizes, columns), most);
  layout.scale = scale;
  for (Point& size : sizes) size *= scale;
  Grid grid(sizes, columns);

  // Titles wrap at the width of their column; a word that is longer widens it.
  canvas.set_font(kTitleSize, true);
  std::vector<double> title_heights(grid.heights.size(), 0.0);
  for (double& width : grid.widths) width = std::max(width, kMinColumnWidth);
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    Panel& panel = layout.panels[i];
    panel.title = wrapped(canvas, panel.figure->title, grid.widths[i % columns]);
    for (const std::string& line : panel.title) {
      grid.widths[i % columns] = std::max(grid.widths[i % columns], canvas.text_width(line));
    }
    if (!panel.title.empty()) {
      title_heights[i / columns] =
          std::max(title_heights[i / columns], kTitleLine * static_cast<double>(panel.title.size()) + kTitleGap);
    }
  }

  Point corner(kMargin, kMargin);
  for (std::size_t i = 0; i < layout.panels.size(); ++i) {
    Panel& panel = layout.panels[i];
    const std::size_t column = i % columns;
    const std::size_t row = i / columns;
    if (i > 0 && column == 0) {
      corner = Point(kMargin, corner.y() + title_heights[row - 1] + grid.heights[row - 1] + kGap);
    }
    const Point middle = corner + Point(grid.widths[column] / 2, title_heights[row] + grid.heights[row] / 2);
    panel.title_bottom = Point(middle.x(), corner.y() + title_heights[row] - kTitleGap - (kTitleLine - kTitleSize));
    panel.middle = middle;
    corner.x() += grid.widths[column] + kGap;
  }
  layout.width = kMargin + grid.width() + kGap * static_cast<double>(grid.widths.size() - 1) + kMargin;
  layout.height = corner.y() + title_heights.back() + grid.heights.back() + kMargin;

  const auto coloured = std::find_if(layout.panels.begin(), layout.panels.end(),
                                     [](const Panel& panel) { return has_colours(*panel.figure); });
  if (coloured == layout.panels.end()) return layout;
  ColourBar bar = bar_of(canvas, coloured->figure->scale);
  canvas.set_font(kLabelSize);
  const double label_length = canvas.text_width(bar.scale.label);
  const double content_height = layout.height - 2 * kMargin;
  bar.height = std::clamp(content_height, kMinBarHeight, kMaxBarHeight);
  // The outermost tick labels stand out by half their height.
  layout.height = std::max({layout.height, label_length + 2 * kMargin, bar.height + kTickSize + 2 * kMargin});
  bar.x = layout.width - kMargin + kBarGap;
  bar.y = (layout.height - bar.height) / 2;
  layout.width += bar_width(bar);

  const double shift = (layout.height - 2 * kMargin - content_height) / 2;
  for (Panel& panel : layout.panels) {
    panel.title_bottom.y() += shift;
    panel.middle.y() += shift;
  }
  layout.bar = std::move(bar);
  return layout;
}

// ---------------------------------------------------------------------------------------------------------------------
// Drawing

/// Places the vertices, once the layout is final.
void place(Layout& layout) {
  for (Panel& panel : layout.panels) {
    const Point centre = panel.bounds.center();
    for (const Eigen::Vector3d& seen : panel.seen) {
      const Point offset = layout.scale * (seen.head<2>() - centre);
      panel.points.emplace_back(panel.middle.x() + offset.x(), panel.middle.y() - offset.y());
    }
  }
}

const Point& corner_of(const Panel& panel, Index triangle, int k) {
  return panel.points[static_cast<std::size_t>(panel.surface.triangles(triangle, k))];
}

Index triangle_count(const Panel& panel) { return static_cast<Index>(panel.surface.triangles.rows()); }

Index cell_of(const Panel& panel, Index triangle) { return panel.surface.cells[static_cast<std::size_t>(triangle)]; }

/// Side length of a typical cell in pixels.
double cell_size(const Panel& panel) {
  std::vector<double> areas;
  for (Index t = 0; t < triangle_count(panel); ++t) {
    const Point ab = corner_of(panel, t, 1) - corner_of(panel, t, 0);
    const Point ac = corner_of(panel, t, 2) - corner_of(panel, t, 0);
    const double area = std::abs(ab.x() * ac.y() - ab.y() * ac.x());
    if (std::isfinite(area)) areas.push_back(area);
  }
  if (areas.empty()) return 0.0;
  const auto middle = areas.begin() + static_cast<std::ptrdiff_t>(areas.size() / 2);
  std::nth_element(areas.begin(), middle, areas.end());
  return std::sqrt(*middle);
}

void add_triangle(Canvas& canvas, const Panel& panel, Index triangle) {
  canvas.add_triangle(corner_of(panel, triangle, 0), corner_of(panel, triangle, 1), corner_of(panel, triangle, 2));
}

std::vector<char> flags(const std::vector<Index>& chosen, Index count) {
  std::vector<char> is_chosen(static_cast<std::size_t>(count), 0);
  for (const Index i : chosen) is_chosen[static_cast<std::size_t>(i)] = 1;
  return is_chosen;
}

double edge_width(double size) { return std::clamp(0.04 * size, 0.1, 0.6); }
double flipped_width(double size) { return std::clamp(0.15 * size, 1.0, 2.0); }

int colour_index(const Panel& panel, const ColourScale* scale, Index cell) {
  if (scale == nullptr || panel.figure->cell_values.size() == 0) return kPlainColour;
  const double position = position_on(*scale, panel.figure->cell_values[cell]);
  return std::isnan(position) ? kUndefinedColour : static_cast<int>(std::lround(position * (kColourCount - 1)));
}

Colour indexed_colour(int index) {
  if (index == kPlainColour) return kPlain;
  if (index == kUndefinedColour) return kUndefined;
  return mapped_colour(index / (kColourCount - 1.0));
}

void draw_cells(Canvas& canvas, const Panel& panel, const ColourScale* scale) {
  std::array<std::vector<Index>, kPlainColour + 1> groups;
  for (Index t = 0; t < triangle_count(panel); ++t) {
    groups[static_cast<std::size_t>(colour_index(panel, scale, cell_of(panel, t)))].push_back(t);
  }
  for (std::size_t i = 0; i < groups.size(); ++i) {
    if (groups[i].empty()) continue;
    canvas.set_colour(indexed_colour(static_cast<int>(i)));
    for (const Index t : groups[i]) add_triangle(canvas, panel, t);
    cairo_fill_preserve(canvas.get());
    canvas.stroke(0.4);  // closes the seams that antialiasing leaves between neighbours
  }
}

void draw_edges(Canvas& canvas, const Panel& panel, double size) {
  if (!panel.figure->edges || size < kMinCellSize) return;
  std::vector<std::pair<Index, Index>> edges;
  for (Index t = 0; t < triangle_count(panel); ++t) {
    const auto triangle = panel.surface.triangles.row(t);
    for (int k = 0; k < 3; ++k) edges.emplace_back(std::minmax({triangle[k], triangle[(k + 1) % 3]}));
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  for (const auto& [a, b] : edges) {
    const Point& from = panel.points[static_cast<std::size_t>(a)];
    const Point& to = panel.points[static_cast<std::size_t>(b)];
    cairo_move_to(canvas.get(), from.x(), from.y());
    cairo_line_to(canvas.get(), to.x(), to.y());
  }
  canvas.set_colour({0.0, 0.0, 0.0}, kEdgeOpacity);
  canvas.stroke(edge_width(size));
}

Rgb as_rgb(const Colour& colour) { return Eigen::Vector3d(colour.red, colour.green, colour.blue).cast<float>(); }

/// Vertex in pixels of the PNG from the corner of the panel's image; depth in the same unit.
Eigen::Vector3d image_point(const Panel& panel, double length_scale, Index vertex) {
  const auto v = static_cast<std::size_t>(vertex);
  Eigen::Vector3d point;
  point << panel.resolution * (panel.points[v] - panel.image_corner),
      panel.resolution * length_scale * panel.seen[v].z();
  return point;
}

void rasterize(Panel& panel, double length_scale, const ColourScale* scale, double check_size) {
  const MeshFigure& figure = *panel.figure;
  const Point half = 0.5 * length_scale * panel.bounds.sizes() + Point::Constant(kImageMargin);
  // Whole pixels of the PNG, so that it shows the image as it is.
  panel.image_corner = ((panel.middle - half) * panel.resolution).array().floor() / panel.resolution;
  const Point size = (panel.middle + half - panel.image_corner) * panel.resolution;
  panel.image_width = static_cast<int>(std::ceil(size.x()));
  Raster raster(panel.image_width, static_cast<int>(std::ceil(size.y())));

  const double cell = cell_size(panel);
  const bool has_edges = figure.edges && cell >= kMinCellSize;
  const std::vector<char> is_flipped = flags(figure.flipped_cells, figure.mesh.cell_count());
  Matrix positions = Matrix::Zero(figure.mesh.positions.rows(), 3);
  positions.leftCols(figure.mesh.positions.cols()) = figure.mesh.positions;
  const Matrix normals = corner_normals(positions, panel.surface.triangles);
  for (Index t = 0; t < triangle_count(panel); ++t) {
    const Index c = cell_of(panel, t);
    RasterTriangle triangle;
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const Index v = panel.surface.triangles(t, k);
      triangle.corners[i] = image_point(panel, length_scale, v);
      triangle.normals[i] = panel.view->turned(normals.row(3 * static_cast<Eigen::Index>(t) + k).transpose());
      triangle.weights[i] = panel.view->magnification(panel.seen[static_cast<std::size_t>(v)].z());
      if (figure.uv.size() > 0) {
        triangle.uv[i] = figure.uv.row(figure.uv_cells.size() > 0 ? figure.uv_cells(c, k) : v) / check_size;
      }
    }
    triangle.is_textured = figure.uv.size() > 0;
    triangle.is_lit = figure.is_spatial();
    const bool has_value = scale != nullptr && figure.cell_values.size() > 0;
    triangle.colour = has_value ? colour_on(*scale, figure.cell_values[c]) : as_rgb(kPlain);
    if (is_flipped[static_cast<std::size_t>(c)]) {
      triangle.edge_colour = as_rgb(kFlipped);
      triangle.edge_opacity = 1.0f;
      triangle.edge_width = panel.resolution * flipped_width(cell);
    } else if (has_edges) {
      triangle.edge_opacity = static_cast<float>(kEdgeOpacity);
      triangle.edge_width = 0.5 * panel.resolution * edge_width(cell);
    }
    raster.draw(triangle);
  }
  panel.pixels = raster.pixels();
  for (Index v = 0; v < figure.mesh.vertex_count(); ++v) {
    panel.is_hidden.push_back(raster.is_visible(image_point(panel, length_scale, v), 0.5 * panel.resolution) ? 0 : 1);
  }
}

/// Places everything and draws what a z-buffer draws. check_size: of figures that leave it open.
void paint(Layout& layout, double check_size) {
  place(layout);
  for (Panel& panel : layout.panels) {
    if (!panel.view) continue;
    rasterize(panel, layout.scale, layout.bar ? &layout.bar->scale : nullptr,
              panel.figure->check_size > 0.0 ? panel.figure->check_size : check_size);
  }
}

void draw_image(Canvas& canvas, const Panel& panel) {
  std::vector<std::uint32_t> pixels = panel.pixels;  // Cairo wants them writable
  const int height = static_cast<int>(pixels.size()) / panel.image_width;
  const Picture image(cairo_image_surface_create_for_data(reinterpret_cast<unsigned char*>(pixels.data()),
                                                          CAIRO_FORMAT_ARGB32, panel.image_width, height,
                                                          4 * panel.image_width));
  cairo_save(canvas.get());
  cairo_translate(canvas.get(), panel.image_corner.x(), panel.image_corner.y());
  cairo_scale(canvas.get(), 1.0 / panel.resolution, 1.0 / panel.resolution);
  cairo_set_source_surface(canvas.get(), image.get(), 0.0, 0.0);
  cairo_pattern_set_filter(cairo_get_source(canvas.get()), CAIRO_FILTER_GOOD);
  cairo_paint(canvas.get());
  cairo_restore(canvas.get());
  cairo_set_source_rgb(canvas.get(), 0.0, 0.0, 0.0);
  cairo_surface_finish(image.get());  // takes a copy where the picture still refers to the pixels
}

enum class Marker { square, disc, ring };

void draw_markers(Canvas& canvas, const Panel& panel, const std::vector<Index>& vertices, Marker marker,
                  double radius) {
  for (const Index v : vertices) {
    const Point& point = panel.points[static_cast<std::size_t>(v)];
    if (!point.allFinite() || (panel.view && panel.is_hidden[static_cast<std::size_t>(v)])) continue;
    if (marker == Marker::square) {
      cairo_rectangle(canvas.get(), point.x() - radius, point.y() - radius, 2 * radius, 2 * radius);
    } else {
      cairo_new_sub_path(canvas.get());
      cairo_arc(canvas.get(), point.x(), point.y(), radius, 0.0, 2 * std::numbers::pi);
      cairo_close_path(canvas.get());
    }
  }
  // A rim in the opposite tone keeps markers apart from dark and light cells. It is drawn below the fill, so that
  // crowded markers do not hide each other.
  const Colour white = rgb(0xffffff);
  const bool is_open = marker == Marker::ring;
  canvas.set_colour(is_open ? kInk : white);
  cairo_set_line_width(canvas.get(), 0.8 * radius);
  cairo_stroke_preserve(canvas.get());
  canvas.set_colour(is_open ? white : kInk);
  cairo_fill(canvas.get());
}

void draw_panel(Canvas& canvas, const Panel& panel, const ColourScale* scale) {
  canvas.set_font(kTitleSize, true);
  canvas.set_colour(kInk);
  for (std::size_t i = 0; i < panel.title.size(); ++i) {
    const double lines_below = static_cast<double>(panel.title.size() - 1 - i);
    canvas.draw_text(panel.title_bottom.x(), panel.title_bottom.y() - kTitleLine * lines_below, panel.title[i], 0.5);
  }

  const MeshFigure& figure = *panel.figure;
  const double size = cell_size(panel);
  if (panel.view) {
    draw_image(canvas, panel);
    cairo_save(canvas.get());
    cairo_rectangle(canvas.get(), panel.image_corner.x(), panel.image_corner.y(), panel.image_width / panel.resolution,
                    static_cast<double>(panel.pixels.size()) / panel.image_width / panel.resolution);
    cairo_clip(canvas.get());
  } else {
    draw_cells(canvas, panel, scale);
    draw_edges(canvas, panel, size);
  }
  const double radius = std::clamp(0.3 * size, 2.0, 3.2);
  draw_markers(canvas, panel, figure.soft_vertices, Marker::ring, radius);
  draw_markers(canvas, panel, figure.fixed_vertices, Marker::square, radius);
  draw_markers(canvas, panel, figure.moved_vertices, Marker::disc, 1.2 * radius);

  if (panel.view) {
    cairo_restore(canvas.get());
    return;
  }
  const std::vector<char> is_flipped = flags(figure.flipped_cells, figure.mesh.cell_count());
  for (Index t = 0; t < triangle_count(panel); ++t) {
    if (is_flipped[static_cast<std::size_t>(cell_of(panel, t))]) add_triangle(canvas, panel, t);
  }
  canvas.set_colour(kFlipped);
  canvas.stroke(flipped_width(size));
}

void draw_bar(Canvas& canvas, const ColourBar& bar) {
  const Pattern gradient(cairo_pattern_create_linear(0.0, bar.y + bar.height, 0.0, bar.y));
  for (std::size_t i = 0; i < kColourMap.size(); ++i) {
    const double offset = static_cast<double>(i) / (kColourMap.size() - 1);
    const Colour colour = mapped_colour(offset);
    cairo_pattern_add_color_stop_rgb(gradient.get(), offset, colour.red, colour.green, colour.blue);
  }
  cairo_rectangle(canvas.get(), bar.x, bar.y, kBarWidth, bar.height);
  cairo_set_source(canvas.get(), gradient.get());
  cairo_fill_preserve(canvas.get());
  canvas.set_colour(kInk);
  canvas.stroke(0.6);

  canvas.set_font(kTickSize);
  const double right = bar.x + kBarWidth;
  for (const Tick& tick : bar.ticks) {
    const double y = bar.y + bar.height * (1.0 - position_on(bar.scale, tick.value));
    cairo_move_to(canvas.get(), right, y);
    cairo_line_to(canvas.get(), right + kTickLength, y);
    canvas.stroke(0.8);
    canvas.draw_text(right + 2 * kTickLength, y + 0.36 * kTickSize, tick.label, 0.0);
  }

  if (bar.scale.label.empty()) return;
  canvas.set_font(kLabelSize);
  cairo_save(canvas.get());
  cairo_translate(canvas.get(), right + 2 * kTickLength + bar.tick_width + kLabelGap + kLabelSize,
                  bar.y + bar.height / 2);
  cairo_rotate(canvas.get(), -std::numbers::pi / 2);
  canvas.draw_text(0.0, 0.0, bar.scale.label, 0.5);
  cairo_restore(canvas.get());
}

void draw(Canvas& canvas, const Layout& layout) {
  canvas.set_colour(rgb(0xffffff));
  cairo_paint(canvas.get());
  const ColourScale* const scale = layout.bar ? &layout.bar->scale : nullptr;
  for (const Panel& panel : layout.panels) draw_panel(canvas, panel, scale);
  if (layout.bar) draw_bar(canvas, *layout.bar);
}

// ---------------------------------------------------------------------------------------------------------------------
// Files

cairo_status_t append(void* text, const unsigned char* data, unsigned length) {
  static_cast<std::string*>(text)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

void require_success(cairo_status_t status, const std::filesystem::path& path) {
  if (status == CAIRO_STATUS_SUCCESS) return;
  throw DataError(fmt::format("{}: cannot be drawn: {}", path.string(), cairo_status_to_string(status)));
}

std::filesystem::path with_extension(std::filesystem::path path, const char* extension) { return path += extension; }

void write_svg(const Layout& layout, const std::filesystem::path& path) {
  std::string content;
  const Picture surface(
      cairo_svg_surface_create_for_stream(append, &content, std::ceil(layout.width), std::ceil(layout.height)));
  cairo_svg_surface_set_document_unit(surface.get(), CAIRO_SVG_UNIT_PX);
  {
    Canvas canvas(surface.get());
    draw(canvas, layout);
    require_success(canvas.status(), path);
  }
  cairo_surface_finish(surface.get());
  require_success(cairo_surface_status(surface.get()), path);
  write_file(path, content);
}

void write_png(const Layout& layout, double resolution, const std::filesystem::path& path) {
  const Picture surface(cairo_image_surface_create(CAIRO_FORMAT_RGB24,
                                                   static_cast<int>(std::ceil(layout.width) * resolution),
                                                   static_cast<int>(std::ceil(layout.height) * resolution)));
  Canvas canvas(surface.get());
  cairo_scale(canvas.get(), resolution, resolution);
  draw(canvas, layout);
  require_success(canvas.status(), path);
  std::string content;
  require_success(cairo_surface_write_to_png_stream(surface.get(), append, &content), path);
  write_file(path, content);
}

void check(const MeshFigure& figure) {
  const auto fail = [&figure](const std::string& message) {
    throw UsageError(fmt::format("figure '{}': {}", figure.title, message));
  };
  const Mesh& mesh = figure.mesh;
  if (mesh.positions.cols() != 2 && mesh.positions.cols() != 3) {
    fail(fmt::format("positions have {} columns, expected 2 or 3", mesh.positions.cols()));
  }
  if (mesh.cells.cols() != 3 && !(mesh.cells.cols() == 4 && figure.is_spatial())) {
    fail(fmt::format("cells have {} corners, expected 3{}", mesh.cells.cols(), figure.is_spatial() ? " or 4" : ""));
  }
  if (figure.uv.size() > 0) {
    if (mesh.cells.cols() != 3) fail("texture coordinates are for triangles");
    if (figure.uv.cols() != 2) fail(fmt::format("uv has {} columns, expected 2", figure.uv.cols()));
    if (figure.uv_cells.size() == 0 && figure.uv.rows() != mesh.vertex_count()) {
      fail(fmt::format("{} uv for {} vertices", figure.uv.rows(), mesh.vertex_count()));
    }
    if (figure.uv_cells.size() > 0 && (figure.uv_cells.rows() != mesh.cell_count() || figure.uv_cells.cols() != 3)) {
      fail(fmt::format("{} x {} corners of uv for {} cells", figure.uv_cells.rows(), figure.uv_cells.cols(),
                       mesh.cell_count()));
    }
    if (!(figure.check_size >= 0.0 && std::isfinite(figure.check_size))) fail("expected a positive check_size");
  }
  if (figure.cell_values.size() != 0 && figure.cell_values.size() != mesh.cell_count()) {
    fail(fmt::format("{} values for {} cells", figure.cell_values.size(), mesh.cell_count()));
  }
  const ColourScale& scale = figure.scale;
  if (!(scale.low < scale.high) || !std::isfinite(scale.high - scale.low) || (scale.logarithmic && scale.low <= 0.0)) {
    fail(fmt::format("colour scale from {} to {}, expected {}low < high", scale.low, scale.high,
                     scale.logarithmic ? "0 < " : ""));
  }
  const auto check_indices = [&fail](const auto& indices, Index count, const char* what) {
    for (const Index i : indices) {
      if (i < 0 || i >= count) fail(fmt::format("{} {} of {}", what, i, count));
    }
  };
  check_indices(mesh.cells.reshaped(), mesh.vertex_count(), "cells name vertex");
  check_indices(figure.uv_cells.reshaped(), static_cast<Index>(figure.uv.rows()), "cells name uv");
  check_indices(figure.fixed_vertices, mesh.vertex_count(), "fixed vertex");
  check_indices(figure.moved_vertices, mesh.vertex_count(), "moved vertex");
  check_indices(figure.soft_vertices, mesh.vertex_count(), "soft vertex");
  check_indices(figure.flipped_cells, mesh.cell_count(), "flipped cell");
}

}  // namespace

Rgb colour_on(const ColourScale& scale, double value) { return as_rgb(mapped_colour(position_on(scale, value))); }

Rgb plain_colour() { return as_rgb(kPlain); }

ColourScale common_scale(const std::vector<Vector>& fields, bool logarithmic, const std::string& label) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const Vector& field : fields) {
    for (const double value : field) {
      if (!std::isfinite(value) || (logarithmic && value <= 0.0)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  if (low > high) return {.low = logarithmic ? 0.1 : 0.0, .high = 1.0, .logarithmic = logarithmic, .label = label};
  if (logarithmic) {
    low = std::max(low, high * std::pow(10.0, -kMaxDecades));
    if (low >= high) low = high / 10.0;
  } else {
    low = std::min(low, 0.0);
    if (low >= high) high = low + 1.0;
  }
  return {.low = low, .high = high, .logarithmic = logarithmic, .label = label};
}

double common_check_size(const std::vector<MeshFigure>& figures) {
  double extent = 0.0;
  for (const MeshFigure& figure : figures) {
    Box box;
    for (Eigen::Index i = 0; i < figure.uv.rows(); ++i) {
      if (figure.uv.row(i).allFinite()) box.extend(Point(figure.uv.row(i).transpose()));
    }
    if (!box.isEmpty()) extent = std::max(extent, box.sizes().maxCoeff());
  }
  return extent > 0.0 ? extent / kChecks : 1.0;
}

void draw_meshes(const std::vector<MeshFigure>& figures, const std::filesystem::path& path, int columns,
                 const Camera& camera) {
  if (figures.empty()) throw UsageError(fmt::format("{}: no figures to draw", path.string()));
  for (const MeshFigure& figure : figures) check(figure);

  // Titles are measured before there is a picture of known size.
  const Picture scratch(cairo_image_surface_create(CAIRO_FORMAT_RGB24, 1, 1));
  Canvas meter(scratch.get());
  Layout layout = layout_of(meter, panels_of(figures, camera), columns, {kMaxPanelWidth, kMaxPanelHeight});
  paint(layout, common_check_size(figures));
  write_svg(layout, with_extension(path, ".svg"));
  write_png(layout, kPngScale, with_extension(path, ".png"));
}

void draw_frames(const std::vector<MeshFigure>& frames, const std::vector<std::filesystem::path>& files,
                 const Camera& camera) {
  if (frames.size() != files.size()) {
    throw UsageError(fmt::format("{} frames for {} files", frames.size(), files.size()));
  }
  Eigen::AlignedBox3d box;
  for (const MeshFigure& frame : frames) {
    check(frame);
    box.extend(extent_of(frame.mesh));
  }
  const double radius = radius_of(box);
  Box bounds;
  for (const MeshFigure& frame : frames) bounds.extend(panel_of(frame, camera, box, radius).bounds);

  const Picture scratch(cairo_image_surface_create(CAIRO_FORMAT_RGB24, 1, 1));
  Canvas meter(scratch.get());
  const double check_size = common_check_size(frames);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    Panel panel = panel_of(frames[i], camera, box, radius);
    panel.bounds = zoomed(bounds, frames[i], camera);
    panel.surface = surface_of(frames[i].mesh);
    panel.resolution = 1.0;
    // The colour bar takes its share of the width.
    double width = kMaxFrameWidth - 2 * kMargin;
    if (has_colours(frames[i])) width -= bar_width(bar_of(meter, frames[i].scale));
    Layout layout = layout_of(meter, {std::move(panel)}, 1, {width, kMaxFrameHeight});
    paint(layout, check_size);
    write_png(layout, 1.0, files[i]);
  }
}

std::string colour_of(double value) {
  const Colour colour = mapped_colour(value);
  const auto byte = [](double channel) { return static_cast<int>(std::lround(255.0 * channel)); };
  return fmt::format("#{:02x}{:02x}{:02x}", byte(colour.red), byte(colour.green), byte(colour.blue));
}

}  // namespace variform
