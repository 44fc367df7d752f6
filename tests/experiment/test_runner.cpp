// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <functional>
#include <limits>

#include "framework/base/error.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/runner.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

/// A pipeline without any geometry worth the name: E = a x^2 + b for the values in [model]; counts its runs.
class FakePipeline {
 public:
  Registry<PipelineEntry> registry() {
    PipelineEntry entry{.name = "fake", .doc = "for tests", .sections = {"model", "list"}};
    entry.metrics = {{{"E"}, "value"}, {{"h"}, "size"}};
    entry.figures = {"deformed", "texture"};
    entry.run = [this](const Config& config) { return run(config); };
    if (checks_) {
      entry.check = [](const Config& config) {
        config.root().at("model").accept_keys({"a", "b", "x", "name", "what"});
      };
    }
    return Registry<PipelineEntry>("pipeline", {entry});
  }

  FakePipeline& with_check() {
    checks_ = true;
    return *this;
  }
  /// Throws on the given run, counted from 1.
  FakePipeline& failing_at(int run) {
    failing_ = run;
    return *this;
  }
  int runs() const { return runs_; }

 private:
  PointResult run(const Config& config) {
    ++runs_;
    const ConfigNode model = config.root().at("model");
    if (runs_ == failing_) throw SolverError("no convergence");
    const double a = model.number_or("a", 1.0);
    const double b = model.number_or("b", 0.0);
    const double x = model.number_or("x", 1.0);
    PointResult result;
    result.metrics.set("E", a * x * x + b);
    result.metrics.set("h", x);
    result.metrics.set("positive", a > 0.0);
    result.metrics.set("run", std::int64_t{runs_});
    result.metrics.set("third", x / 3.0);
    result.metrics.set("nan", std::nan(""));
    result.metrics.set("inf", -std::numeric_limits<double>::infinity());
    result.metrics.set("nothing", Value());
    result.metrics.set("name", model.string_or("name", "none"));
    if (model.string_or("what", "mesh") == "mesh") {
      result.mesh.positions = Matrix::Zero(3, 2);
      result.mesh.positions << 0, 0, x, 0, 0, 1;
      result.mesh.cells = IndexMatrix::Zero(1, 3);
      result.mesh.cells << 0, 1, 2;
      if (model.string_or("name", "none") == "tetrahedron") {
        result.mesh.positions = Matrix::Zero(4, 3);
        result.mesh.positions.bottomRows(3).setIdentity();
        result.mesh.cells = (IndexMatrix(1, 4) << 0, 1, 2, 3).finished();
      }
      result.figures = {{.name = "deformed", .mesh = result.mesh, .cell_values = Vector::Constant(1, x)}};
      if (model.string_or("name", "none") == "surface") {
        MeshFigure figure{.name = "texture", .caption = "Texture.", .mesh = result.mesh};
        figure.mesh.positions.conservativeResize(3, 3);
        figure.mesh.positions.col(2) << 0.0, 0.5, std::nextafter(x, 9.0);
        figure.cell_values = Vector::Constant(1, std::nan(""));
        figure.scale.label = "angle";
        figure.uv = (Matrix(3, 2) << 0, 0, 1.0 / 3.0, 0, 0, x).finished();
        figure.uv_cells = (IndexMatrix(1, 3) << 2, 1, 0).finished();
        figure.check_size = 0.1;
        figure.fixed_vertices = {0};
        figure.moved_vertices = {1};
        figure.soft_vertices = {2};
        figure.flipped_cells = {0};
        figure.edges = false;
        result.figures.push_back(figure);
      }
      result.history = {{"E", {0, 1}, {2.0, 1.0}}};
    }
    // The first probe is outside of the domain.
    result.probes = Matrix::Constant(3, 2, std::nan(""));
    result.probes.row(1) << x, a;
    result.probes.row(2) << 0.0, a;
    result.probe_scale = 2.0;
    if (x < 0.0) result.warnings.push_back("negative");
    return result;
  }

  bool checks_ = false;
  int failing_ = 0;
  int runs_ = 0;
};

Config config_of(const std::string& text) {
  return Config::parse("pipeline = \"fake\"\n" + text, "study.toml", fs::temp_directory_path());
}

Record run_in(const TemporaryFolder& folder, const std::string& text, FakePipeline& pipeline, bool resume = false,
              const std::function<bool(const Progress&)>& progress = {}) {
  return run_experiment(config_of(text), pipeline.registry(),
                        {.folder = folder.path(), .figures = false, .resume = resume, .progress = progress});
}

Record run_in(const TemporaryFolder& folder, const std::string& text) {
  FakePipeline pipeline;
  return run_in(folder, text, pipeline);
}

