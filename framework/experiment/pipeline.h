// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "framework/base/registry.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/config.h"
#include "framework/experiment/figure.h"
#include "framework/experiment/table.h"
#include "framework/experiment/trials.h"

namespace variform {

/// How a solver got to its result: what comparisons of backends look at.
struct SolveTrace {
  Matrix solution = {};       ///< |V| x d
  double length_scale = 1.0;  ///< that differences of solutions are divided by
  /// What is minimized, at the solution: one functional for all backends, whatever their histories measure.
  double objective = std::numeric_limits<double>::quiet_NaN();
  /// Of nonlinear backends, a value for each row of the history, the start included: objective and seconds since the
  /// start of the run.
  std::vector<double> energy = {};
  std::vector<double> seconds = {};
  std::vector<double> linear_residuals = {};  ///< relative, by iteration of the last linear solve; direct: empty
};

/// A moving shape: a state at each of several times. The runner writes it as a series for ParaView (meshes/NAME.pvd and
/// a VTU for every frame), draws every frame, and lets the report play them.
struct Trajectory {
  struct Frame {
    double time = 0.0;
    Mesh mesh = {};  ///< vertex order of the input; the same cells in all frames
    std::vector<MeshField> fields = {};
    /// Of the name that all frames have, one that the pipeline declares. Titles and ranges of scales are left to the
    /// runner; no cells: nothing is drawn.
    MeshFigure figure = {};
  };
  std::vector<Frame> frames = {};
  std::vector<Curve> curves = {};  ///< values over time (x), by name of the value: one plot for each name
};

/// A place where a point may keep unfinished work, so that a run that is interrupted goes on from there (--resume).
/// What is saved is bytes, good for the same point of the same config only; it is removed when the point has ended,
/// with a result or an error.
class Workspace {
 public:
  /// Extension of the file beside that has the progress.
  static constexpr const char* kProgress = ".progress";

  /// Keeps nothing.
  Workspace() = default;
  /// In `file`, under a key; load() finds what an earlier process saved if `resume`.
  Workspace(std::filesystem::path file, std::string key, bool resume);

  /// Replaces what was saved; complete or not at all, whenever the process is killed. Throws DataError when it cannot
  /// be written.
  void save(const std::string& bytes) const;
  /// What was saved last under this key, if it is whole; with resume = false nothing.
  std::optional<std::string> load() const;
  /// Removes what was saved, in parts, too.
  void clear() const;
  /// Tells the run how much of the point is done, in [0, 1]; takes some tens of microseconds. Of parts it tells
  /// nothing.
  void progress(double fraction) const;
  /// What was told last of a point whose workspace has this file; 0 if nothing.
  static double progress_of(const std::filesystem::path& file);
  /// A workspace in a file beside for a part of the point, a trial of a search: what parts save, they keep until the
  /// point has ended, so that those that were finished are soon so again.
  Workspace part(const std::string& key) const;

 private:
  std::filesystem::path file_ = {};
  std::string key_ = {};
  bool resume_ = false;
  bool is_part_ = false;
};

/// What a pipeline makes of one point of a study: a config without sweep, every value in its place.
struct PointResult {
  Row metrics;                         ///< flat; the runner puts the swept keys in front
  Mesh mesh = {};                      ///< result with the vertex order of the input; no cells: none
  std::vector<MeshField> fields = {};  ///< for the VTU beside the OBJ
  Matrix uv = {};                      ///< texture coordinates for the OBJ, n x 2; none: 0 x 0
  IndexMatrix uv_cells = {};           ///< rows of uv, cells x 3
  /// The result as pictures, each with a name that the pipeline declares; titles and ranges of scales are left to the
  /// runner (a label of the scale is kept).
  std::vector<MeshFigure> figures = {};
  std::vector<Curve> history = {};  ///< convergence: value against iteration, by name of the value
  Matrix probes = {};               ///< images of the probe points (NaN where a point is outside), for [compare]
  double probe_scale = 1.0;         ///< length that differences of probes are divided by
  SolveTrace trace = {};
  Trajectory trajectory = {};
  std::vector<Trials> trials = {};  ///< what searches inside the point tried, for the record, tables and plots
  std::vector<std::string> warnings = {};
};

class PointCode;

/// What a pipeline may be made of: functions of a point's config, and of its place for unfinished work if they take it.
template <class Code>
concept PointFunction = !std::is_same_v<Code, PointCode> &&
                        (std::is_invocable_r_v<PointResult, const Code&, const Config&> ||
                         std::is_invocable_r_v<PointResult, const Code&, const Config&, const Workspace&>);

/// The code of a pipeline for one point.
class PointCode {
 public:
  PointCode() = default;
  template <PointFunction Code>
  PointCode(Code code) {
    if constexpr (std::is_invocable_v<const Code&, const Config&, const Workspace&>) {
      code_ = std::move(code);
    } else {
      code_ = [code = std::move(code)](const Config& config, const Workspace&) { return code(config); };
    }
  }

  /// Without a workspace nothing is kept. Throws what the code throws.
  PointResult operator()(const Config& config, const Workspace& workspace = {}) const {
    return code_(config, workspace);
  }
  explicit operator bool() const { return static_cast<bool>(code_); }

 private:
  std::function<PointResult(const Config&, const Workspace&)> code_ = {};
};

/// A metric or phase time that a pipeline puts into its rows: what `variform list` prints and tables show.
struct Metric {
  Column column;
  std::string doc;
};

/// Parameters that a pipeline reads from one config section, for `variform list`.
struct Section {
  std::string name = {};
  std::vector<Parameter> parameters = {};
};

/// Code for one kind of study.
struct PipelineEntry {
  std::string name = {};
  std::string doc = {};
  /// Top-level config sections the pipeline reads, beside those of the runner.
  std::vector<std::string> sections = {};
  std::vector<Section> parameters = {};   ///< of those sections whose parameters do not depend on a name chosen there
  std::vector<Metric> metrics = {};       ///< all that its rows may have: claims, columns and plots can name no others
  std::vector<std::string> figures = {};  ///< names of the figures that it makes, for output.figures
  /// Runs one point. mesh files are looked up through find_input. Throws Error.
  PointCode run = {};
  /// The files that `run` reads for a point: a checkpoint is good only while they are unchanged. Throws as find_input.
  std::function<std::vector<std::filesystem::path>(const Config&)> inputs = {};
  /// Optional: throws UsageError for whatever is wrong with a point's config and can be known without running it. All
  /// points are checked before the first one runs.
  std::function<void(const Config&)> check = {};
};

/// Resolves a file named in a config: absolute, relative to the config's folder, or in one of the folders of the
/// environment variable VARIFORM_DATA (separated by ':'). Throws DataError listing the places looked at.
std::filesystem::path find_input(const std::string& name, const std::filesystem::path& config_folder);

}  // namespace variform
