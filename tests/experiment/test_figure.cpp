// SPDX-License-Identifier: BSD-3-Clause
#include <cairo.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <pugixml.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "framework/base/error.h"
#include "framework/experiment/figure.h"
#include "framework/experiment/ticks.h"
#include "tests/experiment/temporary_folder.h"

// Fontconfig keeps patterns for the whole process by pointers that LeakSanitizer cannot follow.
extern "C" const char* __lsan_default_suppressions() { return "leak:libfontconfig"; }

namespace variform {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The unit square in 2 n^2 triangles, with values 0, 0.5, 1 in turn.
MeshFigure square(int n) {
  MeshFigure figure{.title = "square"};
  figure.mesh.positions.resize((n + 1) * (n + 1), 2);
  figure.mesh.cells.resize(2 * n * n, 3);
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) figure.mesh.positions.row(j * (n + 1) + i) << double(i) / n, double(j) / n;
  }
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const int a = j * (n + 1) + i;
      const int c = 2 * (j * n + i);
      figure.mesh.cells.row(c) << a, a + 1, a + n + 2;
      figure.mesh.cells.row(c + 1) << a, a + n + 2, a + n + 1;
    }
  }
  figure.cell_values =
      Vector::LinSpaced(2 * n * n, 0, 2 * n * n - 1).unaryExpr([](double c) { return 0.5 * std::fmod(c, 3.0); });
  return figure;
}

int count_paths(const std::filesystem::path& svg, const std::vector<std::string>& in_style) {
  pugi::xml_document document;
  EXPECT_TRUE(document.load_file(svg.c_str()));
  EXPECT_STREQ(document.document_element().name(), "svg");
  int count = 0;
  for (const auto& found : document.select_nodes("//path")) {
    const std::string style = found.node().attribute("style").value();
    bool matches = true;
    for (const std::string& part : in_style) matches = matches && style.find(part) != std::string::npos;
    if (matches) ++count;
  }
  return count;
}

const std::string kFlippedStroke = "stroke:rgb(90.196078%,0%,10.196078%)";
const std::string kInkFill = "fill:rgb(13.333333%,13.333333%,13.333333%)";
const std::string kWhiteFill = "fill:rgb(100%,100%,100%)";

/// Pixels of a PNG as "#rrggbb".
class Picture {
 public:
  explicit Picture(const std::filesystem::path& path)
      : surface_(cairo_image_surface_create_from_png(path.c_str()), cairo_surface_destroy) {
    EXPECT_EQ(cairo_surface_status(surface_.get()), CAIRO_STATUS_SUCCESS);
  }
  int width() const { return cairo_image_surface_get_width(surface_.get()); }
  int height() const { return cairo_image_surface_get_height(surface_.get()); }
  std::string at(int x, int y) const {
    const unsigned char* const row =
        cairo_image_surface_get_data(surface_.get()) + y * cairo_image_surface_get_stride(surface_.get());
    return fmt::format("#{:06x}", reinterpret_cast<const std::uint32_t*>(row)[x] & 0xffffffu);
  }

 private:
  std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface_;
};

TEST(Colour, RunsFromDarkToLight) {
  const auto lightness = [](const std::string& colour) {
    const auto channel = [&colour](std::size_t i) { return std::stoi(colour.substr(i, 2), nullptr, 16); };
    return 0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5);
  };
  for (int i = 1; i <= 50; ++i) {
    EXPECT_GT(lightness(colour_of(i / 50.0)), lightness(colour_of((i - 1) / 50.0))) << i;
  }
  EXPECT_EQ(colour_of(-1.0), colour_of(0.0));
  EXPECT_EQ(colour_of(7.0), colour_of(1.0));
  EXPECT_EQ(colour_of(kNaN), "#bdbdbd");
}