std::string config_error(const std::string& text) {
  FakePipeline pipeline;
  try {
    check_experiment(config_of(text), pipeline.with_check().registry());
  } catch (const UsageError& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted: " << text;
  return {};
}

std::vector<double> column(const std::vector<Row>& rows, const std::string& key) {
  std::vector<double> values;
  for (const Row& row : rows) {
    const Value* value = row.find(key);
    EXPECT_NE(value, nullptr) << key;
    values.push_back(value == nullptr ? std::nan("") : to_number(*value));
  }
  return values;
}

nlohmann::json record_in(const TemporaryFolder& folder) {
  return nlohmann::json::parse(content_of(folder / "record.json"));
}

/// All rows as text, to compare tables to the last digit.
std::string table_of(const Record& record) { return Table::of(record.rows).csv(); }

const std::string kGrid = "[model]\nb = 10\n[sweep]\n\"model.x\" = [1, 2, 3]\n\"model.a\" = [0.5, 1.5]\n";

TEST(Runner, AConfigWithoutSweepIsOnePoint) {
  const TemporaryFolder folder;
  const Record record = run_in(folder, "title = \"T\"\nsource = \"S\"\n[model]\nx = 3\n");
  EXPECT_EQ(record.title, "T");
  EXPECT_EQ(record.source, "S");
  EXPECT_EQ(record.pipeline, "fake");
  EXPECT_THAT(record.swept, IsEmpty());
  EXPECT_THAT(column(record.rows, "E"), ElementsAre(9.0));
  EXPECT_TRUE(fs::exists(folder / "record.json"));
  EXPECT_TRUE(fs::exists(folder / "meshes/point-0000.obj"));
}

TEST(Runner, TheGridRunsWithTheLastKeyFastestAndSweptKeysInFront) {
  const TemporaryFolder folder;
  const Record record = run_in(folder, kGrid);
  EXPECT_THAT(record.swept, ElementsAre("model.x", "model.a"));
  EXPECT_THAT(column(record.rows, "model.x"), ElementsAre(1, 1, 2, 2, 3, 3));
  EXPECT_THAT(column(record.rows, "model.a"), ElementsAre(0.5, 1.5, 0.5, 1.5, 0.5, 1.5));
  EXPECT_THAT(column(record.rows, "E"), ElementsAre(10.5, 11.5, 12, 16, 14.5, 23.5));
  EXPECT_THAT(column(record.rows, "run"), ElementsAre(1, 2, 3, 4, 5, 6));
  for (const Row& row : record.rows) {
    EXPECT_EQ(row.entries()[0].first, "model.x");
    EXPECT_EQ(row.entries()[1].first, "model.a");
  }
  EXPECT_EQ(std::get<std::string>(*record.rows[4].find("mesh")), "meshes/point-0004.obj");
  EXPECT_TRUE(fs::exists(folder / "meshes/point-0004.obj"));

  const nlohmann::json json = record_in(folder);
  ASSERT_EQ(json["rows"].size(), 6u);
  EXPECT_EQ(json["rows"][3]["E"], 16.0);
  EXPECT_TRUE(json["rows"][3]["nan"].is_null());
}

TEST(Runner, TheConfigInTheRecordRunsToTheSameTable) {
  const TemporaryFolder folder;
  const std::string sweep =
      "[model]\n[sweep]\nmodel = [{ x = 2, a = 1 }, { x = 3, a = 2 }]\n\"model.b\" = [0, 1]\n\"model.name\" = "
      "[\"n\"]\n";
  const Record record = run_in(folder, sweep);
  FakePipeline pipeline;
  const Record again = run_experiment(Config::parse(record.config, "again.toml", folder.path()), pipeline.registry(),
                                      {.folder = folder / "again", .figures = false});
  EXPECT_EQ(table_of(again), table_of(record));
  EXPECT_THAT(column(record.rows, "E"), ElementsAre(4, 5, 18, 19));
}

TEST(Runner, NestedTablesAndIndexedKeysCanBeSwept) {
  const TemporaryFolder folder;
  const Record record =
      run_in(folder, "list = [{ v = 1 }]\n[model]\n[sweep.model]\nx = [1, 2]\n[sweep]\n\"list[0].v\" = [5, 6]\n");
  EXPECT_EQ(record.rows.size(), 4u);
  EXPECT_THAT(record.swept, Contains("model.x"));
  EXPECT_THAT(record.swept, Contains("list[0].v"));
}

TEST(Runner, BisectFindsTheThreshold) {
  const TemporaryFolder folder;
  // E = x^2 >= 2 from the square root of 2 on.
  FakePipeline pipeline;
  const Record record = run_in(folder,
                               "[model]\nx = 0\n[sweep]\n\"model.a\" = [1, 0.5]\n"
                               "[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 4\ntolerance = 1e-6\nuntil = \"E >= 2\"\n",
                               pipeline);
  EXPECT_NEAR(to_number(*record.rows[0].find("bracket_high")), std::sqrt(2.0), 1e-6);
  EXPECT_NEAR(to_number(*record.rows[1].find("bracket_high")), 2.0, 1e-6);
  for (const Row& row : record.rows) {
    const double low = to_number(*row.find("bracket_low"));
    const double high = to_number(*row.find("bracket_high"));
    EXPECT_LE(high - low, 1e-6);
    EXPECT_GE(to_number(*row.find("E")), 2.0) << "the row is that of the upper end";
    EXPECT_EQ(to_number(*row.find("h")), high);
    EXPECT_EQ(to_number(*row.find("bisect_found")), 1.0);
  }
  EXPECT_EQ(column(record.rows, "bisect_runs")[0] + column(record.rows, "bisect_runs")[1], pipeline.runs());
}

TEST(Runner, BisectSaysWhenThereIsNoThresholdAndStopsAtThePrecisionOfDoubles) {
  const TemporaryFolder folder;
  const std::string bisect = "[model]\nx = 0\n[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 1\n";
  const Record none = run_in(folder, bisect + "until = \"E >= 2\"\n");
  EXPECT_EQ(column(none.rows, "bisect_found"), std::vector<double>{0.0});
  EXPECT_THAT(none.warnings, ElementsAre(HasSubstr("no value of model.x up to 1 fulfils 'E >= 2'")));
  const Record at_once = run_in(folder, bisect + "until = \"E >= 0\"\n");
  EXPECT_EQ(column(at_once.rows, "bracket_high"), std::vector<double>{0.0});
  EXPECT_EQ(column(at_once.rows, "bisect_runs"), std::vector<double>{1.0});
  const Record fine = run_in(folder, bisect + "tolerance = 1e-300\nuntil = \"E >= 0.25\"\n");
  EXPECT_EQ(column(fine.rows, "bracket_high"), std::vector<double>{0.5});
}

TEST(Runner, CompareMeasuresProbesAgainstTheReferenceOfTheSameGroup) {
  const TemporaryFolder folder;
  const Record record = run_in(folder, kGrid + "[compare]\nreference = \"model.x == 1\"\n");
  // Probes (x, a) and (0, a): in groups of equal a the first differ by x - 1; lengths are in units of 2.
  EXPECT_THAT(column(record.rows, "map_difference"), ElementsAre(0, 0, 0.5, 0.5, 1, 1));
  EXPECT_THAT(column(record.rows, "map_difference_mean"), ElementsAre(0, 0, 0.25, 0.25, 0.5, 0.5));
  EXPECT_THAT(column(record.rows, "probe_points"), ElementsAre(2, 2, 2, 2, 2, 2));
  const Record missing = run_in(folder, kGrid + "[compare]\nreference = \"model.x == 7\"\n");
  EXPECT_TRUE(std::isnan(column(missing.rows, "map_difference")[0]));
  EXPECT_THAT(missing.warnings, ElementsAre(HasSubstr("no row fulfils 'model.x == 7'")));
}

TEST(Runner, ClaimsAreDecidedOnTheRows) {
  const TemporaryFolder folder;
  const Record record =
      run_in(folder, kGrid +
                         "[[claim]]\ntext = \"rises\"\nmetric = \"E\"\nalong = \"model.x\"\nis = \"increasing\"\n"
                         "[[claim]]\ntext = \"small\"\nmetric = \"E\"\nis = \"< 20\"\n"
                         "[[claim]]\ntext = \"near the reference\"\nmetric = \"map_difference\"\nis = \"<= 1\"\n"
                         "[[claim]]\ntext = \"of no row\"\nmetric = \"E\"\nwhere = \"h > 9\"\nis = \"< 20\"\n"
                         "[compare]\nreference = \"model.x == 1\"\n");
  std::vector<std::string> outcomes;
  for (const Verdict& verdict : record.verdicts) outcomes.push_back(to_string(verdict.outcome));
  EXPECT_THAT(outcomes, ElementsAre("holds", "fails", "holds", "undecided"));
  EXPECT_EQ(record_in(folder)["claims"][1]["outcome"], "fails");
}

TEST(Runner, AnInterruptedRunWritesWhatItHasAndDecidesNothing) {
  const TemporaryFolder folder;
  const std::string text = kGrid + "[[claim]]\ntext = \"c\"\nmetric = \"E\"\nis = \"> 0\"\n";
  FakePipeline pipeline;
  std::vector<std::pair<int, int>> calls;
  const Record record = run_in(folder, text, pipeline, false, [&](const Progress& progress) {
    calls.emplace_back(progress.done, progress.total);
    return progress.done < 2;
  });
  EXPECT_EQ(pipeline.runs(), 2);
  EXPECT_THAT(calls, ElementsAre(std::pair(0, 6), std::pair(1, 6), std::pair(2, 6), std::pair(2, 2)));
  EXPECT_THAT(record.warnings, ElementsAre("interrupted after 2 of 6 points; --resume goes on from there"));
  ASSERT_EQ(record.verdicts.size(), 1u);
  EXPECT_EQ(record.verdicts[0].outcome, Verdict::Outcome::undecided);
  const nlohmann::json json = record_in(folder);
  EXPECT_EQ(json["rows"].size(), 2u);
  EXPECT_EQ(json["claims"][0]["outcome"], "undecided");
  EXPECT_THAT(json["warnings"].dump(), HasSubstr("interrupted after 2 of 6 points"));
}

TEST(Runner, ARunInterruptedBeforeTheFirstPointIsARecordWithoutRows) {
  const TemporaryFolder folder;
  FakePipeline pipeline;
  const Record record = run_in(folder, kGrid, pipeline, false, [](const Progress&) { return false; });
  EXPECT_THAT(record.rows, IsEmpty());
  EXPECT_EQ(record_in(folder)["rows"], nlohmann::json::array());
}

TEST(Runner, ResumeTakesFinishedPointsAndGivesTheTableOfTheUninterruptedRun) {
  const TemporaryFolder folder;
  FakePipeline first;
  run_in(folder, kGrid, first, false, [](const Progress& progress) { return progress.done < 4; });
  // The process was killed while it wrote: the last point is half a file.
  const std::string whole = content_of(folder / "points/point-0003.json");
  std::ofstream(folder / "points/point-0003.json") << whole.substr(0, whole.size() / 2);

  FakePipeline second;
  const Record resumed = run_in(folder, kGrid, second, true);
  EXPECT_EQ(second.runs(), 3) << "points 0 to 2 are taken, 3 to 5 run";
  EXPECT_EQ(resumed.rows.size(), 6u);

  FakePipeline third;
  const Record complete = run_in(folder, kGrid, third, true);
  EXPECT_EQ(third.runs(), 0);
  EXPECT_EQ(table_of(complete), table_of(resumed)) << "NaN, infinities, empty values and all digits survive";

  const TemporaryFolder& same_folder = folder;
  FakePipeline fourth;
  const Record fresh = run_in(same_folder, kGrid, fourth);
  EXPECT_EQ(fourth.runs(), 6) << "nothing is taken without resume";
  for (const char* key : {"model.x", "model.a", "E", "h", "positive", "third", "inf"}) {
    EXPECT_EQ(column(fresh.rows, key), column(resumed.rows, key)) << key;
  }
}

TEST(Runner, ResumeKeepsHistoriesProbesAndWarnings) {
  const TemporaryFolder folder;
  const std::string text =
      "[model]\n[sweep]\n\"model.x\" = [-1, 2]\n[compare]\nreference = \"model.x == -1\"\n[output]\nfigures = "
      "[\"deformed\", \"history\"]\n";
  FakePipeline pipeline;
  const Registry<PipelineEntry> registry = pipeline.registry();
  const Record first = run_experiment(config_of(text), registry, {.folder = folder.path()});
  const Record second = run_experiment(config_of(text), registry, {.folder = folder.path(), .resume = true});
  EXPECT_EQ(pipeline.runs(), 2);
  EXPECT_EQ(table_of(second), table_of(first));
  EXPECT_EQ(second.warnings, first.warnings);
  EXPECT_THAT(second.warnings, Contains("x = -1: negative"));
  EXPECT_EQ(second.figures.size(), first.figures.size());
  EXPECT_TRUE(fs::exists(folder / "figures/deformed.svg"));
}

TEST(Runner, ResumeRunsPointsOfAChangedConfigAndLostMeshesAgain) {
  const TemporaryFolder folder;
  const std::string changed = "[model]\nb = 11\n[sweep]\n\"model.x\" = [1, 2, 3]\n\"model.a\" = [0.5, 1.5]\n";
  run_in(folder, kGrid);
  FakePipeline second;
  const Record record = run_in(folder, changed, second, true);
  EXPECT_EQ(second.runs(), 6);
  EXPECT_EQ(column(record.rows, "E")[0], 11.5);

  fs::remove(folder / "meshes/point-0002.obj");
  FakePipeline third;
  run_in(folder, changed, third, true);
  EXPECT_EQ(third.runs(), 1);
  EXPECT_TRUE(fs::exists(folder / "meshes/point-0002.obj"));

  // What only concerns the report does not cost a run.
  FakePipeline fourth;
  run_in(folder, changed + "[output]\ncolumns = [\"E\"]\n", fourth, true);
  EXPECT_EQ(fourth.runs(), 0);
}

TEST(Runner, TetrahedraAreWrittenAsVtuAloneAndResumed) {
  const TemporaryFolder folder;
  const std::string config = "[model]\nname = \"tetrahedron\"\n";
  const Record record = run_in(folder, config);
  EXPECT_EQ(std::get<std::string>(*record.rows[0].find("mesh")), "meshes/point-0000.mesh");
  EXPECT_EQ(read_mesh(folder / "meshes/point-0000.mesh").mesh.cells.cols(), 4);
  EXPECT_FALSE(fs::exists(folder / "meshes/point-0000.obj"));
  FakePipeline second;
  run_in(folder, config, second, true);
  EXPECT_EQ(second.runs(), 0);
  fs::remove(folder / "meshes/point-0000.vtu");
  FakePipeline third;
  run_in(folder, config, third, true);
  EXPECT_EQ(third.runs(), 1);
}

TEST(Runner, ResumeTakesAChangedBisectionForAnotherRun) {
  const TemporaryFolder folder;
  const std::string bisect = "[model]\n[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 4\nuntil = \"E >= 2\"\n";
  run_in(folder, bisect);
  FakePipeline same;
  run_in(folder, bisect, same, true);
  EXPECT_EQ(same.runs(), 0);
  FakePipeline finer;
  run_in(folder, bisect + "tolerance = 1e-8\n", finer, true);
  EXPECT_GT(finer.runs(), 0);
}

TEST(Runner, PointsWithoutMeshNameNoneAndAreResumed) {
  const TemporaryFolder folder;
  run_in(folder, "[model]\nx = 2\n");
  ASSERT_TRUE(fs::exists(folder / "meshes/point-0000.obj"));
  const std::string without = "[model]\nx = 2\nwhat = \"no mesh\"\n";
  const Record record = run_in(folder, without);
  EXPECT_EQ(record.rows[0].find("mesh"), nullptr) << "the mesh there is one of another run";
  FakePipeline resumed;
  run_in(folder, without, resumed, true);
  EXPECT_EQ(resumed.runs(), 0);
}

TEST(Runner, AFailureOfASingleRunIsThrownAndLeavesNoRecordNotEvenAnOldOne) {
  const TemporaryFolder folder;
  run_in(folder, "[model]\n");
  ASSERT_TRUE(fs::exists(folder / "record.json"));
  FakePipeline failing;
  failing.failing_at(1);
  try {
    run_in(folder, "[model]\n", failing);
    FAIL() << "no error";
  } catch (const SolverError& error) {
    EXPECT_STREQ(error.what(), "no convergence");
  }
  EXPECT_FALSE(fs::exists(folder / "record.json"));
}

TEST(Runner, AFailureInASweepIsARowAndTheOthersGoOn) {
  const TemporaryFolder folder;
  FakePipeline failing;
  failing.failing_at(4);
  const std::string claims =
      "[[claim]]\ntext = \"all\"\nmetric = \"E\"\nis = \"> 0\"\n"
      "[[claim]]\ntext = \"flags\"\nmetric = \"E\"\nwhere = \"h > 0\"\nis = \"> 0\"\n"
      "[[claim]]\ntext = \"finished\"\nmetric = \"E\"\nwhere = \"status == 'ok'\"\nis = \"> 0\"\n"
      "[[claim]]\ntext = \"small\"\nmetric = \"E\"\nwhere = \"model.a == 0.5\"\nis = \"> 0\"\n"
      "[compare]\nreference = \"model.x == 2\"\n";
  std::vector<int> failures;
  const Record record = run_in(folder, kGrid + claims, failing, false, [&](const Progress& progress) {
    failures.push_back(progress.failed);
    return true;
  });
  EXPECT_EQ(record.failure, ExitCode::solver);
  ASSERT_EQ(record.rows.size(), 6u);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(to_text(*record.rows[i].find("status")), i == 3 ? "failed" : "ok");
    EXPECT_EQ(record.rows[i].find("E") == nullptr, i == 3);
    EXPECT_EQ(record.rows[i].find("reason") != nullptr, i == 3);
  }
  EXPECT_EQ(to_text(*record.rows[3].find("reason")), "no convergence");
  EXPECT_THAT(record.warnings, ElementsAre("x = 2, a = 1.5: failed: no convergence"));
  EXPECT_THAT(failures, ElementsAre(0, 0, 0, 0, 1, 1, 1));
  std::vector<std::string> outcomes;
  for (const Verdict& verdict : record.verdicts) outcomes.push_back(to_string(verdict.outcome));
  EXPECT_THAT(outcomes, ElementsAre("undecided", "undecided", "holds", "holds"));
  EXPECT_THAT(record.verdicts[0].reason, HasSubstr("'E' is missing in a row that counts: failed: no convergence"));
  EXPECT_EQ(record.rows[3].find("map_difference"), nullptr);
  EXPECT_TRUE(std::isnan(to_number(*record.rows[1].find("map_difference")))) << "its reference failed";

  FakePipeline resumed;
  const Record again = run_in(folder, kGrid, resumed, true);
  EXPECT_EQ(resumed.runs(), 1) << "what failed is run again, and nothing else";
  EXPECT_EQ(again.failure, ExitCode::done);
  EXPECT_EQ(column(again.rows, "E")[3], 16.0);
}

