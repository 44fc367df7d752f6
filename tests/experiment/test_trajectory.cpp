// SPDX-License-Identifier: BSD-3-Clause
// Moving shapes: what a run writes, draws and shows of them.
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>
#include <pugixml.hpp>

#include <filesystem>
#include <string>
#include <vector>

#include "framework/domain/io/base64.h"
#include "framework/experiment/runner.h"
#include "tests/experiment/temporary_folder.h"
#include "tests/experiment_child/trouble.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

const std::string kTwo = "[sweep]\n\"model.x\" = [1, 2]\n";

Record run(const std::string& rest, const RunOptions& options, int steps = 3) {
  const std::string text =
      "pipeline = \"trouble\"\n[model]\nwhat = \"flow\"\nx = 1\nsteps = " + std::to_string(steps) + "\n" + rest;
  return run_experiment(Config::parse(text, "study.toml", fs::temp_directory_path()), trouble_pipelines(), options);
}

std::vector<std::pair<std::string, std::string>> series(const fs::path& file) {
  pugi::xml_document document;
  EXPECT_TRUE(document.load_file(file.c_str())) << file;
  const pugi::xml_node root = document.child("VTKFile");
  EXPECT_STREQ(root.attribute("type").value(), "Collection");
  std::vector<std::pair<std::string, std::string>> entries;
  for (const pugi::xml_node entry : root.child("Collection").children("DataSet")) {
    entries.emplace_back(entry.attribute("timestep").value(), entry.attribute("file").value());
  }
  return entries;
}

int count(const std::string& text, const std::string& part) {
  int times = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++times;
  return times;
}

TEST(Trajectory, IsACollectionOfOneFileForEveryFrame) {
  const TemporaryFolder folder;
  for (const bool processes : {true, false}) {
    const fs::path out = folder / (processes ? "a" : "b");
    RunOptions options{.folder = out, .figures = false};
    if (processes) options.point_command = {VARIFORM_TEST_CHILD, "point"};
    const Record record = run(kTwo, options);
    ASSERT_EQ(record.rows.size(), 2u);
    EXPECT_EQ(to_text(*record.rows[1].find("series")), "meshes/point-0001.pvd");
    const auto entries = series(out / "meshes/point-0001.pvd");
    ASSERT_EQ(entries.size(), 4u);
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const double time = 0.1 * static_cast<double>(i);
      EXPECT_EQ(std::stod(entries[i].first), time);
      EXPECT_EQ(entries[i].second, "point-0001/frame-000" + std::to_string(i) + ".vtu");
      const Mesh mesh = read_mesh(out / "meshes" / entries[i].second).mesh;
      EXPECT_EQ(mesh.positions(1, 0), 1.0 + 2.0 * time);
      EXPECT_EQ(mesh.cell_count(), 1);
      EXPECT_THAT(content_of(out / "meshes" / entries[i].second), HasSubstr("Name=\"value\""));
    }
  }
}

TEST(Trajectory, OfAnEarlierRunNoFrameIsLeft) {
  const TemporaryFolder folder;
  const RunOptions options{.folder = folder.path(), .figures = false};
  run("", options, 5);
  run("", options, 2);
  EXPECT_EQ(series(folder / "meshes/point-0000.pvd").size(), 3u);
  const fs::path frames = folder / "meshes/point-0000";
  EXPECT_EQ(std::distance(fs::directory_iterator(frames), {}), 3);
}

TEST(Trajectory, APointWhoseFramesAreGoneIsRunAgain) {
  const TemporaryFolder folder;
  const RunOptions options{.folder = folder.path(), .figures = false};
  RunOptions resume = options;
  resume.resume = true;
  int taken = -1;
  resume.progress = [&](const Progress& progress) {
    taken = progress.taken;
    return true;
  };
  run("", options);
  run("", resume);
  EXPECT_EQ(taken, 1);
  for (const char* file : {"meshes/point-0000/frame-0002.vtu", "meshes/point-0000.pvd"}) {
    fs::remove(folder / file);
    run("", resume);
    EXPECT_EQ(taken, 0) << file;
    EXPECT_TRUE(fs::exists(folder / file));
  }
}