TEST(CommonScale, CoversAllFiniteValues) {
  const Vector a = (Vector(3) << 2.0, kNaN, 5.0).finished();
  const Vector b = (Vector(3) << 1e-3, 0.0, std::numeric_limits<double>::infinity()).finished();
  const ColourScale linear = common_scale({a, b}, false, "x");
  EXPECT_EQ(linear.low, 0.0);
  EXPECT_EQ(linear.high, 5.0);
  EXPECT_EQ(linear.label, "x");
  const ColourScale logarithmic = common_scale({a, b}, true, "");
  EXPECT_EQ(logarithmic.low, 1e-3);
  EXPECT_EQ(logarithmic.high, 5.0);
}

TEST(CommonScale, IsNeverEmpty) {
  for (const bool logarithmic : {false, true}) {
    for (const double value : {0.0, -2.0, 3.0, kNaN}) {
      const ColourScale scale = common_scale({Vector::Constant(2, value)}, logarithmic, "");
      EXPECT_LT(scale.low, scale.high);
      if (logarithmic) {
        EXPECT_GT(scale.low, 0.0);
      }
    }
  }
}

std::vector<std::string> labels(double low, double high, bool logarithmic) {
  std::vector<std::string> texts;
  for (const Tick& tick : axis_ticks(low, high, logarithmic)) texts.push_back(tick.label);
  return texts;
}

TEST(Ticks, AreRound) {
  using ::testing::ElementsAre;
  EXPECT_THAT(labels(0.0, 1.0, false), ElementsAre("0", "0.2", "0.4", "0.6", "0.8", "1"));
  EXPECT_THAT(labels(-0.3, 0.3, false), ElementsAre("-0.3", "-0.2", "-0.1", "0", "0.1", "0.2", "0.3"));
  EXPECT_THAT(labels(1000.1, 1000.3, false), ElementsAre("1000.1", "1000.15", "1000.2", "1000.25", "1000.3"));
  EXPECT_THAT(labels(1e-4, 1.0, true), ElementsAre("10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"));
  EXPECT_THAT(labels(1e-12, 1.0, true), ElementsAre("10⁻¹²", "10⁻⁹", "10⁻⁶", "10⁻³", "10⁰"));
  EXPECT_THAT(labels(0.01, 10.0, true), ElementsAre("0.01", "0.1", "1", "10"));
  EXPECT_THAT(labels(0.03, 0.6, true), ElementsAre("0.05", "0.1", "0.2", "0.5"));
  EXPECT_THAT(labels(3.0, 4.0, true), ElementsAre("3", "3.2", "3.4", "3.6", "3.8", "4"));
  EXPECT_THAT(labels(2.0, 2.0, true), ElementsAre("2"));
}

TEST(DrawMeshes, SvgHasOnePathPerColourAndTheMarkers) {
  const TemporaryFolder folder;
  MeshFigure figure = square(4);
  draw_meshes({figure}, folder / "plain");
  EXPECT_EQ(count_paths(folder / "plain.svg", {"fill:rgb(", "stroke-width:0.4;"}), 3);
  EXPECT_EQ(count_paths(folder / "plain.svg", {kFlippedStroke}), 0);
  EXPECT_EQ(count_paths(folder / "plain.svg", {kInkFill}), 0);
  EXPECT_EQ(count_paths(folder / "plain.svg", {"stroke-opacity:0.45"}), 1);

  figure.cell_values[5] = kNaN;
  figure.fixed_vertices = {0, 1};
  figure.moved_vertices = {20};
  figure.soft_vertices = {12};
  figure.flipped_cells = {3, 4};
  draw_meshes({figure, square(2)}, folder / "marked");
  EXPECT_EQ(count_paths(folder / "marked.svg", {"fill:rgb(", "stroke-width:0.4;"}), 4 + 3);
  EXPECT_EQ(count_paths(folder / "marked.svg", {kFlippedStroke}), 1);
  EXPECT_EQ(count_paths(folder / "marked.svg", {kInkFill}), 2);
  EXPECT_EQ(count_paths(folder / "marked.svg", {kWhiteFill}), 1);
}

TEST(DrawMeshes, FineCellsHaveNoEdges) {
  const TemporaryFolder folder;
  draw_meshes({square(300)}, folder / "fine");
  EXPECT_EQ(count_paths(folder / "fine.svg", {"stroke-opacity:0.45"}), 0);
}