TEST(Runner, AllPointsAreCheckedBeforeTheFirstRuns) {
  const TemporaryFolder folder;
  FakePipeline pipeline;
  pipeline.with_check();
  EXPECT_THROW(run_in(folder, "[model]\n[sweep]\n\"model.typo\" = [1]\n", pipeline), UsageError);
  EXPECT_THROW(run_in(folder, "[model]\n[sweep]\nmodel = [{ x = 1 }, { y = 1 }]\n", pipeline), UsageError);
  EXPECT_EQ(pipeline.runs(), 0);
  EXPECT_FALSE(fs::exists(folder / "record.json"));
  EXPECT_EQ(check_experiment(config_of(kGrid), pipeline.registry()), 6);
}

TEST(Runner, ConfigsThatMakeNoSenseAreRefusedWithTheirPlace) {
  EXPECT_THAT(config_error("[modell]\n"), StartsWith("study.toml:2: key 'modell': unknown key"));
  EXPECT_THAT(config_error("[model]\n[sweep]\n\"model.x\" = []\n"), HasSubstr("expected at least one value"));
  EXPECT_THAT(config_error("[model]\n[sweep]\n\"model.x\" = 3\n"), HasSubstr("study.toml:4: key 'sweep.model.x'"));
  EXPECT_THAT(config_error("[model]\n[sweep]\n\"modle.x\" = [1]\n"), HasSubstr("'modle.x' is in no section"));
  EXPECT_THAT(config_error("[model]\n[sweep]\n\"title\" = [\"a\"]\n"), HasSubstr("'title' is in no section"));
  EXPECT_THAT(config_error("[model]\n[sweep]\n\"list[0].v\" = [1]\n"), HasSubstr("there is no array 'list'"));
  EXPECT_THAT(config_error("[model]\n[sweep]\n\"model.x\" = [1]\n[sweep.model]\nx = [2]\n"),
              HasSubstr("'model.x' is swept already"));
  const std::string bisect = "[model]\n[bisect]\nkey = \"model.x\"\n";
  EXPECT_THAT(config_error(bisect + "low = 0\nuntil = \"E > 1\"\n"), HasSubstr("'high' is missing"));
  EXPECT_THAT(config_error(bisect + "low = 1\nhigh = 1\nuntil = \"E > 1\"\n"), HasSubstr("expected low < high"));
  EXPECT_THAT(config_error(bisect + "low = -inf\nhigh = 1\nuntil = \"E > 1\"\n"), HasSubstr("expected low < high"));
  EXPECT_THAT(config_error(bisect + "low = 0\nhigh = 1\nuntil = \"E\"\n"), HasSubstr("key 'bisect.until'"));
  EXPECT_THAT(config_error(bisect + "low = 0\nhigh = 1\ntolerance = 0\nuntil = \"E > 1\"\n"),
              HasSubstr("expected a positive number"));
  EXPECT_THAT(config_error(bisect + "low = 0\nhigh = 1\nuntil = \"E > 1\"\n[sweep]\n\"model.x\" = [1]\n"),
              HasSubstr("'model.x' is swept already"));
  EXPECT_THAT(config_error(kGrid + "[compare]\nreference = \"model.b == 1\"\n"), HasSubstr("'model.b' is not swept"));
  EXPECT_THAT(config_error(kGrid + "[compare]\nreference = \"\"\n"), HasSubstr("expected a condition"));
  EXPECT_THAT(config_error("[model]\n[[plot]]\nx = \"h\"\n"), HasSubstr("'y' is missing"));
  EXPECT_THAT(config_error("[model]\n[[plot]]\nx = \"h\"\ny = \"E\"\nname = \"../up\"\n"), HasSubstr("a file name"));
  EXPECT_THAT(config_error("[model]\n[claim]\ntext = \"not in an array\"\n"), HasSubstr("expected an array"));
  EXPECT_THAT(config_error("[model]\n[output]\nfigures = [\"map\"]\n"),
              HasSubstr("pipeline 'fake' has no figure \"map\"; expected \"deformed\", \"texture\", \"history\""));
  EXPECT_THAT(config_error("[model]\n[output]\nmax_panels = -1\n"), HasSubstr("an integer from 0 to 1000"));
  std::string many = "[model]\n[sweep]\n";
  for (const char* key : {"a", "b", "x"}) {
    many += "\"model." + std::string(key) + "\" = [0";
    for (int i = 1; i < 50; ++i) many += "," + std::to_string(i);
    many += "]\n";
  }
  EXPECT_THAT(config_error(many), HasSubstr("more than 100000 points"));
}

