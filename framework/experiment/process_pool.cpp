// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/process_pool.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <list>
#include <string_view>
#include <thread>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"

namespace variform {
namespace {

constexpr auto kPause = std::chrono::milliseconds(2);
constexpr double kGrace = 0.5;  // seconds from SIGTERM to SIGKILL
constexpr off_t kMostErrorText = 1 << 16;

#if defined(__SANITIZE_ADDRESS__)
constexpr bool kLimitsData = false;  // the shadow memory alone is terabytes
#else
constexpr bool kLimitsData = true;
#endif

// A file without a name, in memory: holds what a process reads and writes, however much, so that nobody waits for a
// pipe to be emptied.
class MemoryFile {
 public:
  explicit MemoryFile(const std::string& content = {}) : descriptor_(memfd_create("variform", MFD_CLOEXEC)) {
    if (descriptor_ < 0) fail();
    for (std::size_t done = 0; done < content.size();) {
      const ssize_t written = write(descriptor_, content.data() + done, content.size() - done);
      if (written < 0 && errno != EINTR) {
        const int error = errno;
        close(descriptor_);
        errno = error;
        fail();
      }
      if (written > 0) done += static_cast<std::size_t>(written);
    }
    lseek(descriptor_, 0, SEEK_SET);
  }
  ~MemoryFile() {
    if (descriptor_ >= 0) close(descriptor_);
  }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  int descriptor() const { return descriptor_; }

  /// The end of the content.
  std::string content(off_t most) const {
    const off_t size = lseek(descriptor_, 0, SEEK_END);
    off_t at = std::max<off_t>(0, size - most);
    std::string text(static_cast<std::size_t>(std::max<off_t>(0, size - at)), '\0');
    std::size_t done = 0;
    while (done < text.size()) {
      const ssize_t count = pread(descriptor_, text.data() + done, text.size() - done, at);
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) break;
      done += static_cast<std::size_t>(count);
      at += count;
    }
    text.resize(done);
    return text;
  }

 private:
  [[noreturn]] static void fail() {
    throw DataError(fmt::format("no memory file for a process: {}", std::strerror(errno)));
  }

  int descriptor_;
};

// Only calls that are safe between fork and exec of a program with threads: no memory is taken, no lock. What keeps the
// program from being executed is written to `failure`, which the execution closes.
[[noreturn]] void execute(char* const* arguments, int input, int output, int error, int failure, pid_t parent,
                          rlim_t data_limit) {
  setpgid(0, 0);  // a group of its own: out of reach of the terminal's interrupt, and killed as a whole
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);  // it died before the line above
  struct sigaction standard {};
  standard.sa_handler = SIG_DFL;
  for (const int signal : {SIGINT, SIGTERM, SIGPIPE}) sigaction(signal, &standard, nullptr);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  if (data_limit > 0) {
    rlimit limit{};
    getrlimit(RLIMIT_DATA, &limit);
    limit.rlim_cur = std::min(limit.rlim_max, data_limit);
    setrlimit(RLIMIT_DATA, &limit);
  }
  dup2(input, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(error, STDERR_FILENO);
  execv(arguments[0], arguments);
  const int reason = errno;
  if (write(failure, &reason, sizeof(reason)) < 0) _exit(2);
  _exit(1);
}

// Lines such as "VmHWM:    1234 kB" of /proc/PID/status; 0 where there is none.
double status_mib(pid_t process, const char* name) {
  std::ifstream status(fmt::format("/proc/{}/status", process));
  const std::string wanted = fmt::format("{}:", name);
  std::string line;
  while (std::getline(status, line)) {
    if (line.rfind(wanted, 0) == 0) return std::strtod(line.c_str() + wanted.size(), nullptr) / 1024.0;
  }
  return 0.0;
}

// The last line that says "error: ...", else the last line with anything in it.
std::string told_reason(const std::string& text) {
  std::string last;
  std::string told;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string line = text.substr(begin, end - begin);
    begin = end + 1;
    constexpr std::string_view kMark = "error: ";
    if (line.rfind(kMark, 0) == 0) told = line.substr(kMark.size());
    if (line.find_first_not_of(" \t\r") != std::string::npos) last = line;
  }
  return told.empty() ? last : told;
}