TEST(DrawMeshes, PngShowsValuesAtTheirCells) {
  const TemporaryFolder folder;
  MeshFigure figure = square(1);
  figure.title.clear();
  figure.edges = false;
  figure.cell_values << 30.0, 10.0;
  figure.scale = {.low = 10.0, .high = 30.0, .logarithmic = true};
  draw_meshes({figure}, folder / "square");
  const std::string content = content_of(folder / "square.png");
  EXPECT_EQ(content.substr(0, 8), "\x89PNG\r\n\x1a\n");
  EXPECT_GT(content.size(), 1000u);

  // The square is the first thing from the left and from above, and as wide as it is high.
  const Picture picture(folder / "square.png");
  const std::string white = "#ffffff";
  EXPECT_EQ(picture.at(0, 0), white);
  int top = 0;
  int bottom = picture.height() - 1;
  int left = 0;
  while (picture.at(left, picture.height() / 2) == white) ++left;
  while (picture.at(left + 4, top) == white) ++top;
  while (picture.at(left + 4, bottom) == white) --bottom;
  const double side = bottom - top + 1;
  EXPECT_GT(side, 400.0);
  const auto at = [&](double x, double y) {
    return picture.at(left + static_cast<int>(x * side), bottom - static_cast<int>(y * side));
  };
  EXPECT_EQ(at(2.0 / 3.0, 1.0 / 3.0), colour_of(1.0));
  EXPECT_EQ(at(1.0 / 3.0, 2.0 / 3.0), colour_of(0.0));
}

TEST(DrawMeshes, OverlappingCellsOfOneColourDoNotCancel) {
  const TemporaryFolder folder;
  MeshFigure figure{.edges = false};
  figure.mesh.positions = (Matrix(3, 2) << 0.0, 0.0, 1.0, 0.0, 0.0, 1.0).finished();
  figure.mesh.cells = (IndexMatrix(2, 3) << 0, 1, 2, 0, 2, 1).finished();
  draw_meshes({figure}, folder / "overlap");
  const Picture picture(folder / "overlap.png");
  EXPECT_NE(picture.at(picture.width() / 3, 2 * picture.height() / 3), "#ffffff");
}

TEST(DrawMeshes, SurvivesBrokenSolutions) {
  const TemporaryFolder folder;
  MeshFigure figure = square(3);
  figure.fixed_vertices = {5};
  figure.mesh.positions(5, 0) = kNaN;
  MeshFigure point = square(1);
  point.mesh.positions.setConstant(4.0);
  draw_meshes({figure, point, MeshFigure{.title = "no cells", .mesh = {Matrix(0, 2), IndexMatrix(0, 3)}}},
              folder / "broken", 2);
  EXPECT_GT(content_of(folder / "broken.png").size(), 1000u);
  draw_meshes({point}, folder / "point");
  EXPECT_GT(content_of(folder / "point.png").size(), 1000u);
}

