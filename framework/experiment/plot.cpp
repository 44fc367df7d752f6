// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <system_error>
#include <vector>

#include "framework/base/error.h"
#include "framework/domain/io/reader.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/escape.h"
#include "framework/experiment/figure.h"
#include "framework/experiment/ticks.h"

namespace variform {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 800;
constexpr int kHeight = 480;
constexpr int kFontSize = 12;
constexpr int kPngScale = 2;

/// The colours of Okabe and Ito, which the colour-blind can tell apart; without their yellow, too light for lines.
constexpr std::array<const char*, 7> kColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                 "#e69f00", "#56b4e9", "#000000"};
/// Filled and open shapes in turn, so that curves differ in grey as well.
constexpr std::array<int, 10> kPointTypes = {7, 5, 9, 13, 11, 6, 4, 8, 12, 10};

/// Text in gnuplot's single quotes, in which nothing but the quote is special.
std::string quoted(const std::string& text) {
  return fmt::format("'{}'", escape(text, {{'\'', "''"}, {'\n', " "}, {'\r', " "}}));
}

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  bool is_empty() const { return low > high; }
  void extend(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

/// Points of a curve as a block of data; a blank line breaks the curve.
struct Block {
  std::string text;
  Range x = {};
  Range y = {};
};

Block block_of(const Curve& curve, const LinePlot& plot) {
  if (curve.x.size() != curve.y.size()) {
    throw UsageError(fmt::format("plot '{}': curve '{}' has {} x and {} y", plot.title, curve.label, curve.x.size(),
                                 curve.y.size()));
  }
  Block block;
  for (std::size_t i = 0; i < curve.x.size(); ++i) {
    const double x = curve.x[i];
    const double y = curve.y[i];
    if (!std::isfinite(x) || !std::isfinite(y)) {
      block.text += '\n';
    } else if (!(plot.log_x && x <= 0.0) && !(plot.log_y && y <= 0.0)) {
      block.text += fmt::format("{} {}\n", x, y);
      block.x.extend(x);
      block.y.extend(y);
    }
  }
  return block;
}

/// Settings of an axis. Logarithmic ones are set up here: gnuplot alone makes too few marks on short ones and extends
/// the range to whole decades.
std::string axis_settings(char axis, const std::string& label, bool logarithmic, const Range& data) {
  std::string text = fmt::format("set {}label {}\n", axis, quoted(label));
  if (!logarithmic) return text;
  const double margin = std::max(1.1, std::pow(data.high / data.low, 0.04));
  const double low = data.low / margin;
  const double high = data.high * margin;
  std::vector<std::string> ticks;
  for (const Tick& tick : axis_ticks(low, high, true)) {
    ticks.push_back(fmt::format("{} {}", quoted(tick.label), tick.value));
  }
  return text + fmt::format("set logscale {0}\nset {0}range [{1:.4g}:{2:.4g}]\nset {0}tics ({3})\n", axis, low, high,
                            fmt::join(ticks, ", "));
}

constexpr std::size_t kMostMarkers = 60;
constexpr std::size_t kLongestSideLabel = 30;

/// The script, and whether there is anything to draw.
struct Script {
  std::string text;
  bool has_points = false;
};

Script script_of(const LinePlot& plot, const std::string& name) {
  std::string data;
  std::string curves;
  Range x;
  Range y;
  for (std::size_t i = 0; i < plot.curves.size(); ++i) {
    const Block block = block_of(plot.curves[i], plot);
    data += fmt::format("$curve_{} << EOD\n{}EOD\n", i, block.text);
    if (block.x.is_empty()) continue;  // gnuplot would refuse it
    for (const double end : {block.x.low, block.x.high}) x.extend(end);
    for (const double end : {block.y.low, block.y.high}) y.extend(end);
    // Markers of a long curve would merge into a thick one.
    const std::string style = plot.curves[i].x.size() > kMostMarkers
                                  ? std::string("lines")
                                  : fmt::format("linespoints pointtype {}", kPointTypes[i % kPointTypes.size()]);
    curves += fmt::format("{}$curve_{} with {} linecolor '{}' title {}", curves.empty() ? "plot " : ", \\\n     ", i,
                          style, kColours[i % kColours.size()], quoted(plot.curves[i].label));
  }
  Script script{.text = fmt::format("# gnuplot draws {0}.svg and {0}.png of this.\n", escape(name, {{'\n', " "}})) +
                        "set encoding utf8\n" + data};
  if (curves.empty()) return script;
  script.has_points = true;
  script.text += fmt::format("set title {}\n", quoted(plot.title));
  script.text += axis_settings('x', plot.x_label, plot.log_x, x);
  script.text += axis_settings('y', plot.y_label, plot.log_y, y);
  script.text +=
      "set border 3 linecolor '#444444'\n"
      "set tics nomirror textcolor '#222222'\n"
      "set grid linecolor '#d8d8d8' linetype 1 linewidth 0.6\n"
      "set pointsize 0.75\n";
  // Beside the plot long labels would leave no room for it.
  std::size_t longest = 0;
  for (const Curve& curve : plot.curves) longest = std::max(longest, curve.label.size());
  // Below it, gnuplot's own margin would let them run into the label of the axis.
  script.text += longest > kLongestSideLabel
                     ? fmt::format("set key below left Left reverse samplen 2 maxcols 1\nset bmargin {}\n",
                                   std::min<std::size_t>(plot.curves.size(), 14) + 5)
                     : "set key outside right top Left reverse samplen 2\n";
  for (const double mark : plot.marks) {
    if (!(mark >= x.low && mark <= x.high)) continue;
    script.text += fmt::format(
        "set arrow from first {0}, graph 0 to first {0}, graph 1 nohead dashtype 2 linecolor '#888888'\n", mark);
  }
  const auto draw = [&](const char* terminal, int scale, const char* extension, const char* options) {
    script.text +=
        fmt::format("set terminal {} noenhanced size {},{} font 'DejaVu Sans,{}' {}\nset output {}\n{}\n", terminal,
                    scale * kWidth, scale * kHeight, kFontSize * scale, options, quoted(name + extension), curves);
  };
  draw("svg", 1, ".svg", "linewidth 1.5 background '#ffffff'");
  draw("pngcairo", kPngScale, ".png", "linewidth 3 pointscale 2.4 background '#ffffff'");
  script.text += "set output\n";
  return script;
}

/// A folder that is gone with its content at the end.
class TemporaryFolder {
 public:
  explicit TemporaryFolder() {
    std::error_code error;
    std::string name = (fs::temp_directory_path(error) / "variform-plot-XXXXXX").string();
    if (error || mkdtemp(name.data()) == nullptr) {
      throw DataError(fmt::format("{}: cannot be made: {}", name, std::generic_category().message(errno)));
    }
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

struct FileActions {
  posix_spawn_file_actions_t actions;
  FileActions() { posix_spawn_file_actions_init(&actions); }
  ~FileActions() { posix_spawn_file_actions_destroy(&actions); }
  FileActions(const FileActions&) = delete;
  FileActions& operator=(const FileActions&) = delete;
};

constexpr const char* kScriptName = "plot.gp";
constexpr const char* kLogName = "plot.log";

/// Runs gnuplot on the script in the folder. Returns why that failed.
std::optional<std::string> run_gnuplot(const fs::path& folder) {
  FileActions files;
  posix_spawn_file_actions_addchdir_np(&files.actions, folder.c_str());
  posix_spawn_file_actions_addopen(&files.actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files.actions, STDOUT_FILENO, kLogName, O_WRONLY | O_CREAT, 0600);
  posix_spawn_file_actions_adddup2(&files.actions, STDOUT_FILENO, STDERR_FILENO);
  std::string program = "gnuplot";
  std::string no_user_settings = "--default-settings";
  std::string script = kScriptName;
  char* const arguments[] = {program.data(), no_user_settings.data(), script.data(), nullptr};
  pid_t child = 0;
  const int error = posix_spawnp(&child, program.c_str(), &files.actions, nullptr, arguments, environ);
  if (error == ENOENT) return "gnuplot is not installed";
  if (error != 0) return fmt::format("gnuplot cannot be run: {}", std::generic_category().message(error));

  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return std::nullopt;
  std::ifstream log(folder / kLogName);
  std::string line;
  while (line.empty() && std::getline(log, line)) {
  }
  return fmt::format("gnuplot failed: {}", line);
}

}  // namespace

std::optional<std::string> draw_plot(const LinePlot& plot, const fs::path& path) {
  const auto file = [&path](const char* extension) { return fs::path(path) += extension; };
  const Script script = script_of(plot, path.filename().string());
  write_file(file(".gp"), script.text);
  const auto no_picture = [&](const std::string& reason) {
    return fmt::format("no picture of plot '{}': {}", plot.title, reason);
  };
  if (!script.has_points) return no_picture("it has no points");

  // gnuplot writes piece by piece, so it works elsewhere and complete pictures are moved here.
  const TemporaryFolder folder;
  write_file(folder.path() / kScriptName, script.text);
  if (const auto failure = run_gnuplot(folder.path())) return no_picture(*failure);
  for (const char* extension : {".svg", ".png"}) {
    write_file(file(extension), io::load_file(folder.path() / file(extension).filename()));
  }
  return std::nullopt;
}

}  // namespace variform
