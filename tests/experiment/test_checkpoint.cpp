// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <limits>

#include "framework/experiment/checkpoint.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

template <class M>
void expect_same(const M& a, const M& b) {
  ASSERT_EQ(a.rows(), b.rows());
  ASSERT_EQ(a.cols(), b.cols());
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    if constexpr (std::is_same_v<typename M::Scalar, double>) {
      if (std::isnan(a.data()[i])) {
        EXPECT_TRUE(std::isnan(b.data()[i]));
        continue;
      }
    }
    EXPECT_EQ(a.data()[i], b.data()[i]);
  }
}

void expect_same(const MeshFigure& to, const MeshFigure& from) {
  EXPECT_EQ(to.name, from.name);
  EXPECT_EQ(to.title, from.title);
  EXPECT_EQ(to.caption, from.caption);
  expect_same(to.mesh.positions, from.mesh.positions);
  expect_same(to.mesh.cells, from.mesh.cells);
  expect_same(to.cell_values, from.cell_values);
  EXPECT_EQ(to.scale.low, from.scale.low);
  EXPECT_EQ(to.scale.high, from.scale.high);
  EXPECT_EQ(to.scale.logarithmic, from.scale.logarithmic);
  EXPECT_EQ(to.scale.label, from.scale.label);
  expect_same(to.uv, from.uv);
  expect_same(to.uv_cells, from.uv_cells);
  EXPECT_EQ(to.check_size, from.check_size);
  EXPECT_EQ(to.fixed_vertices, from.fixed_vertices);
  EXPECT_EQ(to.moved_vertices, from.moved_vertices);
  EXPECT_EQ(to.soft_vertices, from.soft_vertices);
  EXPECT_EQ(to.flipped_cells, from.flipped_cells);
  EXPECT_EQ(to.edges, from.edges);
}

TEST(Checkpoint, KeepsFiguresAndTrialsToTheLastDigit) {
  const TemporaryFolder folder;
  MeshFigure figure{.name = "texture", .title = "t", .caption = "<c>"};
  figure.mesh.positions = (Matrix(4, 3) << 1.0 / 3.0, kNaN, kInf, 0, 1e-300, -0.1, 1, 2, 3, 4, 5, 6).finished();
  figure.mesh.cells = (IndexMatrix(2, 3) << 0, 1, 2, 1, 3, 2).finished();
  figure.cell_values = (Vector(2) << 0.1, kNaN).finished();
  figure.scale = {.low = 0.1, .high = 1.0 / 7.0, .logarithmic = true, .label = "angle"};
  figure.uv = (Matrix(5, 2) << 0, 1, 2.0 / 3.0, 3, 4, 5, 6, 7, 8, 9).finished();
  figure.uv_cells = (IndexMatrix(2, 3) << 0, 4, 2, 1, 3, 2).finished();
  figure.check_size = 0.3;
  figure.fixed_vertices = {0};
  figure.moved_vertices = {1, 2};
  figure.soft_vertices = {3};
  figure.flipped_cells = {1};
  figure.edges = false;
  MeshFigure planar{.name = "uv"};
  planar.mesh = {figure.uv, (IndexMatrix(1, 3) << 0, 1, 2).finished()};

  Row row;
  row.set("norm.beta", 0.05);
  row.set("asked", std::string("low end"));
  row.set("held", false);
  row.set("flipped", std::int64_t{3});
  row.set("nan", kNaN);
  const Trials trials{.key = "norm.beta",
                      .aim = "smallest",
                      .metrics = {"flipped", "nan"},
                      .against = "rho",
                      .rows = {row, row},
                      .found = true,
                      .value = kNaN,
                      .low = 1.0 / 3.0,
                      .high = 0.5,
                      .remarks = {"rises"}};
  PointResult result;
  result.figures = {figure, planar};
  result.trials = {trials};
  save_point(folder / "point.json", "key", result);
  const auto loaded = load_point(folder / "point.json", "key");
  ASSERT_TRUE(loaded);

  ASSERT_EQ(loaded->figures.size(), 2u);
  for (const std::size_t i : {0u, 1u}) expect_same(loaded->figures[i], result.figures[i]);
  ASSERT_EQ(loaded->trials.size(), 1u);
  const Trials& read = loaded->trials[0];
  EXPECT_EQ(read.key, trials.key);
  EXPECT_EQ(read.aim, trials.aim);
  EXPECT_EQ(read.metrics, trials.metrics);
  EXPECT_EQ(read.against, trials.against);
  EXPECT_EQ(read.found, trials.found);
  EXPECT_TRUE(std::isnan(read.value));
  EXPECT_EQ(read.low, trials.low);
  EXPECT_EQ(read.high, trials.high);
  EXPECT_EQ(read.remarks, trials.remarks);
  EXPECT_EQ(Table::of(read.rows).csv(), Table::of(trials.rows).csv());

  EXPECT_FALSE(load_point(folder / "point.json", "another key"));
}

