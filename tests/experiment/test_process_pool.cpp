// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/experiment/process_pool.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

ProcessJob child(std::vector<std::string> words, const std::string& input = {}) {
  words.insert(words.begin(), VARIFORM_TEST_CHILD);
  return {words, input};
}

ProcessResult result_of(const ProcessJob& job, const ProcessLimits& limits = {}) {
  return run_processes({job}, {.limits = limits}).front();
}

/// False for processes that have ended, whether or not anybody has asked for their exit code.
bool is_alive(pid_t process) {
  const std::string status = content_of("/proc/" + std::to_string(process) + "/status");
  return !status.empty() && status.find("State:\tZ") == std::string::npos;
}

TEST(ProcessPool, AProcessReadsItsInputAndItsOutputIsKept) {
  std::string input = "a\n";
  for (int i = 0; i < 20; ++i) input += input;  // far more than a pipe holds
  const ProcessResult result = result_of(child({"echo"}, input));
  EXPECT_EQ(result.outcome, ProcessOutcome::ok) << result.reason;
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_TRUE(result.output == input);
  EXPECT_EQ(result.reason, "");
}

TEST(ProcessPool, AFailureHasItsCodeAndTheErrorThatItTold) {
  const ProcessResult result = result_of(child({"exit", "3"}));
  EXPECT_EQ(result.outcome, ProcessOutcome::failed);
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_EQ(result.reason, "exit 3 as asked");
  EXPECT_THAT(result.error, HasSubstr("more noise"));
}

TEST(ProcessPool, EndsAreSeenWhereSignalsOfChildrenAreIgnored) {
  const auto before = std::signal(SIGCHLD, SIG_IGN);
  alarm(30);  // instead of waiting for ever
  const ProcessResult result = result_of(child({"exit", "3"}));
  alarm(0);
  EXPECT_EQ(std::signal(SIGCHLD, before), SIG_IGN);
  EXPECT_EQ(result.outcome, ProcessOutcome::failed);
  EXPECT_EQ(result.exit_code, 3);
}

TEST(ProcessPool, AProgramThatIsNotThereIsAFailure) {
  const ProcessResult result = result_of({{"/there/is/no/such/program"}});
  EXPECT_EQ(result.outcome, ProcessOutcome::failed);
  EXPECT_EQ(result.reason, "/there/is/no/such/program: cannot be started: No such file or directory");
}

TEST(ProcessPool, ACrashHasItsSignal) {
  const ProcessResult result = result_of(child({"abort"}));
  EXPECT_EQ(result.outcome, ProcessOutcome::crashed);
  EXPECT_EQ(result.signal, SIGABRT);
  EXPECT_THAT(result.reason, HasSubstr("signal 6"));
}

TEST(ProcessPool, TheTimeLimitEndsProcessesEvenThoseThatIgnoreTheRequest) {
  // Long enough for the child to begin to ignore it, on a busy machine and with sanitizers, too.
  for (const char* what : {"rest", "ignore"}) {
    const ProcessResult result = result_of(child({what, "60"}), {.seconds = 1.0});
    EXPECT_EQ(result.outcome, ProcessOutcome::timed_out) << what;
    EXPECT_EQ(result.signal, std::string(what) == "rest" ? SIGTERM : SIGKILL);
    EXPECT_GE(result.wall_seconds, 1.0);
    EXPECT_EQ(result.reason, "more than 1 s");
  }
}

TEST(ProcessPool, TheMemoryLimitEndsAHogAndNobodyElse) {
  const std::vector<ProcessResult> results =
      run_processes({child({"hog", "4000"}), child({"hog", "32"})}, {.jobs = 2, .limits = {.memory_mib = 200.0}});
  EXPECT_EQ(results[0].outcome, ProcessOutcome::out_of_memory);
  EXPECT_EQ(results[0].reason, "more than 200 MiB");
  EXPECT_GT(results[0].peak_memory_mib, 200.0);
  EXPECT_EQ(results[0].signal, SIGKILL);
  EXPECT_EQ(results[1].outcome, ProcessOutcome::ok) << results[1].reason;
}

TEST(ProcessPool, AProcessThatSaysItHasNoMemoryIsBelieved) {
  const ProcessResult result = result_of(child({"bad_alloc"}));
  EXPECT_EQ(result.outcome, ProcessOutcome::out_of_memory);
  EXPECT_EQ(result.exit_code, kExitOutOfMemory);
}

TEST(ProcessPool, TheMemoryOfThisProcessDoesNotCount) {
  std::vector<char> much(std::size_t{300} << 20, 1);
  const ProcessResult result = result_of(child({"hog", "32", "1"}), {.memory_mib = 200.0});
  EXPECT_EQ(result.outcome, ProcessOutcome::ok) << result.reason;
  EXPECT_GT(result.peak_memory_mib, 32.0);
  EXPECT_LT(result.peak_memory_mib, 200.0);
  EXPECT_EQ(much.back(), 1);
}

