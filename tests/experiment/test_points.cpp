// SPDX-License-Identifier: BSD-3-Clause
// Points in processes of their own.
#include <gmock/gmock.h>

#include <algorithm>
#include <regex>
#include <set>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/experiment/folder_lock.h"
#include "framework/experiment/runner.h"
#include "tests/experiment/row_texts.h"
#include "tests/experiment/temporary_folder.h"
#include "tests/experiment_child/trouble.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

Config config_of(const std::string& text) {
  return Config::parse("pipeline = \"trouble\"\n" + text, "study.toml", fs::temp_directory_path());
}

RunOptions in_processes(const fs::path& folder, int jobs = 2) {
  return {.folder = folder, .figures = false, .point_command = {VARIFORM_TEST_CHILD, "point"}, .jobs = jobs};
}

std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.insert(fs::relative(entry.path(), folder).string());
  }
  return files;
}

const std::string kSweep =
    "[model]\n[sweep]\n\"model.x\" = [-1, 0.1, 3, 4, 5]\n[compare]\nreference = \"model.x == 3\"\n";

TEST(Points, InProcessesOneOrManyTheyGiveTheTableOfThisProcess) {
  const TemporaryFolder folder;
  const Record here =
      run_experiment(config_of(kSweep), trouble_pipelines(), {.folder = folder / "0", .figures = false});
  for (const int jobs : {1, 3}) {
    const std::string out = std::to_string(jobs);
    const Record record = run_experiment(config_of(kSweep), trouble_pipelines(), in_processes(folder / out, jobs));
    EXPECT_EQ(content_of(folder / (out + "/table.csv")), content_of(folder / "0/table.csv"));
    EXPECT_EQ(record.warnings, here.warnings);
    EXPECT_EQ(files_in(folder / out), files_in(folder / "0"));
    EXPECT_EQ(content_of(folder / (out + "/points/point-0001.json")), content_of(folder / "0/points/point-0001.json"));
  }
  EXPECT_THAT(here.warnings, ElementsAre("x = -1: negative"));
}

TEST(Points, PointsThatCrashHangOrTakeAllMemoryAreRowsAndTheOthersFinish) {
  const TemporaryFolder folder;
  RunOptions options = in_processes(folder.path());
  options.limits = {.seconds = 2.0, .memory_mib = 300.0};
  int failed = 0;
  options.progress = [&](const Progress& progress) {
    failed = progress.failed;
    return true;
  };
  const Record record = run_experiment(
      config_of("[model]\nx = 2\n[sweep]\n\"model.what\" = [\"work\", \"throw\", \"abort\", \"hang\", \"hog\", "
                "\"bad_alloc\", \"vanish\", \"work \"]\n[[claim]]\ntext = \"c\"\nmetric = \"E\"\nis = \"== 4\"\n"),
      trouble_pipelines(), options);
  EXPECT_THAT(texts(record, "status"),
              ElementsAre("ok", "failed", "crashed", "timed_out", "out_of_memory", "out_of_memory", "failed", "ok"));
  EXPECT_THAT(texts(record, "E"), ElementsAre("4", "-", "-", "-", "-", "-", "-", "4"));
  const std::vector<std::string> reasons = texts(record, "reason");
  EXPECT_EQ(reasons[1], "broken data");
  EXPECT_THAT(reasons[2], HasSubstr("signal 6"));
  EXPECT_EQ(reasons[3], "more than 2 s");
  EXPECT_EQ(reasons[4], "more than 300 MiB");
  EXPECT_EQ(reasons[5], "an allocation failed");
  EXPECT_THAT(reasons[6], HasSubstr("its files are not there"));
  EXPECT_EQ(failed, 6);
  EXPECT_EQ(record.failure, ExitCode::solver);
  EXPECT_EQ(record.warnings.size(), 6u);
  EXPECT_EQ(record.verdicts[0].outcome, Verdict::Outcome::undecided);
}

TEST(Points, TheFailureOfASingleRunIsThrownAsInThisProcess) {
  const TemporaryFolder folder;
  const auto run = [&](const std::string& what) {
    run_experiment(config_of("[model]\nx = 2\nwhat = \"" + what + "\"\n"), trouble_pipelines(),
                   in_processes(folder.path()));
  };
  try {
    run("throw");
    ADD_FAILURE() << "no error";
  } catch (const DataError& error) {
    EXPECT_STREQ(error.what(), "broken data");
  }
  try {
    run("abort");
    ADD_FAILURE() << "no error";
  } catch (const SolverError& error) {
    EXPECT_THAT(error.what(), HasSubstr("crashed: killed by signal 6"));
  }
}

TEST(Points, MessagesNameTheLineOfTheConfigAsInThisProcess) {
  const TemporaryFolder folder;
  try {
    run_experiment(config_of("[model]\nx = \"two\"\n"), trouble_pipelines(), in_processes(folder.path()));
    ADD_FAILURE() << "no error";
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(), "study.toml:3: key 'model.x': expected a number, got \"two\"");
  }
}