// Where SIGCHLD is ignored, which a program may have inherited, the system reaps processes by itself: how they ended is
// lost, and whoever waits to see them end waits for ever.
class ChildrenAreKept {
 public:
  ChildrenAreKept() {
    struct sigaction standard {};
    standard.sa_handler = SIG_DFL;
    sigaction(SIGCHLD, nullptr, &before_);
    if (before_.sa_handler == SIG_IGN || (before_.sa_flags & SA_NOCLDWAIT) != 0) {
      sigaction(SIGCHLD, &standard, nullptr);
    }
  }
  ~ChildrenAreKept() { sigaction(SIGCHLD, &before_, nullptr); }
  ChildrenAreKept(const ChildrenAreKept&) = delete;
  ChildrenAreKept& operator=(const ChildrenAreKept&) = delete;

 private:
  struct sigaction before_ {};
};

// A process that runs.
class Process {
 public:
  Process(std::size_t number, const ProcessJob& job, const ProcessLimits& limits)
      : number_(number), limits_(limits), input_(job.input), memory_of_parent_(status_mib(getpid(), "VmRSS")) {
    std::vector<std::string> words = job.command;
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    rlim_t data_limit = 0;
    if (kLimitsData && limits.memory_mib > 0.0) {
      data_limit = static_cast<rlim_t>((2.0 * limits.memory_mib + 1024.0) * 1048576.0);
    }
    int failure[2];
    if (pipe2(failure, O_CLOEXEC) != 0) throw DataError(fmt::format("no pipe for a process: {}", std::strerror(errno)));
    const pid_t parent = getpid();
    id_ = fork();
    if (id_ == 0) {
      execute(arguments.data(), input_.descriptor(), output_.descriptor(), error_.descriptor(), failure[1], parent,
              data_limit);
    }
    int error = errno;
    close(failure[1]);
    if (id_ > 0) {
      error = 0;
      // Until the program is executed, the process is an image of this one, with its memory.
      while (read(failure[0], &error, sizeof(error)) < 0 && errno == EINTR) {
      }
    }
    close(failure[0]);
    if (error == 0) return;
    kill_and_reap();
    result_.outcome = ProcessOutcome::failed;
    result_.reason = fmt::format("{}: cannot be started: {}", job.command.front(), std::strerror(error));
  }
  ~Process() { kill_and_reap(); }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  std::size_t number() const { return number_; }
  const ProcessResult& result() const { return result_; }

  /// Asks it to end; has_ended kills it if it does not within the grace.
  void end(ProcessOutcome why, int signal = SIGTERM) {
    if (id_ <= 0 || is_asked_) return;
    is_asked_ = true;
    asked_at_ = watch_.seconds();
    result_.outcome = why;
    kill(-id_, signal);
  }