TEST(Checkpoint, KeepsFramesToTheLastDigitAndTheirCellsOnce) {
  const TemporaryFolder folder;
  PointResult result;
  for (int i = 0; i < 4; ++i) {
    Trajectory::Frame frame{.time = i / 3.0};
    frame.figure = {.name = "motion", .scale = {.label = "angle"}};
    frame.figure.mesh.positions = (Matrix(4, 2) << 0, 0, 1.0 / (i + 3.0), 0, 0, i, kNaN, 1).finished();
    frame.figure.mesh.cells = (IndexMatrix(2, 3) << 0, 1, 2, 2, 1, 3).finished();
    frame.figure.cell_values = (Vector(2) << 0.1 * i, i == 1 ? kInf : kNaN).finished();
    if (i == 2) frame.figure.flipped_cells = {1};
    result.trajectory.frames.push_back(frame);
  }
  result.trajectory.frames[3].figure.mesh.cells = (IndexMatrix(1, 3) << 0, 1, 2).finished();
  result.trajectory.frames[3].figure.cell_values = Vector::Zero(1);
  result.trajectory.curves = {{"volume", {0.0, 1.0 / 3.0}, {1.0, kNaN}}, {"error", {0.0}, {kInf}}};
  save_point(folder / "point.json", "key", result);
  const auto loaded = load_point(folder / "point.json", "key");
  ASSERT_TRUE(loaded);
  ASSERT_EQ(loaded->trajectory.frames.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    const Trajectory::Frame& from = result.trajectory.frames[i];
    EXPECT_EQ(loaded->trajectory.frames[i].time, from.time);
    expect_same(loaded->trajectory.frames[i].figure, from.figure);
  }
  ASSERT_EQ(loaded->trajectory.curves.size(), 2u);
  EXPECT_EQ(loaded->trajectory.curves[0].label, "volume");
  EXPECT_EQ(loaded->trajectory.curves[0].x, result.trajectory.curves[0].x);
  EXPECT_TRUE(std::isnan(loaded->trajectory.curves[0].y[1]));
  EXPECT_EQ(loaded->trajectory.curves[1].y, std::vector<double>{kInf});

  const std::string text = content_of(folder / "point.json");
  int cells = 0;
  for (std::size_t at = text.find("\"cells\""); at != std::string::npos; at = text.find("\"cells\"", at + 1)) ++cells;
  EXPECT_EQ(cells, 2) << "those of the first frame and those of the last, which are others";
}

TEST(Checkpoint, HalfOfOneIsNone) {
  const TemporaryFolder folder;
  PointResult result;
  result.probes = Matrix::Random(5, 2);
  save_point(folder / "point.json", "key", result);
  const std::string whole = content_of(folder / "point.json");
  ASSERT_TRUE(load_point(folder / "point.json", "key"));
  std::ofstream(folder / "point.json") << whole.substr(0, whole.size() / 2);
  EXPECT_FALSE(load_point(folder / "point.json", "key"));
  std::string shorter = whole;
  const std::size_t bytes = shorter.find("\"bytes\":\"", shorter.find("\"probes\"")) + 9;
  shorter.erase(bytes, 4);
  std::ofstream(folder / "point.json") << shorter;
  EXPECT_FALSE(load_point(folder / "point.json", "key")) << "fewer numbers than rows and columns tell";
}

}  // namespace
}  // namespace variform