TEST(Points, AnInterruptGivesUpPointsInFlightAtOnce) {
  const TemporaryFolder folder;
  RunOptions options = in_processes(folder.path(), 3);
  const Stopwatch watch;
  options.progress = [&](const Progress& progress) { return progress.done < 2; };
  const Config config =
      config_of("[model]\n[sweep]\nmodel = [{ x = 1 }, { what = \"hang\" }, { x = 2 }, { x = 3, what = \"hang\" }]\n");
  const Record record = run_experiment(config, trouble_pipelines(), options);
  EXPECT_LT(watch.seconds(), 60.0) << "the hanging point would take an hour";
  EXPECT_THAT(texts(record, "E"), ElementsAre("1", "4")) << "finished ones, in their order";
  EXPECT_EQ(record.warnings[0], "interrupted after 2 of 4 points; --resume goes on from there");
  EXPECT_EQ(record.failure, ExitCode::done);
}

TEST(Points, SeedsOfPointsAreGivenToTheConfigAndRecorded) {
  const TemporaryFolder folder;
  const std::string text =
      "[model]\n[sweep]\nkind = \"random\"\nsamples = 4\nseed = 3\nseed_key = \"model.seed\"\n"
      "\"model.x\" = { min = 0, max = 1 }\n";
  const Record record = run_experiment(config_of(text), trouble_pipelines(), in_processes(folder / "a"));
  EXPECT_THAT(record.swept, ElementsAre("model.x"));
  const std::vector<std::string> seeds = texts(record, "seed");
  EXPECT_EQ(texts(record, "drawn"), seeds);
  EXPECT_EQ(std::set<std::string>(seeds.begin(), seeds.end()).size(), 4u);
  const Record again = run_experiment(config_of(text), trouble_pipelines(), {.folder = folder / "b", .figures = false});
  EXPECT_EQ(Table::of(again.rows).csv(), Table::of(record.rows).csv());
}

TEST(Points, PivotsOfTheConfigAreTablesOfTheReport) {
  const TemporaryFolder folder;
  const Record record = run_experiment(
      config_of(
          "[model]\n[sweep]\n\"model.x\" = [1, 2]\n\"model.what\" = [\"work\", \"also\"]\n[[output.pivot]]\nrows = "
          "\"model.x\"\ncolumns = \"model.what\"\nvalue = \"E\"\n[[output.pivot]]\nrows = \"model.x\"\nvalue = "
          "\"E\"\n"),
      trouble_pipelines(), {.folder = folder.path(), .figures = false});
  ASSERT_EQ(record.tables.size(), 1u);
  EXPECT_EQ(record.tables[0].csv(), "model.x,model.what = work,model.what = also\r\n1,1,1\r\n2,4,4\r\n");
  EXPECT_THAT(content_of(folder / "report.html"), HasSubstr("<th class=\"number\">also</th>"));
  EXPECT_THAT(record.warnings, ElementsAre(HasSubstr("output.pivot of 'E': 2 rows for model.x = 1")));
}

TEST(Points, ARunKeepsOthersOutOfItsFolder) {
  const TemporaryFolder folder;
  {
    const FolderLock lock(folder.path());
    try {
      run_experiment(config_of(kSweep), trouble_pipelines(), {.folder = folder.path()});
      ADD_FAILURE() << "no error";
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("another run (process " + std::to_string(getpid()) + ") is writing"));
    }
    EXPECT_FALSE(fs::exists(folder / "record.json"));
  }
  run_experiment(config_of(kSweep), trouble_pipelines(), {.folder = folder.path(), .figures = false});
  EXPECT_TRUE(fs::exists(folder / "record.json"));
}

TEST(Points, WhatKilledWritersLeftIsRemoved) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "meshes");
  for (const char* name : {"record.json.0123abcd.tmp", "meshes/point-0000.obj.ffffffff.tmp", "notes.tmp"}) {
    std::ofstream(folder / name) << "half a fi";
  }
  run_experiment(config_of(kSweep), trouble_pipelines(), {.folder = folder.path(), .figures = false});
  const std::set<std::string> files = files_in(folder.path());
  EXPECT_EQ(std::count_if(files.begin(), files.end(),
                          [](const std::string& file) { return fs::path(file).extension() == ".tmp"; }),
            1);
  EXPECT_TRUE(files.count("notes.tmp") > 0) << "files of others stay";
}

TEST(Points, ARequestThatIsNoneIsRefused) {
  EXPECT_THROW(run_point_request("", trouble_pipelines()), UsageError);
  EXPECT_THROW(run_point_request("{\"point\": 3}", trouble_pipelines()), UsageError);
}

}  // namespace
}  // namespace variform