TEST(DrawMeshes, RefusesWhatDoesNotFit) {
  const TemporaryFolder folder;
  const auto refuse = [&folder](auto&& change) {
    MeshFigure figure = square(1);
    change(figure);
    EXPECT_THROW(draw_meshes({figure}, folder / "bad"), UsageError);
  };
  refuse([](MeshFigure& figure) { figure.cell_values.resize(1); });
  refuse([](MeshFigure& figure) { figure.fixed_vertices = {4}; });
  refuse([](MeshFigure& figure) { figure.mesh.positions.conservativeResize(4, 4); });
  refuse([](MeshFigure& figure) { figure.mesh.cells = IndexMatrix::Zero(2, 4); });
  refuse([](MeshFigure& figure) { figure.uv = Matrix::Zero(3, 2); });
  refuse([](MeshFigure& figure) { figure.uv = Matrix::Zero(4, 3); });
  refuse([](MeshFigure& figure) {
    figure.uv = Matrix::Zero(9, 2);
    figure.uv_cells = IndexMatrix::Constant(2, 3, 9);
  });
  refuse([](MeshFigure& figure) {
    figure.uv = Matrix::Zero(9, 2);
    figure.uv_cells = IndexMatrix::Zero(1, 3);
  });
  refuse([](MeshFigure& figure) { figure.flipped_cells = {-1}; });
  refuse([](MeshFigure& figure) { figure.scale = {.low = 1.0, .high = 1.0}; });
  refuse([](MeshFigure& figure) { figure.scale = {.low = 0.0, .high = 1.0, .logarithmic = true}; });
  EXPECT_THROW(draw_meshes({}, folder / "bad"), UsageError);
  EXPECT_THROW(draw_meshes({square(1)}, folder / "missing" / "picture"), DataError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

/// Two squares over each other in space, seen from +z: the upper one, cells 2 and 3, has the larger values.
MeshFigure stack() {
  MeshFigure figure{.edges = false};
  figure.mesh.positions =
      (Matrix(8, 3) << 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1).finished();
  figure.mesh.cells = (IndexMatrix(4, 3) << 0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7).finished();
  figure.cell_values = (Vector(4) << 0, 0, 1, 1).finished();
  return figure;
}

const Camera kFromAbove{.direction = {0, 0, 1}, .up = {0, 1, 0}};
const Camera kFromBelow{.direction = {0, 0, -1}, .up = {0, 1, 0}};

/// The extent of what is not white in the left part of a picture, without colour bar.
struct Extent {
  int left = 1 << 30, right = -1, top = 1 << 30, bottom = -1;
  int width() const { return right - left + 1; }
  int height() const { return bottom - top + 1; }
};

Extent extent_of(const Picture& picture, int from, int to) {
  Extent extent;
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = from; x < to; ++x) {
      if (picture.at(x, y) == "#ffffff") continue;
      extent.left = std::min(extent.left, x);
      extent.right = std::max(extent.right, x);
      extent.top = std::min(extent.top, y);
      extent.bottom = std::max(extent.bottom, y);
    }
  }
  return extent;
}

/// Channel of "#rrggbb".
int channel(const std::string& colour, int i) {
  return std::stoi(colour.substr(1 + 2 * static_cast<std::size_t>(i), 2), nullptr, 16);
}

bool is_yellow(const std::string& colour) { return channel(colour, 0) > 2 * channel(colour, 2); }

TEST(DrawMeshesInSpace, TheCellsNearerToTheCameraAreSeen) {
  const TemporaryFolder folder;
  draw_meshes({stack()}, folder / "above", 0, kFromAbove);
  draw_meshes({stack()}, folder / "below", 0, kFromBelow);
  const Picture above(folder / "above.png");
  const Picture below(folder / "below.png");
  EXPECT_TRUE(is_yellow(above.at(400, above.height() / 2))) << above.at(400, above.height() / 2);
  EXPECT_FALSE(is_yellow(below.at(400, below.height() / 2))) << below.at(400, below.height() / 2);
}

TEST(DrawMeshesInSpace, ThePictureHasTheExtentOfTheProjectedMesh) {
  const TemporaryFolder folder;
  MeshFigure figure = stack();
  figure.cell_values.resize(0);
  figure.mesh.positions.col(0) *= 3.0;
  figure.mesh.positions.col(2) *= 0.5;
  // A planar panel of the same size beside it: both have one length scale.
  MeshFigure planar = figure;
  planar.mesh.positions = Matrix(figure.mesh.positions.leftCols(2));
  draw_meshes({figure, planar}, folder / "above", 2, kFromAbove);
  draw_meshes({figure}, folder / "front", 0, {.direction = {0, -1, 0}, .up = {0, 0, 1}});
  draw_meshes({figure}, folder / "near", 0, {.direction = {0, 0, 1}, .up = {0, 1, 0}, .zoom = 2.0});
  const Picture above(folder / "above.png");
  const Extent left = extent_of(above, 0, above.width() / 2);
  const Extent right = extent_of(above, above.width() / 2, above.width());
  EXPECT_NEAR(left.width(), 3.0 * left.height(), 8.0);
  EXPECT_NEAR(left.width(), right.width(), 3.0);
  EXPECT_NEAR(left.height(), right.height(), 3.0);
  const Picture front(folder / "front.png");
  const Extent standing = extent_of(front, 0, front.width());
  EXPECT_EQ(standing.width(), -(1 << 30)) << "both squares are seen on edge";
  const Picture near(folder / "near.png");
  EXPECT_EQ(near.at(near.width() / 2, near.height() / 2), above.at((left.left + left.right) / 2, near.height() / 2))
      << "zoomed in there is the same surface";
  EXPECT_GT(extent_of(near, 0, near.width()).width(), near.width() - 80) << "it fills the picture";
}