TEST(Runner, RatesAreThoseOfRowsThatDifferInTheSizeAlone) {
  // E = a x^2: second order in x in both groups of a, whichever key runs faster.
  for (const std::string sweep :
       {"\"model.a\" = [1, 3]\n\"model.x\" = [4, 2, 1]\n", "\"model.x\" = [4, 2, 1]\n\"model.a\" = [1, 3]\n"}) {
    const TemporaryFolder folder;
    const Record record = run_in(folder, "[model]\n[sweep]\n" + sweep + "[output]\nrates = { E = \"model.x\" }\n");
    ASSERT_EQ(record.tables.size(), 1u);
    const std::vector<Row>& rows = record.tables[0].rows;
    ASSERT_EQ(rows.size(), 6u);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Value* rate = rows[i].find("E_eoc");
      ASSERT_NE(rate, nullptr);
      if (i % 3 == 0)
        EXPECT_EQ(to_text(*rate), "") << "first of its group";
      else
        EXPECT_NEAR(to_number(*rate), 2.0, 1e-12);
    }
    EXPECT_THAT(content_of(folder / "report.html"), HasSubstr("Convergence of E with model.x"));
  }
}

TEST(Runner, RatesAgainstAMetricFollowTheOrderOfRows) {
  const TemporaryFolder folder;
  const Record record = run_in(folder, "[model]\n[sweep]\n\"model.x\" = [4, 2, 1]\n[output]\nrates = { E = \"h\" }\n");
  EXPECT_NEAR(to_number(*record.tables.at(0).rows.at(2).find("E_eoc")), 2.0, 1e-12);
}

