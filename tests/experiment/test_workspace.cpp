// SPDX-License-Identifier: BSD-3-Clause
// Unfinished work of points, and runs that go on from it.
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "framework/base/error.h"
#include "framework/experiment/runner.h"
#include "tests/experiment/row_texts.h"
#include "tests/experiment/temporary_folder.h"
#include "tests/experiment_child/trouble.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;

Config config_of(const std::string& text) { return Config::parse(text, "study.toml", fs::temp_directory_path()); }

Record run(const std::string& config, const fs::path& folder, bool resume, bool processes) {
  RunOptions options{.folder = folder, .figures = false, .resume = resume};
  if (processes) options.point_command = {VARIFORM_TEST_CHILD, "point"};
  return run_experiment(config_of(config), trouble_pipelines(), options);
}

std::string flow(const std::string& model, const std::string& rest = "[sweep]\n\"model.x\" = [1, 2]\n") {
  return "pipeline = \"trouble\"\n[model]\nwhat = \"flow\"\nx = 1\nsteps = 5\n" + model + rest;
}

std::vector<std::string> unfinished(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder / "points")) {
    if (entry.path().extension() == ".unfinished") names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

void start(const std::vector<std::string>& words, pid_t& process) {
  process = fork();
  if (process != 0) return;
  std::vector<char*> arguments;
  std::vector<std::string> copies = words;
  copies.insert(copies.begin(), VARIFORM_TEST_CHILD);
  for (std::string& word : copies) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  execv(arguments[0], arguments.data());
  _exit(127);
}

void rest(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }

TEST(Workspace, GivesBackTheBytesThatWereSavedLastUnderItsKey) {
  const TemporaryFolder folder;
  const fs::path file = folder / "work";
  const Workspace workspace(file, "key", true);
  EXPECT_EQ(workspace.load(), std::nullopt);
  std::string bytes;
  for (int i = 0; i < 1000; ++i) bytes += static_cast<char>(i);
  workspace.save("first");
  workspace.save(bytes);
  EXPECT_EQ(workspace.load(), bytes);
  EXPECT_EQ(Workspace(file, "key", true).load(), bytes);
  EXPECT_EQ(Workspace(file, "kez", true).load(), std::nullopt);
  EXPECT_EQ(Workspace(file, "key", false).load(), std::nullopt);
  workspace.save("");
  EXPECT_EQ(workspace.load(), "");
  workspace.clear();
  EXPECT_EQ(workspace.load(), std::nullopt);
  EXPECT_FALSE(fs::exists(file));
}

TEST(Workspace, PartsDoNotSeeTheWorkOfEachOther) {
  const TemporaryFolder folder;
  const Workspace whole(folder / "work", "key", true);
  whole.part("a").save("of a");
  EXPECT_EQ(whole.part("a").load(), "of a");
  EXPECT_EQ(whole.part("b").load(), std::nullopt);
  EXPECT_EQ(whole.load(), std::nullopt);
  whole.part("b").save("of b");
  EXPECT_EQ(whole.part("a").load(), "of a");
  std::ofstream(folder / "work-of-others") << "stays";
  whole.clear();
  EXPECT_EQ(whole.part("a").load(), std::nullopt);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
}

TEST(Workspace, DamageOfAnyByteIsSeen) {
  const TemporaryFolder folder;
  const fs::path file = folder / "work";
  const Workspace workspace(file, "key", true);
  workspace.save("some state\n");
  const std::string good = content_of(file);
  for (std::size_t i = 0; i < good.size(); ++i) {
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 1);
    std::ofstream(file, std::ios::binary) << bad;
    EXPECT_EQ(workspace.load(), std::nullopt) << "byte " << i;
    std::ofstream(file, std::ios::binary) << good.substr(0, i);
    EXPECT_EQ(workspace.load(), std::nullopt) << "cut at " << i;
  }
  std::ofstream(file, std::ios::binary) << good + "x";
  EXPECT_EQ(workspace.load(), std::nullopt);
  std::ofstream(file, std::ios::binary) << good;
  EXPECT_EQ(workspace.load(), "some state\n");
}

TEST(Workspace, WithoutAFileItKeepsNothing) {
  const Workspace workspace;
  workspace.save("state");
  EXPECT_EQ(workspace.load(), std::nullopt);
  EXPECT_EQ(workspace.part("a").load(), std::nullopt);
  workspace.clear();
}

TEST(Workspace, WhatCannotBeWrittenIsAnError) {
  EXPECT_THROW(Workspace("/there/is/no/such/folder/work", "key", true).save("state"), DataError);
}

