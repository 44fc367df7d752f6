// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "framework/base/error.h"
#include "framework/experiment/figure.h"
#include "framework/experiment/table.h"
#include "framework/experiment/trials.h"

namespace variform {

/// Verdict on a machine-checkable statement of a source.
struct Verdict {
  std::string text;            ///< the statement
  std::string condition;       ///< what was checked, as in the config
  std::string published = {};  ///< the source's number or wording
  std::string ours = {};       ///< what this run found
  enum class Outcome { holds, fails, undecided } outcome = Outcome::undecided;
  std::string reason = {};  ///< why undecided (no row matched, a metric is missing), or how far off
};

std::string to_string(Verdict::Outcome outcome);

/// A picture of a run: files PATH.svg and PATH.png relative to the run's folder.
struct FigureFile {
  std::string caption;
  std::string path;  ///< without extension, relative to the run's folder
};

/// The frames of a figure of moving meshes, for the points of a run.
struct Animation {
  struct Point {
    std::string title = {};  ///< swept values in words; empty without sweep
    std::vector<double> times = {};
    std::vector<std::string> files = {};  ///< of the frames: PNGs, relative to the run's folder
  };
  std::string caption = {};
  std::vector<Point> points = {};
};

/// A search inside a point.
struct RecordedSearch {
  std::string point = {};  ///< swept values of the point in words; empty without sweep
  Trials trials = {};
};

/// Everything a run put out.
struct Record {
  std::string title;
  std::string source = {};  ///< the publication and figure
  std::string pipeline = {};
  std::string config = {};  ///< TOML text of the config as run, overrides applied
  std::vector<std::pair<std::string, std::string>> provenance = {};  ///< versions, machine, BLAS, seeds, date, command
  std::vector<std::string> warnings = {};
  std::vector<std::string> swept = {};  ///< keys of the rows that the config sweeps
  std::vector<Row> rows = {};
  /// The worst that a point without result would have answered as the only one; its row says why.
  ExitCode failure = ExitCode::done;
  std::vector<Column> columns = {};  ///< how known keys are shown; others get defaults
  std::vector<Table> tables = {};    ///< further tables for the report (convergence, pivots)
  std::vector<FigureFile> figures = {};
  std::vector<Animation> animations = {};
  int max_frames = 60;  ///< that the report shows of an animation's point
  std::vector<Verdict> verdicts = {};
  std::vector<RecordedSearch> searches = {};
  std::vector<MeshFigure> spatial = {};  ///< figures in space, for the interactive view of the report
  Camera camera = {};                    ///< from which that view starts
};

/// record.json: object with title, source, pipeline, config, provenance (object), warnings, rows (flat objects),
/// figures, animations (times and files of frames), claims, searches (each with its trials). Numbers are written with
/// all digits; NaN and infinities as null.
std::string record_json(const Record& record);

/// The rows of a record.json; numbers that it has as null are missing. Throws DataError when there is none or it is
/// broken.
std::vector<Row> load_rows(const std::filesystem::path& file);

/// Table of the rows with the record's column descriptions; only the given keys if any.
Table record_table(const Record& record, const std::vector<std::string>& keys = {});

/// Claims as a table: statement, published, ours, verdict.
Table claims_table(const std::vector<Verdict>& verdicts);

/// Writes folder/record.json, table.csv, table.md, table.tex, table.json and report.html; each file appears complete or
/// not at all. table_keys: the columns of table.md and table.tex (all if empty); CSV and JSON always have all.
/// Throws DataError when a file cannot be written.
void write_record(const Record& record, const std::filesystem::path& folder,
                  const std::vector<std::string>& table_keys);

/// Frames of an animation in a report, of all points together: some tens of MiB.
inline constexpr int kReportFrames = 600;

/// One page that opens from disk with no network: title, source, claims with verdicts, tables (sortable by a click on a
/// header), an interactive view of the figures in space (see viewer.h), animations to be played (PNGs of evenly chosen
/// frames inlined: up to max_frames for a point, and kReportFrames of all or 12 for each), figures (PNGs inlined,
/// linking to the SVG beside the report), warnings, config and provenance.
std::string report_html(const Record& record, const std::filesystem::path& folder,
                        const std::vector<std::string>& table_keys);

}  // namespace variform