TEST(Runner, PlotsHaveACurvePerSeriesAndAreWarningsWhereTheyCannotBeDrawn) {
  const TemporaryFolder folder;
  const std::string plots =
      "[[plot]]\nname = \"curves\"\nx = \"model.x\"\ny = \"E\"\nseries = \"model.a\"\n"
      "[[plot]]\nname = \"none\"\nx = \"model.x\"\ny = \"E\"\nwhere = \"h > 9\"\n";
  FakePipeline pipeline;
  const Record record = run_experiment(config_of(kGrid + plots), pipeline.registry(), {.folder = folder.path()});
  const std::string script = content_of(folder / "figures/curves.gp");
  EXPECT_THAT(script, HasSubstr("a = 0.5"));
  EXPECT_THAT(script, HasSubstr("a = 1.5"));
  EXPECT_THAT(script, HasSubstr("23.5"));
  EXPECT_THAT(record.warnings, Contains(HasSubstr("plot 'none': no row has both 'model.x' and 'E'")));
  EXPECT_TRUE(fs::exists(folder / "figures/deformed.png"));
  EXPECT_TRUE(fs::exists(folder / "record.json"));
}

TEST(Runner, KeysThatNoRowWillHaveAreRefusedBeforeAnythingRuns) {
  const std::string claim = "[[claim]]\ntext = \"t\"\nis = \"> 1\"\n";
  const std::string accepted =
      "accepted: swept keys: model.x, model.a; metrics of 'fake': E, h; set by the runner: status, reason, mesh";
  EXPECT_THAT(
      config_error(kGrid + claim + "metric = \"EE\"\n"),
      StartsWith("study.toml:10: key 'claim[0].metric': no row will have 'EE' (did you mean 'E'?); " + accepted));
  EXPECT_THAT(config_error(kGrid + claim + "metric = \"E\"\nwhere = \"modle.x > 1\"\n"),
              StartsWith("study.toml:11: key 'claim[0].where': no row will have 'modle.x' (did you mean 'model.x'?)"));
  EXPECT_THAT(config_error(kGrid + claim + "metric = \"E\"\nrelative_to = \"model.b == 1\"\n"),
              HasSubstr("key 'claim[0].relative_to': no row will have 'model.b'"));
  EXPECT_THAT(config_error(kGrid + claim + "metric = \"E\"\nminus = \"model.b == 1\"\n"),
              HasSubstr("key 'claim[0].minus': no row will have 'model.b'"));
  EXPECT_THAT(config_error(kGrid + "[[claim]]\ntext = \"t\"\nmetric = \"E\"\nis = \"increasing\"\nalong = \"y\"\n"),
              HasSubstr("key 'claim[0].along': no row will have 'y'; accepted"));
  EXPECT_THAT(config_error(kGrid + "[output]\ncolumns = [\"E\", \"EE\"]\n"),
              StartsWith("study.toml:8: key 'output.columns[1]': no row will have 'EE'"));
  EXPECT_THAT(config_error(kGrid + "[output]\nrates = { e = \"model.x\" }\n"), HasSubstr("no row will have 'e'"));
  EXPECT_THAT(config_error(kGrid + "[output]\nrates = { E = \"size\" }\n"), HasSubstr("no row will have 'size'"));
  for (const std::string plot :
       {"x = \"X\"\ny = \"E\"\n", "x = \"h\"\ny = \"X\"\n", "x = \"h\"\ny = \"E\"\nseries = [\"h\", \"X\"]\n",
        "x = \"h\"\ny = \"E\"\nwhere = \"h > 1 and X == 2\"\n"}) {
    EXPECT_THAT(config_error(kGrid + "[[plot]]\n" + plot), HasSubstr("no row will have 'X'"));
  }
  EXPECT_THAT(config_error("[model]\n[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 1\nuntil = \"EE > 1\"\n"),
              HasSubstr("key 'bisect.until': no row will have 'EE'"));
}