TEST(DrawMeshesInSpace, TetrahedraShowTheColoursOfTheirOutermostCells) {
  const TemporaryFolder folder;
  // A small tetrahedron inside of a large one: as parts of one mesh, both are boundary, but only the large one is seen.
  MeshFigure figure{.edges = false};
  figure.mesh.positions =
      (Matrix(8, 3) << 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0.2, 0.2, 0.2, 0.3, 0.2, 0.2, 0.2, 0.3, 0.2, 0.2, 0.2, 0.3)
          .finished();
  figure.mesh.cells = (IndexMatrix(2, 4) << 0, 1, 2, 3, 4, 5, 6, 7).finished();
  figure.cell_values = (Vector(2) << 0.0, 1.0).finished();
  draw_meshes({figure}, folder / "tet", 0, {.direction = {1, 1, 1}, .up = {0, 0, 1}, .perspective = true});
  const Picture picture(folder / "tet.png");
  int yellow = 0;
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = 0; x < picture.height(); ++x) yellow += is_yellow(picture.at(x, y)) ? 1 : 0;
  }
  EXPECT_EQ(yellow, 0);
}

TEST(DrawMeshesInSpace, MarkersAndOutlinesAreHiddenBehindTheMesh) {
  const TemporaryFolder folder;
  MeshFigure figure = stack();
  figure.cell_values.resize(0);
  // Vertices inside the squares: the fans of the lower one are cells 0 to 3, those of the upper one 4 to 7.
  figure.mesh.positions.conservativeResize(10, 3);
  figure.mesh.positions.row(8) << 0.5, 0.5, 0;
  figure.mesh.positions.row(9) << 0.5, 0.5, 1;
  figure.mesh.cells =
      (IndexMatrix(8, 3) << 0, 1, 8, 1, 2, 8, 2, 3, 8, 3, 0, 8, 4, 5, 9, 5, 6, 9, 6, 7, 9, 7, 4, 9).finished();
  const auto dark_and_red = [&](const Camera& camera, const char* name) {
    draw_meshes({figure}, folder / name, 0, camera);
    const Picture picture(folder / (std::string(name) + ".png"));
    std::pair<int, int> counts;
    for (int y = 0; y < picture.height(); ++y) {
      for (int x = 0; x < picture.width(); ++x) {
        const std::string colour = picture.at(x, y);
        if (colour == "#222222") ++counts.first;
        if (channel(colour, 0) > 150 && channel(colour, 1) < 40) ++counts.second;
      }
    }
    return counts;
  };
  figure.fixed_vertices = {8};
  figure.flipped_cells = {1};
  EXPECT_EQ(dark_and_red(kFromAbove, "above"), std::pair(0, 0));
  const auto [dark, red] = dark_and_red(kFromBelow, "below");
  EXPECT_GT(dark, 50);
  EXPECT_GT(red, 500);
}

