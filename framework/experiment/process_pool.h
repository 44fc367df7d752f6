// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace variform {

/// A program to be run to its end in a process of its own. Programs are executed, not forked from this one: threads of
/// TBB and BLAS do not survive a fork.
struct ProcessJob {
  std::vector<std::string> command;  ///< path of the program, then its arguments
  std::string input = {};            ///< what it reads from standard input
};

/// How a process ended.
enum class ProcessOutcome {
  ok,             ///< exit code 0
  failed,         ///< another exit code, or the program could not be started
  crashed,        ///< killed by a signal that was not sent from here
  timed_out,      ///< killed after the time limit
  out_of_memory,  ///< killed above the memory limit, or ended with kExitOutOfMemory
  interrupted     ///< killed, or never started, because of an interrupt
};

/// "ok", "failed", "crashed", "timed_out", "out_of_memory", "interrupted".
std::string to_string(ProcessOutcome outcome);

/// A program that has no memory left (std::bad_alloc) ends with this code to be told from one that failed.
inline constexpr int kExitOutOfMemory = 12;

/// What is known of a process at its end.
struct ProcessResult {
  ProcessOutcome outcome = ProcessOutcome::interrupted;
  int exit_code = -1;         ///< -1: it did not exit by itself
  int signal = 0;             ///< that killed it; 0: none
  std::string reason = {};    ///< in words, one line; empty when ok
  std::string output = {};    ///< standard output
  std::string error = {};     ///< standard error; of long texts the end
  double wall_seconds = 0.0;  ///< from start to end
  double cpu_seconds = 0.0;   ///< user and system time of all its threads
  /// Largest resident memory. Exact above the memory of this process when it started the other; below, the largest
  /// that was seen, every few milliseconds (the system counts the image of this process before the execution).
  double peak_memory_mib = 0.0;
};

struct ProcessLimits {
  double seconds = 0.0;     ///< wall-clock time of a process; 0: no limit
  double memory_mib = 0.0;  ///< resident memory of a process; 0: no limit
};

struct ProcessPoolOptions {
  int jobs = 1;  ///< processes at a time, at least 1
  ProcessLimits limits = {};
  /// Called in this thread whenever a process has ended, with its number in the list, in the order of ends.
  std::function<void(std::size_t job, const ProcessResult& result)> finished = {};
  /// Asked every few milliseconds, for interrupts; false starts no more processes and kills those that run.
  std::function<bool()> keep_going = {};
};

/// Runs all jobs, `jobs` at a time, started in the order of the list; returns their results in that order. Blocks.
///
/// Time: at the limit a process gets SIGTERM, and SIGKILL half a second later; so do processes it started itself.
/// Memory: the resident memory is looked at every few milliseconds, and the process killed above the limit. Virtual
/// memory is no measure: sanitizers, thread stacks and BLAS reserve much of what they never touch; but a limit of
/// twice the memory and 1 GiB on private writable memory (RLIMIT_DATA; not under AddressSanitizer) lets an absurd
/// allocation fail inside the process before it starves the machine. The memory of processes that it starts itself
/// does not count.
/// An interrupt of the terminal reaches this process only; processes die with this one, even if it is killed.
///
/// Throws UsageError for jobs < 1, negative limits and empty commands.
std::vector<ProcessResult> run_processes(const std::vector<ProcessJob>& jobs, const ProcessPoolOptions& options);

/// The same for `count` jobs, each made when its turn comes.
std::vector<ProcessResult> run_processes(std::size_t count, const std::function<ProcessJob(std::size_t job)>& job,
                                         const ProcessPoolOptions& options);

/// Path of the program that runs, to run it again as a ProcessJob: the very file, even if another has taken its place.
inline constexpr const char* kThisProgram = "/proc/self/exe";

}  // namespace variform