TEST(ProcessPool, TimesAreThoseOfTheProcess) {
  const ProcessResult works = result_of(child({"work", "0.2"}));
  EXPECT_GE(works.wall_seconds, 0.2);
  EXPECT_GT(works.cpu_seconds, 0.0);
  const ProcessResult rests = result_of(child({"rest", "0.2"}));
  EXPECT_GE(rests.wall_seconds, 0.2);
  EXPECT_LT(rests.cpu_seconds, 0.2);
}

TEST(ProcessPool, ProcessesRunSideBySide) {
  const TemporaryFolder folder;
  const auto meet = [&](const char* own, const char* other) { return child({"meet", folder / own, folder / other}); };
  const std::vector<ProcessResult> results =
      run_processes({meet("a", "b"), meet("b", "a")}, {.jobs = 2, .limits = {.seconds = 60.0}});
  EXPECT_EQ(results[0].outcome, ProcessOutcome::ok);
  EXPECT_EQ(results[1].outcome, ProcessOutcome::ok);
}

TEST(ProcessPool, NoMoreThanTheJobsRunAtATimeAndAllAreToldOnce) {
  std::vector<ProcessJob> jobs;
  for (const char* seconds : {"0.1", "0", "0.05", "0"}) jobs.push_back(child({"rest", seconds}));
  std::vector<std::size_t> ends;
  const auto tell = [&](std::size_t job, const ProcessResult&) { ends.push_back(job); };
  run_processes(jobs, {.jobs = 3, .finished = tell});
  EXPECT_THAT(ends, UnorderedElementsAre(0, 1, 2, 3));
  ends.clear();
  run_processes(jobs, {.jobs = 1, .finished = tell});
  EXPECT_THAT(ends, ElementsAre(0, 1, 2, 3));
}

TEST(ProcessPool, AnInterruptEndsWhatRunsAndStartsNoMore) {
  int ended = 0;
  const std::vector<ProcessResult> results =
      run_processes({child({"exit", "0"}), child({"rest", "60"}), child({"rest", "60"})},
                    {.jobs = 1,
                     .finished = [&](std::size_t, const ProcessResult&) { ++ended; },
                     .keep_going = [&] { return ended == 0; }});
  EXPECT_EQ(results[0].outcome, ProcessOutcome::ok);
  EXPECT_EQ(results[1].outcome, ProcessOutcome::interrupted);
  EXPECT_EQ(results[2].outcome, ProcessOutcome::interrupted);
  EXPECT_EQ(ended, 1) << "what never ran has no end";

  const Stopwatch watch;
  const std::vector<ProcessResult> running =
      run_processes({child({"rest", "60"})}, {.keep_going = [&] { return watch.seconds() < 0.1; }});
  EXPECT_EQ(running[0].outcome, ProcessOutcome::interrupted);
  EXPECT_EQ(running[0].signal, SIGTERM);
}

TEST(ProcessPool, WhatAProcessStartedEndsWithIt) {
  const ProcessResult result = result_of(child({"parent", "60"}), {.seconds = 0.3});
  EXPECT_EQ(result.outcome, ProcessOutcome::timed_out);
  ASSERT_NE(result.output, "");
  const pid_t grandchild = std::stoi(result.output);
  // It is gone as soon as the system has reaped it.
  for (int i = 0; i < 1000 && is_alive(grandchild); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_FALSE(is_alive(grandchild));
}

TEST(ProcessPool, ProcessesDieWithTheirParentHoweverItDies) {
  const TemporaryFolder folder;
  const fs::path file = folder / "child";
  const pid_t parent = fork();
  if (parent == 0) {
    execl(VARIFORM_TEST_CHILD, VARIFORM_TEST_CHILD, "pool", file.c_str(), nullptr);
    _exit(127);
  }
  for (int i = 0; i < 10000 && !fs::exists(file); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  ASSERT_TRUE(fs::exists(file));
  const pid_t process = std::stoi(content_of(file));
  EXPECT_TRUE(is_alive(process));
  kill(parent, SIGKILL);
  waitpid(parent, nullptr, 0);
  for (int i = 0; i < 1000 && is_alive(process); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_FALSE(is_alive(process));
}

TEST(ProcessPool, JobsAreMadeWhenTheirTurnComes) {
  std::vector<std::string> events;
  run_processes(2,
                [&](std::size_t job) {
                  events.push_back("made " + std::to_string(job));
                  return child({"exit", "0"});
                },
                {.jobs = 1, .finished = [&](std::size_t job, const ProcessResult&) {
                   events.push_back("ended " + std::to_string(job));
                 }});
  EXPECT_THAT(events, ElementsAre("made 0", "ended 0", "made 1", "ended 1"));
}

TEST(ProcessPool, WhatMakesNoSenseIsRefused) {
  EXPECT_THROW(run_processes({}, {.jobs = 0}), UsageError);
  EXPECT_THROW(run_processes({}, {.limits = {.seconds = -1.0}}), UsageError);
  EXPECT_THROW(run_processes({ProcessJob{}}, {}), UsageError);
  EXPECT_TRUE(run_processes({}, {}).empty());
}

}  // namespace
}  // namespace variform