TEST(Runner, WhatTheRunnerSetsCanBeNamed) {
  FakePipeline pipeline;
  const auto claim_on = [](const std::string& metric) {
    return "[[claim]]\ntext = \"t\"\nmetric = \"" + metric + "\"\nis = \"> 1\"\n";
  };
  const std::string bisect = "[model]\n[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 1\nuntil = \"E > 1\"\n";
  for (const char* key : {"bracket_low", "bracket_high", "bisect_runs", "bisect_found"}) {
    EXPECT_EQ(check_experiment(config_of(bisect + claim_on(key)), pipeline.registry()), 1);
    EXPECT_THAT(config_error(kGrid + claim_on(key)), HasSubstr("no row will have")) << "without [bisect]";
  }
  EXPECT_THAT(config_error(kGrid + claim_on("map_difference")), HasSubstr("no row will have"));
  check_experiment(config_of(kGrid + "[compare]\nreference = \"model.x == 1\"\n" + claim_on("map_difference") +
                             claim_on("probe_points")),
                   pipeline.registry());
  check_experiment(config_of(kGrid + "[output]\nrates = { E = \"h\" }\n" + claim_on("E_eoc")), pipeline.registry());
}

TEST(Runner, ClaimsOnRatesAreDecided) {
  const TemporaryFolder folder;
  const Record record = run_in(
      folder,
      "[model]\n[sweep]\n\"model.a\" = [1, 3]\n\"model.x\" = [4, 2, 1]\n[output]\nrates = { E = \"model.x\" }\n"
      "[[claim]]\ntext = \"second order\"\nmetric = \"E_eoc\"\nwhere = \"model.x < 4\"\nis = \"in [1.99, 2.01]\"\n");
  ASSERT_EQ(record.verdicts.size(), 1u);
  EXPECT_EQ(record.verdicts[0].outcome, Verdict::Outcome::holds) << record.verdicts[0].reason;
}