TEST(Workspace, AKillLeavesAWholeState) {
  const TemporaryFolder folder;
  const fs::path file = folder / "work";
  std::set<char> seen;
  // On a busy machine the second state takes its time.
  for (int milliseconds = 0; milliseconds < 16 || (seen.size() < 2 && milliseconds < 500); ++milliseconds) {
    pid_t process = 0;
    start({"keep", file}, process);
    while (!fs::exists(file)) rest(1);
    rest(milliseconds);
    kill(process, SIGKILL);
    waitpid(process, nullptr, 0);
    const std::optional<std::string> state = Workspace(file, "key", true).load();
    ASSERT_TRUE(state) << "killed after " << milliseconds << " ms";
    ASSERT_EQ(*state, std::string(std::size_t{1} << 20, state->front()));
    seen.insert(state->front());
  }
  EXPECT_GT(seen.size(), 1u) << "all were killed before the second state";
}

TEST(Workspace, APipelineMayTakeItOrNot) {
  PipelineEntry entry;
  EXPECT_FALSE(entry.run);
  const auto result = [](double value) {
    PointResult made;
    made.metrics.set("value", value);
    return made;
  };
  entry.run = [&](const Config&) { return result(1.0); };
  EXPECT_TRUE(entry.run);
  const Config config = config_of("");
  EXPECT_EQ(to_text(*entry.run(config).metrics.find("value")), "1");
  EXPECT_EQ(to_text(*entry.run(config, Workspace()).metrics.find("value")), "1");
  const TemporaryFolder folder;
  entry.run = [&](const Config&, const Workspace& workspace) {
    workspace.save("state");
    return result(2.0);
  };
  EXPECT_EQ(to_text(*entry.run(config).metrics.find("value")), "2");
  EXPECT_TRUE(fs::is_empty(folder.path()));
  entry.run(config, Workspace(folder / "work", "key", false));
  EXPECT_TRUE(fs::exists(folder / "work"));
}

TEST(Workspace, APointThatWasKilledGoesOnFromItsLastStep) {
  const TemporaryFolder folder;
  const std::string config = flow("kill_at = 3\n");
  const Record killed = run(config, folder / "a", false, true);
  EXPECT_THAT(texts(killed, "status"), ElementsAre("crashed", "crashed"));
  EXPECT_THAT(unfinished(folder / "a"), ElementsAre("point-0000.unfinished", "point-0001.unfinished"));
  for (const bool processes : {true, false}) {
    const fs::path copy = folder / (processes ? "b" : "c");
    fs::copy(folder / "a", copy, fs::copy_options::recursive);
    const Record resumed = run(config, copy, true, processes);
    EXPECT_THAT(texts(resumed, "status"), ElementsAre("ok", "ok"));
    EXPECT_THAT(texts(resumed, "drawn"), ElementsAre("3", "3")) << "the step that it started from";
    EXPECT_THAT(texts(resumed, "E"), ElementsAre("5", "10"));
    EXPECT_THAT(unfinished(copy), ElementsAre());
  }
}

TEST(Workspace, ARunWithoutResumeStartsFromTheBegin) {
  const TemporaryFolder folder;
  run(flow("kill_at = 3\n"), folder.path(), false, true);
  std::ofstream(folder / "points/point-0007.unfinished") << "of a longer sweep";
  EXPECT_THAT(texts(run(flow("kill_at = 1\n"), folder.path(), false, true), "status"),
              ElementsAre("crashed", "crashed"));
  EXPECT_EQ(unfinished(folder.path()).size(), 2u);
  EXPECT_THAT(texts(run(flow("kill_at = 1\n"), folder.path(), true, true), "drawn"), ElementsAre("1", "1"));
}

TEST(Workspace, WorkOfAnotherConfigIsNotTaken) {
  const TemporaryFolder folder;
  run(flow("kill_at = 3\n"), folder.path(), false, true);
  EXPECT_THAT(texts(run(flow("kill_at = 6\n"), folder.path(), true, true), "drawn"), ElementsAre("0", "0"));
}

