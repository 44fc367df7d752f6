// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/record.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <system_error>

#include "framework/base/error.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/json.h"

namespace variform {

std::string to_string(Verdict::Outcome outcome) {
  switch (outcome) {
    case Verdict::Outcome::holds: return "holds";
    case Verdict::Outcome::fails: return "fails";
    case Verdict::Outcome::undecided: break;
  }
  return "undecided";
}

std::string record_json(const Record& record) {
  using Json = nlohmann::ordered_json;
  Json json = {{"title", record.title},   {"source", record.source},      {"pipeline", record.pipeline},
               {"config", record.config}, {"provenance", Json::object()}, {"warnings", record.warnings},
               {"rows", Json::array()},   {"figures", Json::array()},     {"animations", Json::array()},
               {"claims", Json::array()}, {"searches", Json::array()}};
  for (const auto& [key, value] : record.provenance) json["provenance"][key] = value;
  for (const Row& row : record.rows) json["rows"].push_back(to_json(row));
  for (const FigureFile& figure : record.figures) {
    json["figures"].push_back({{"caption", figure.caption}, {"path", figure.path}});
  }
  for (const Animation& animation : record.animations) {
    Json points = Json::array();
    for (const Animation::Point& point : animation.points) {
      points.push_back({{"title", point.title}, {"times", point.times}, {"files", point.files}});
    }
    json["animations"].push_back({{"caption", animation.caption}, {"points", points}});
  }
  for (const Verdict& verdict : record.verdicts) {
    json["claims"].push_back({{"text", verdict.text},
                              {"condition", verdict.condition},
                              {"published", verdict.published},
                              {"ours", verdict.ours},
                              {"outcome", to_string(verdict.outcome)},
                              {"reason", verdict.reason}});
  }
  for (const auto& [point, trials] : record.searches) {
    Json rows = Json::array();
    for (const Row& row : trials.rows) rows.push_back(to_json(row));
    json["searches"].push_back({{"point", point},
                                {"key", trials.key},
                                {"aim", trials.aim},
                                {"metrics", trials.metrics},
                                {"found", trials.found},
                                {"value", to_json(Value(trials.value))},
                                {"bracket_low", to_json(Value(trials.low))},
                                {"bracket_high", to_json(Value(trials.high))},
                                {"remarks", trials.remarks},
                                {"trials", rows}});
  }
  return to_text(json, 2) + "\n";
}

std::vector<Row> load_rows(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) throw DataError(fmt::format("{}: cannot be read; expected the folder of a finished run", file.string()));
  try {
    const auto json = nlohmann::ordered_json::parse(stream);
    std::vector<Row> rows;
    for (const nlohmann::ordered_json& object : json.at("rows")) {
      Row row;
      for (const auto& [key, value] : object.items()) {
        if (value.is_boolean()) {
          row.set(key, value.get<bool>());
        } else if (value.is_number_integer()) {
          row.set(key, value.get<std::int64_t>());
        } else if (value.is_number()) {
          row.set(key, value.get<double>());
        } else {
          row.set(key, value.is_null() ? Value() : Value(value.get<std::string>()));
        }
      }
      rows.push_back(std::move(row));
    }
    return rows;
  } catch (const nlohmann::ordered_json::exception& error) {
    throw DataError(fmt::format("{}: is no record of a run: {}", file.string(), error.what()));
  }
}

Table record_table(const Record& record, const std::vector<std::string>& keys) {
  Table table = Table::of(record.rows);
  table.caption = record.title;
  if (!keys.empty()) {
    table.columns.clear();
    for (const std::string& key : keys) table.columns.push_back({.key = key});
  }
  for (Column& column : table.columns) {
    const auto known = std::find_if(record.columns.begin(), record.columns.end(),
                                    [&column](const Column& c) { return c.key == column.key; });
    if (known != record.columns.end()) column = *known;
  }
  return table;
}

Table claims_table(const std::vector<Verdict>& verdicts) {
  Table table{.columns = {{.key = "statement"}, {.key = "published"}, {.key = "ours"}, {.key = "verdict"}}};
  for (const Verdict& verdict : verdicts) {
    const std::string outcome = to_string(verdict.outcome);
    Row row;
    row.set("statement", verdict.text);
    row.set("published", verdict.published);
    row.set("ours", verdict.ours);
    row.set("verdict", verdict.reason.empty() ? outcome : fmt::format("{} ({})", outcome, verdict.reason));
    table.rows.push_back(std::move(row));
  }
  return table;
}

void write_record(const Record& record, const std::filesystem::path& folder,
                  const std::vector<std::string>& table_keys) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw DataError(fmt::format("{}: cannot be made: {}", folder.string(), error.message()));
  const Table all = record_table(record);
  const Table chosen = record_table(record, table_keys);
  write_file(folder / "record.json", record_json(record));
  write_file(folder / "table.csv", all.csv());
  write_file(folder / "table.json", all.json());
  write_file(folder / "table.md", chosen.markdown());
  write_file(folder / "table.tex", chosen.latex());
  write_file(folder / "report.html", report_html(record, folder, table_keys));
}

}  // namespace variform