TEST(Runner, APictureForEachNameWithAPanelForEachPoint) {
  const TemporaryFolder folder;
  FakePipeline pipeline;
  const std::string text = "[model]\nname = \"surface\"\n[sweep]\n\"model.x\" = [1, 2]\n";
  const auto paths = [&](const std::string& output) {
    const Record record = run_experiment(config_of(text + output), pipeline.registry(), {.folder = folder.path()});
    std::vector<std::string> found;
    for (const FigureFile& figure : record.figures) found.push_back(figure.path);
    return found;
  };
  EXPECT_THAT(paths(""), ElementsAre("figures/deformed", "figures/texture")) << "all that the pipeline offers";
  EXPECT_THAT(paths("[output]\nfigures = [\"texture\"]\n"), ElementsAre("figures/texture"));
  EXPECT_THAT(paths("[output]\nfigures = []\n"), IsEmpty());
  EXPECT_TRUE(fs::exists(folder / "figures/texture.png"));
  const std::string report = content_of(folder / "report.html");
  EXPECT_THAT(report, testing::Not(HasSubstr("viewer-data")));

  const Record record = run_experiment(config_of(text + "[output.camera]\ndirection = [0, 0, 1]\nup = [0, 1, 0]\n"),
                                       pipeline.registry(), {.folder = folder.path()});
  ASSERT_EQ(record.spatial.size(), 2u);
  EXPECT_EQ(record.spatial[1].title, "x = 2, 1 flipped");
  EXPECT_EQ(record.camera.direction, Eigen::Vector3d(0, 0, 1));
  EXPECT_THAT(record.figures[1].caption,
              "Texture. Squares: fixed vertices; discs: moved ones; open circles: soft constraints; red outlines: "
              "flipped cells.");
}