TEST(Workspace, WorkIsKeptOfPointsThatWereEndedAndNotOfThoseThatFailed) {
  const TemporaryFolder folder;
  for (const bool processes : {true, false}) {
    const fs::path out = folder / (processes ? "a" : "b");
    const Record record = run(flow("",
                                   "[sweep]\nkind = \"zip\"\n\"model.fail_at\" = [2, -1, -1, -1]\n"
                                   "\"model.no_memory_at\" = [-1, 2, -1, -1]\n\"model.odd_at\" = [-1, -1, 2, -1]\n"),
                              out, false, processes);
    EXPECT_THAT(texts(record, "status"), ElementsAre("failed", "out_of_memory", "failed", "ok"));
    EXPECT_THAT(texts(record, "reason"), ElementsAre("no step", "an allocation failed", "odd", "-"));
    EXPECT_THAT(unfinished(out), ElementsAre("point-0001.unfinished", "point-0002.unfinished"));
  }
}

TEST(Workspace, ARunThatWasKilledGoesOnInTheMiddleOfItsPoint) {
  const TemporaryFolder folder;
  const std::string config = flow("hang_at = 4\n", "");
  pid_t process = 0;
  start({"study", config, folder / "a"}, process);
  const fs::path file = folder / "a/points/point-0000.unfinished";
  for (int i = 0; i < 20000 && !content_of(file).ends_with("\n4"); ++i) rest(1);
  kill(process, SIGKILL);
  waitpid(process, nullptr, 0);
  ASSERT_TRUE(content_of(file).ends_with("\n4"));
  const Record resumed = run(config, folder / "a", true, true);
  EXPECT_THAT(texts(resumed, "drawn"), ElementsAre("4"));
  EXPECT_THAT(unfinished(folder / "a"), ElementsAre());
  // The same as without an interrupt.
  run(flow("", ""), folder / "b", false, true);
  for (const char* name : {"meshes/point-0000.pvd", "meshes/point-0000/frame-0005.vtu"}) {
    EXPECT_EQ(content_of(folder / "a" / name), content_of(folder / "b" / name));
  }
}

TEST(Workspace, APointTellsTheRunHowFarItIsAndAnInterruptKeepsItsWork) {
  const TemporaryFolder folder;
  const std::string config = flow("hang_at = 3\n", "");
  double furthest = 0.0;
  RunOptions options{.folder = folder.path(), .figures = false, .point_command = {VARIFORM_TEST_CHILD, "point"}};
  options.progress = [&](const Progress& progress) {
    furthest = std::max(furthest, progress.running);
    return furthest < 0.6;  // three steps of five; the next one would take an hour
  };
  EXPECT_TRUE(run_experiment(config_of(config), trouble_pipelines(), options).rows.empty());
  EXPECT_EQ(furthest, 0.6);
  EXPECT_THAT(texts(run(config, folder.path(), true, true), "drawn"), ElementsAre("3"));
  for (const auto& entry : fs::directory_iterator(folder / "points")) {
    EXPECT_EQ(entry.path().filename(), "point-0000.json") << "nothing else is left of a point that has ended";
  }
}

TEST(Workspace, ProgressIsAShareOfTheWholePoint) {
  const TemporaryFolder folder;
  const fs::path file = folder / "work.unfinished";
  const Workspace workspace(file, "key", false);
  EXPECT_EQ(Workspace::progress_of(file), 0.0);
  workspace.progress(0.25);
  workspace.part("a").progress(0.5);
  workspace.part("a").clear();
  EXPECT_EQ(Workspace::progress_of(file), 0.25);
  workspace.progress(7.0);
  EXPECT_EQ(Workspace::progress_of(file), 1.0);
  workspace.clear();
  EXPECT_TRUE(fs::is_empty(folder.path()));
  Workspace().progress(0.5);
}

TEST(Workspace, TrialsOfABisectionHaveTheirOwnWorkUntilThePointEnds) {
  const TemporaryFolder folder;
  const std::string config =
      flow("kill_at = 3\n", "[bisect]\nkey = \"model.x\"\nlow = 0\nhigh = 1\ntolerance = 0.5\nuntil = \"E >= 2\"\n");
  // One trial after the other is killed in its first run.
  EXPECT_THROW(run(config, folder.path(), false, true), SolverError);
  EXPECT_THROW(run(config, folder.path(), true, true), SolverError);
  EXPECT_THROW(run(config, folder.path(), true, true), SolverError);
  EXPECT_EQ(unfinished(folder.path()).size(), 3u);
  const Record record = run(config, folder.path(), true, true);
  std::vector<std::string> drawn;
  for (const Row& row : record.searches.at(0).trials.rows) drawn.push_back(to_text(*row.find("drawn")));
  EXPECT_THAT(drawn, ElementsAre("5", "5", "3"));
  EXPECT_THAT(texts(record, "bracket_high"), ElementsAre("0.5"));
  EXPECT_THAT(unfinished(folder.path()), ElementsAre());
}

}  // namespace
}  // namespace variform