TEST(Trajectory, EveryFrameIsDrawnAndTheReportPlaysThem) {
  const TemporaryFolder folder;
  const Record record = run(kTwo, {.folder = folder.path(), .point_command = {VARIFORM_TEST_CHILD, "point"}});
  EXPECT_THAT(record.warnings, ElementsAre());
  ASSERT_EQ(record.animations.size(), 1u);
  const Animation& animation = record.animations[0];
  ASSERT_EQ(animation.points.size(), 2u);
  EXPECT_EQ(animation.points[1].title, "x = 2");
  EXPECT_EQ(animation.points[1].times.size(), 4u);
  EXPECT_EQ(animation.points[1].files[3], "figures/motion/point-0001/frame-0003.png");
  const std::string report = content_of(folder / "report.html");
  EXPECT_THAT(report, HasSubstr("<input type=\"range\""));
  EXPECT_THAT(report, HasSubstr(">Play</button>"));
  EXPECT_THAT(report, HasSubstr("<option value=\"1\">x = 2</option>"));
  for (const Animation::Point& point : animation.points) {
    for (const std::string& file : point.files) {
      ASSERT_TRUE(fs::exists(folder / file)) << file;
      EXPECT_EQ(count(report, io::base64_encode(content_of(folder / file))), 1) << file;
    }
  }
  // What the page hands to its script.
  const std::size_t begin = report.find("<script type=\"application/json\">") + 32;
  const auto data = nlohmann::json::parse(report.substr(begin, report.find("</script>", begin) - begin));
  EXPECT_EQ(data[0]["times"], (std::vector<std::string>{"0", "0.1", "0.2", "0.3"}));
  EXPECT_EQ(data[1]["frames"].size(), 4u);
  const auto json = nlohmann::json::parse(content_of(folder / "record.json"));
  EXPECT_EQ(json["animations"][0]["points"][0]["files"][1], "figures/motion/point-0000/frame-0001.png");
}

TEST(Trajectory, TheReportOfOnePointHasNoChoiceAndOfManyFramesAFew) {
  const TemporaryFolder folder;
  const Record record = run("[output]\nmax_frames = 4\n", {.folder = folder.path()}, 9);
  const std::string report = content_of(folder / "report.html");
  EXPECT_THAT(report, HasSubstr("<select aria-label=\"point\" hidden>"));
  const std::size_t begin = report.find("<script type=\"application/json\">") + 32;
  const auto data = nlohmann::json::parse(report.substr(begin, report.find("</script>", begin) - begin));
  EXPECT_EQ(data[0]["times"], (std::vector<std::string>{"0", "0.3", "0.6", "0.9"}));
  EXPECT_EQ(record.animations.at(0).points.at(0).files.size(), 10u) << "all are drawn";
}

TEST(Trajectory, FiguresThatAreNotWantedAreNotDrawn) {
  const TemporaryFolder folder;
  run("[output]\nfigures = [\"deformed\"]\n", {.folder = folder / "a"});
  run("", {.folder = folder / "b", .figures = false});
  for (const char* out : {"a", "b"}) {
    EXPECT_TRUE(fs::is_empty(folder / out / "figures")) << out;
    EXPECT_THAT(content_of(folder / out / "report.html"), Not(HasSubstr("<figure")));
  }
}

TEST(Trajectory, CurvesOverTimeAreAPlotForEachValueWithACurveForEachPoint) {
  const TemporaryFolder folder;
  const Record record = run(kTwo + "[output]\nfigures = [\"curves\"]\n", {.folder = folder.path()});
  ASSERT_EQ(record.figures.size(), 1u);
  EXPECT_EQ(record.figures[0].path, "figures/curve-1-size");
  EXPECT_EQ(record.figures[0].caption, "size over time");
  const std::string script = content_of(folder / "figures/curve-1-size.gp");
  EXPECT_THAT(script, HasSubstr("x = 1"));
  EXPECT_THAT(script, HasSubstr("x = 2"));
  EXPECT_THAT(script, HasSubstr("time"));
  EXPECT_THAT(content_of(folder / "report.html"), HasSubstr("size over time"));
}

}  // namespace
}  // namespace variform