TEST(DrawMeshesInSpace, TheSvgCarriesTheImageAndThePngTheSameBytes) {
  const TemporaryFolder folder;
  MeshFigure figure = stack();
  figure.uv = Matrix(figure.mesh.positions.leftCols(2));
  for (const char* name : {"one", "two"}) draw_meshes({figure, square(2)}, folder / name, 0, {.perspective = true});
  EXPECT_EQ(content_of(folder / "one.png"), content_of(folder / "two.png"));
  pugi::xml_document document;
  ASSERT_TRUE(document.load_file((folder / "one.svg").c_str()));
  const auto images = document.select_nodes("//image");
  ASSERT_EQ(images.size(), 1u);
  EXPECT_THAT(images.first().node().attribute("xlink:href").value(), ::testing::StartsWith("data:image/png;base64,"));
}

TEST(DrawMeshesInSpace, ACheckerboardTakesTheCornersOfItsOwnCells) {
  const TemporaryFolder folder;
  // One square of uv for each half of the planar square: the texture is 2 x 1 checks, cut along the diagonal.
  MeshFigure figure = square(1);
  figure.title.clear();
  figure.edges = false;
  figure.check_size = 1.0;
  figure.uv = (Matrix(6, 2) << 0.1, 0.1, 0.9, 0.1, 0.9, 0.9, 1.1, 0.1, 1.9, 0.9, 1.1, 0.9).finished();
  figure.uv_cells = (IndexMatrix(2, 3) << 0, 1, 2, 3, 4, 5).finished();
  draw_meshes({figure}, folder / "checks");
  const Picture picture(folder / "checks.png");
  const Extent extent = extent_of(picture, 0, picture.width());
  const auto at = [&](double x, double y) {
    return picture.at(extent.left + static_cast<int>(x * extent.width()),
                      extent.bottom - static_cast<int>(y * extent.height()));
  };
  const auto hex = [](const Rgb& colour) {
    return fmt::format("#{:02x}{:02x}{:02x}", std::lround(255 * colour[0]), std::lround(255 * colour[1]),
                       std::lround(255 * colour[2]));
  };
  EXPECT_EQ(at(0.7, 0.3), hex(kCheckColours[0]));
  EXPECT_EQ(at(0.3, 0.7), hex(kCheckColours[1]));
}

/// PATH as long as the object lives.
class SearchPath {
 public:
  explicit SearchPath(const std::filesystem::path& path) {
    if (const char* const old = std::getenv("PATH")) old_ = old;
    setenv("PATH", path.c_str(), 1);
  }
  ~SearchPath() {
    if (old_) {
      setenv("PATH", old_->c_str(), 1);
    } else {
      unsetenv("PATH");
    }
  }
  SearchPath(const SearchPath&) = delete;
  SearchPath& operator=(const SearchPath&) = delete;

 private:
  std::optional<std::string> old_;
};

LinePlot convergence_plot() {
  return {.title = "it's `date` \"$HOME\" a_b^2",
          .x_label = "h",
          .y_label = "error",
          .log_x = true,
          .log_y = true,
          .curves = {{.label = "energy_1 {x}", .x = {1.0, 0.5, 0.25, 0.125}, .y = {1.0, kNaN, 0.0, 0.02}},
                     {.label = "empty", .x = {1.0}, .y = {-1.0}}}};
}

TEST(DrawPlot, WritesScriptAndPictures) {
  const TemporaryFolder folder;
  const auto problem = draw_plot(convergence_plot(), folder / "it's a plot");
  const std::string script = content_of(folder / "it's a plot.gp");
  EXPECT_THAT(script, HasSubstr("$curve_0 << EOD\n1 1\n\n0.125 0.02\nEOD\n"));
  EXPECT_THAT(script, HasSubstr("set title 'it''s `date` \"$HOME\" a_b^2'\n"));
  EXPECT_THAT(script, HasSubstr("set output 'it''s a plot.svg'\n"));
  EXPECT_THAT(script, HasSubstr("noenhanced"));
  EXPECT_THAT(script, Not(HasSubstr("$curve_1 with")));
  ASSERT_FALSE(problem) << *problem;
  pugi::xml_document document;
  EXPECT_TRUE(document.load_file((folder / "it's a plot.svg").c_str()));
  EXPECT_THAT(content_of(folder / "it's a plot.svg"), HasSubstr("energy_1 {x}"));
  EXPECT_EQ(content_of(folder / "it's a plot.png").substr(0, 8), "\x89PNG\r\n\x1a\n");
}