  /// Looks after its limits; true when it has ended and the result is complete.
  bool has_ended() {
    if (id_ <= 0) return true;
    siginfo_t info{};
    if (waitid(P_PID, static_cast<id_t>(id_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid == id_) {
      finish();
      return true;
    }
    if (const double peak = status_mib(id_, "VmHWM"); peak > 0.0) result_.peak_memory_mib = peak;
    if (limits_.memory_mib > 0.0 && result_.peak_memory_mib > limits_.memory_mib) {
      end(ProcessOutcome::out_of_memory, SIGKILL);  // a moment of grace would take more
    }
    if (limits_.seconds > 0.0 && watch_.seconds() > limits_.seconds) end(ProcessOutcome::timed_out);
    if (is_asked_ && watch_.seconds() > asked_at_ + kGrace) kill(-id_, SIGKILL);
    return false;
  }

 private:
  void kill_and_reap() {
    if (id_ <= 0) return;
    kill(-id_, SIGKILL);
    kill(id_, SIGKILL);  // it may not have made its group yet
    while (waitpid(id_, nullptr, 0) < 0 && errno == EINTR) {
    }
    id_ = -1;
  }

  void finish() {
    result_.wall_seconds = watch_.seconds();
    kill(-id_, SIGKILL);  // what it may have started itself; as long as it is not reaped, the group is its own
    int status = 0;
    rusage usage{};
    while (wait4(id_, &status, 0, &usage) < 0 && errno == EINTR) {
    }
    id_ = -1;
    const auto seconds = [](const timeval& time) {
      return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    };
    result_.cpu_seconds = seconds(usage.ru_utime) + seconds(usage.ru_stime);
    // The system counts the image of this process before the execution, too; above it the number is that of the
    // program.
    const double peak = static_cast<double>(usage.ru_maxrss) / 1024.0;
    if (peak > memory_of_parent_) result_.peak_memory_mib = std::max(result_.peak_memory_mib, peak);
    result_.output = output_.content(std::numeric_limits<off_t>::max());
    result_.error = error_.content(kMostErrorText);
    if (WIFEXITED(status)) result_.exit_code = WEXITSTATUS(status);
    if (WIFSIGNALED(status)) result_.signal = WTERMSIG(status);
    explain();
  }

  void explain() {
    if (!is_asked_) {
      result_.outcome = result_.signal != 0                     ? ProcessOutcome::crashed
                        : result_.exit_code == 0                ? ProcessOutcome::ok
                        : result_.exit_code == kExitOutOfMemory ? ProcessOutcome::out_of_memory
                                                                : ProcessOutcome::failed;
    }
    switch (result_.outcome) {
      case ProcessOutcome::ok: break;
      case ProcessOutcome::failed:
        result_.reason = told_reason(result_.error);
        if (result_.reason.empty()) result_.reason = fmt::format("exit code {}", result_.exit_code);
        break;
      case ProcessOutcome::crashed: {
        const char* const name = sigdescr_np(result_.signal);
        result_.reason = fmt::format("killed by signal {} ({})", result_.signal, name == nullptr ? "unknown" : name);
        if (result_.signal == SIGKILL) result_.reason += "; the system does so when memory runs out";
        break;
      }
      case ProcessOutcome::timed_out: result_.reason = fmt::format("more than {} s", limits_.seconds); break;
      case ProcessOutcome::out_of_memory:
        result_.reason = is_asked_ ? fmt::format("more than {} MiB", limits_.memory_mib) : "an allocation failed";
        break;
      case ProcessOutcome::interrupted: result_.reason = "interrupted"; break;
    }
  }

  std::size_t number_;
  ProcessLimits limits_;
  MemoryFile input_;
  MemoryFile output_;
  MemoryFile error_;
  double memory_of_parent_;
  Stopwatch watch_;
  pid_t id_ = -1;
  bool is_asked_ = false;
  double asked_at_ = 0.0;
  ProcessResult result_;
};

void require_program(const ProcessJob& job) {
  if (job.command.empty()) throw UsageError("a process needs a program");
}

}  // namespace

std::string to_string(ProcessOutcome outcome) {
  switch (outcome) {
    case ProcessOutcome::ok: return "ok";
    case ProcessOutcome::failed: return "failed";
    case ProcessOutcome::crashed: return "crashed";
    case ProcessOutcome::timed_out: return "timed_out";
    case ProcessOutcome::out_of_memory: return "out_of_memory";
    case ProcessOutcome::interrupted: break;
  }
  return "interrupted";
}

std::vector<ProcessResult> run_processes(const std::vector<ProcessJob>& jobs, const ProcessPoolOptions& options) {
  for (const ProcessJob& job : jobs) require_program(job);
  return run_processes(
      jobs.size(), [&jobs](std::size_t job) { return jobs[job]; }, options);
}

std::vector<ProcessResult> run_processes(std::size_t count, const std::function<ProcessJob(std::size_t)>& job,
                                         const ProcessPoolOptions& options) {
  if (options.jobs < 1) throw UsageError(fmt::format("expected at least one process at a time, got {}", options.jobs));
  const ProcessLimits& limits = options.limits;
  if (!(limits.seconds >= 0.0 && limits.memory_mib >= 0.0)) {
    throw UsageError(
        fmt::format("expected limits of at least 0, got {} s and {} MiB", limits.seconds, limits.memory_mib));
  }
  const ChildrenAreKept kept;
  std::vector<ProcessResult> results(count);
  std::list<Process> running;
  std::size_t next = 0;
  bool going = true;
  while (true) {
    going = going && (!options.keep_going || options.keep_going());
    if (!going) {
      for (Process& process : running) process.end(ProcessOutcome::interrupted);
    }
    while (going && next < count && running.size() < static_cast<std::size_t>(options.jobs)) {
      const ProcessJob made = job(next);
      require_program(made);
      running.emplace_back(next, made, limits);
      ++next;
    }
    if (running.empty()) break;
    bool any_ended = false;
    for (auto process = running.begin(); process != running.end();) {
      if (!process->has_ended()) {
        ++process;
        continue;
      }
      any_ended = true;
      ProcessResult& result = results[process->number()];
      const std::size_t number = process->number();
      result = process->result();
      process = running.erase(process);
      if (options.finished) options.finished(number, result);
    }
    if (!any_ended) std::this_thread::sleep_for(kPause);
  }
  for (; next < count; ++next) results[next].reason = "interrupted";
  return results;
}

}  // namespace variform