TEST(Runner, CamerasThatMakeNoSenseAreRefused) {
  const std::string camera = "[model]\n[output.camera]\n";
  EXPECT_THAT(config_error(camera + "direction = [0, 1]\n"), HasSubstr("expected three numbers"));
  EXPECT_THAT(config_error(camera + "direction = [0, 0, 1]\nup = [0, 0, 2]\n"), HasSubstr("two different directions"));
  EXPECT_THAT(config_error(camera + "zoom = 0\n"), HasSubstr("zoom > 0"));
  EXPECT_THAT(config_error(camera + "projection = \"isometric\"\n"), HasSubstr("\"orthographic\" or \"perspective\""));
  EXPECT_THAT(config_error(camera + "eye = [0, 0, 1]\n"), HasSubstr("unknown key"));
}

TEST(Runner, SearchesAreRecordedTabledAndPlotted) {
  const TemporaryFolder folder;
  const std::string text =
      "[model]\nx = 0\n[sweep]\n\"model.a\" = [1, 0.5]\n"
      "[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 4\ntolerance = 0.5\nuntil = \"E >= 2\"\n";
  FakePipeline pipeline;
  const Record record = run_experiment(config_of(text), pipeline.registry(), {.folder = folder.path()});
  const nlohmann::json searches = record_in(folder)["searches"];
  ASSERT_EQ(searches.size(), 2u);
  EXPECT_EQ(searches[0]["point"], "a = 1");
  EXPECT_EQ(searches[0]["key"], "model.x");
  EXPECT_EQ(searches[0]["found"], true);
  EXPECT_EQ(searches[0]["value"], 1.5);
  EXPECT_EQ(searches[0]["bracket_low"], 1.0);
  EXPECT_EQ(searches[0]["metrics"], nlohmann::json::array({"E"}));
  // 0, 4, 2, 1, 1.5: the trials in their order.
  ASSERT_EQ(searches[0]["trials"].size(), 5u);
  EXPECT_EQ(searches[0]["trials"][2], (nlohmann::json{{"model.x", 2.0},
                                                      {"asked", "bisect"},
                                                      {"held", true},
                                                      {"E", 4.0},
                                                      {"h", 2.0},
                                                      {"positive", true},
                                                      {"run", 3},
                                                      {"third", 2.0 / 3.0},
                                                      {"nan", nullptr},
                                                      {"inf", nullptr},
                                                      {"nothing", nullptr},
                                                      {"name", "none"}}));
  ASSERT_EQ(record.tables.size(), 2u);
  EXPECT_THAT(content_of(folder / "report.html"), HasSubstr("Search: smallest model.x with E &gt;= 2, a = 1<"));
  const std::string script = content_of(folder / "figures/search-1.gp");
  EXPECT_THAT(script, HasSubstr("0 0\n1 1\n1.5 2.25\n2 4\n4 16\n"));
  EXPECT_THAT(script, HasSubstr("set arrow from first 1.5, graph 0"));

  // Finished points keep their searches.
  FakePipeline resumed;
  const Record again = run_experiment(config_of(text), resumed.registry(), {.folder = folder.path(), .resume = true});
  EXPECT_EQ(resumed.runs(), 0);
  EXPECT_EQ(record_in(folder)["searches"], searches);
}

TEST(Runner, TheFigureShowsNoMoreThanMaxPanels) {
  const TemporaryFolder folder;
  FakePipeline pipeline;
  const Record record =
      run_experiment(config_of(kGrid + "[output]\nmax_panels = 2\n"), pipeline.registry(), {.folder = folder.path()});
  EXPECT_THAT(record.warnings, ElementsAre(HasSubstr("figure 'deformed' shows the first 2 results only")));
}

TEST(Runner, AFolderThatCannotBeMadeIsADataError) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "in the way";
  FakePipeline pipeline;
  EXPECT_THROW(run_experiment(config_of("[model]\n"), pipeline.registry(), {.folder = folder / "file/out"}), DataError);
  EXPECT_EQ(pipeline.runs(), 0);
}

}  // namespace
}  // namespace variform