TEST(DrawPlot, SaysWhenGnuplotIsMissing) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "empty");
  const SearchPath nothing(folder / "empty");
  const auto problem = draw_plot(convergence_plot(), folder / "plot");
  ASSERT_TRUE(problem);
  EXPECT_THAT(*problem, HasSubstr("gnuplot is not installed"));
  EXPECT_TRUE(std::filesystem::exists(folder / "plot.gp"));
  EXPECT_FALSE(std::filesystem::exists(folder / "plot.svg"));
}

TEST(DrawPlot, SaysWhenThereIsNothingToDraw) {
  const TemporaryFolder folder;
  const auto problem = draw_plot({.title = "t", .curves = {{.x = {1.0}, .y = {kNaN}}}}, folder / "plot");
  ASSERT_TRUE(problem);
  EXPECT_THAT(*problem, HasSubstr("no points"));
}

TEST(DrawPlot, RefusesWhatDoesNotFit) {
  const TemporaryFolder folder;
  EXPECT_THROW(draw_plot({.curves = {{.x = {1.0}, .y = {}}}}, folder / "plot"), UsageError);
  EXPECT_THROW(draw_plot(convergence_plot(), folder / "missing" / "plot"), DataError);
}

TEST(DrawFrames, PicturesAreOfOneSizeAndTheirScaleAndPlaceAreCommon) {
  const TemporaryFolder folder;
  for (const bool is_spatial : {false, true}) {
    std::vector<MeshFigure> frames;
    std::vector<std::filesystem::path> files;
    for (const double size : {0.5, 1.0, 2.0}) {
      frames.push_back(square(4));
      frames.back().title.clear();
      if (is_spatial) {
        Matrix positions = Matrix::Zero(frames.back().mesh.vertex_count(), 3);
        positions.leftCols(2) = frames.back().mesh.positions;
        frames.back().mesh.positions = positions;
      }
      frames.back().mesh.positions *= size;
      frames.back().scale = {.low = 0.0, .high = 1.0, .label = "energy"};
      files.push_back(folder / fmt::format("{}.png", size));
    }
    draw_frames(frames, files, {.direction = {0, 0, 1}, .up = {0, 1, 0}});
    std::vector<Extent> extents;
    for (const auto& file : files) {
      const Picture picture(file);
      EXPECT_EQ(picture.width(), Picture(files[0]).width());
      EXPECT_EQ(picture.height(), Picture(files[0]).height());
      EXPECT_LE(picture.width(), 640);
      EXPECT_GT(picture.width(), 500);
      extents.push_back(extent_of(picture, 0, picture.width() - 110));  // left of the colour bar
    }
    const Extent& largest = extents.back();
    EXPECT_GT(largest.width(), 300);
    for (std::size_t i = 0; i < 3; ++i) {
      const double share = std::pow(0.5, 2.0 - static_cast<double>(i));
      EXPECT_NEAR(extents[i].left, largest.left, 1) << "the corner at the origin stays";
      EXPECT_NEAR(extents[i].bottom, largest.bottom, 1);
      EXPECT_NEAR(extents[i].width(), share * largest.width(), 6);
      EXPECT_NEAR(extents[i].height(), share * largest.height(), 6);
    }
  }
}

TEST(DrawFrames, OneFrameIsTheOnlyPanelOfAPictureAndNoneIsNone) {
  const TemporaryFolder folder;
  draw_frames({}, {});
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  draw_frames({square(2)}, {folder / "a.png"});
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1) << "no SVG";
  EXPECT_THROW(draw_frames({square(2)}, {}), UsageError);
  MeshFigure broken = square(2);
  broken.mesh.cells(0, 0) = 99;
  EXPECT_THROW(draw_frames({broken}, {folder / "b.png"}), UsageError);
}

}  // namespace
}  // namespace variform
