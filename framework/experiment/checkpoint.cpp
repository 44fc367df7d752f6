// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/checkpoint.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

#include "framework/domain/io/base64.h"
#include "framework/experiment/json.h"

namespace variform {
namespace {

using Json = nlohmann::ordered_json;

// JSON has no NaN and no infinities: null and texts stand for them.
Json number(double value) {
  if (std::isnan(value)) return nullptr;
  if (std::isinf(value)) return value > 0.0 ? "inf" : "-inf";
  return value;
}
double number(const Json& json) {
  if (json.is_null()) return std::numeric_limits<double>::quiet_NaN();
  if (json.is_string()) return (json == "-inf" ? -1.0 : 1.0) * std::numeric_limits<double>::infinity();
  return json.get<double>();
}

template <class Numbers>
Json numbers(const Numbers& values) {
  Json json = Json::array();
  for (const double value : values) json.push_back(number(value));
  return json;
}

std::vector<double> numbers(const Json& json) {
  std::vector<double> values;
  for (const Json& entry : json) values.push_back(number(entry));
  return values;
}

// The bytes of the numbers: meshes of many frames are large, and every digit counts.
template <class M>
Json dense(const M& matrix) {
  const std::string_view bytes(reinterpret_cast<const char*>(matrix.data()),
                               static_cast<std::size_t>(matrix.size()) * sizeof(typename M::Scalar));
  return {{"rows", matrix.rows()}, {"columns", matrix.cols()}, {"bytes", io::base64_encode(bytes)}};
}

template <class M>
M dense(const Json& json) {
  M matrix(json.at("rows").get<Index>(), json.at("columns").get<Index>());
  const std::size_t size = static_cast<std::size_t>(matrix.size()) * sizeof(typename M::Scalar);
  io::Base64Decoder decoder(json.at("bytes").get_ref<const std::string&>());
  const std::optional<std::string> bytes = decoder.read(size);
  if (!bytes || !decoder.at_end()) throw Json::other_error::create(501, "size", nullptr);
  std::copy_n(bytes->data(), size, reinterpret_cast<char*>(matrix.data()));
  return matrix;
}

Json value_json(const Value& value) {
  return std::visit(
      [](const auto& v) -> Json {
        if constexpr (std::is_same_v<std::decay_t<decltype(v)>, std::monostate>)
          return nullptr;
        else if constexpr (std::is_same_v<std::decay_t<decltype(v)>, double>)
          return {{"number", number(v)}};
        else
          return v;
      },
      value);
}

Value value_from(const Json& json) {
  if (json.is_null()) return {};
  if (json.is_boolean()) return json.get<bool>();
  if (json.is_number_integer()) return json.get<std::int64_t>();
  if (json.is_object()) return number(json.at("number"));
  return json.get<std::string>();
}

// Entries as an array: keys keep their order.
Json row_json(const Row& row) {
  Json json = Json::array();
  for (const auto& [key, value] : row.entries()) json.push_back({key, value_json(value)});
  return json;
}

Row row_from(const Json& json) {
  Row row;
  for (const Json& entry : json) row.set(entry.at(0).get<std::string>(), value_from(entry.at(1)));
  return row;
}

Json figure_json(const MeshFigure& figure) {
  return {{"name", figure.name},
          {"title", figure.title},
          {"caption", figure.caption},
          {"positions", dense(figure.mesh.positions)},
          {"cells", dense(figure.mesh.cells)},
          {"values", dense(figure.cell_values)},
          {"scale",
           {{"low", number(figure.scale.low)},
            {"high", number(figure.scale.high)},
            {"logarithmic", figure.scale.logarithmic},
            {"label", figure.scale.label}}},
          {"uv", dense(figure.uv)},
          {"uv_cells", dense(figure.uv_cells)},
          {"check_size", number(figure.check_size)},
          {"fixed", figure.fixed_vertices},
          {"moved", figure.moved_vertices},
          {"soft", figure.soft_vertices},
          {"flipped", figure.flipped_cells},
          {"edges", figure.edges}};
}

MeshFigure figure_from(const Json& from) {
  MeshFigure figure;
  figure.name = from.at("name").get<std::string>();
  figure.title = from.at("title").get<std::string>();
  figure.caption = from.at("caption").get<std::string>();
  figure.mesh = {dense<Matrix>(from.at("positions")), dense<IndexMatrix>(from.at("cells"))};
  figure.cell_values = dense<Vector>(from.at("values"));
  const Json& scale = from.at("scale");
  figure.scale = {.low = number(scale.at("low")),
                  .high = number(scale.at("high")),
                  .logarithmic = scale.at("logarithmic").get<bool>(),
                  .label = scale.at("label").get<std::string>()};
  figure.uv = dense<Matrix>(from.at("uv"));
  figure.uv_cells = dense<IndexMatrix>(from.at("uv_cells"));
  figure.check_size = number(from.at("check_size"));
  figure.fixed_vertices = from.at("fixed").get<std::vector<Index>>();
  figure.moved_vertices = from.at("moved").get<std::vector<Index>>();
  figure.soft_vertices = from.at("soft").get<std::vector<Index>>();
  figure.flipped_cells = from.at("flipped").get<std::vector<Index>>();
  figure.edges = from.at("edges").get<bool>();
  return figure;
}

Json curves_json(const std::vector<Curve>& curves) {
  Json json = Json::array();
  for (const Curve& curve : curves) {
    json.push_back({{"label", curve.label}, {"x", numbers(curve.x)}, {"y", numbers(curve.y)}});
  }
  return json;
}

std::vector<Curve> curves_from(const Json& from) {
  std::vector<Curve> curves;
  for (const Json& curve : from) {
    curves.push_back({curve.at("label").get<std::string>(), numbers(curve.at("x")), numbers(curve.at("y"))});
  }
  return curves;
}

// Of a frame only what differs from the first one: cells are the same in all of them.
Json trajectory_json(const Trajectory& trajectory) {
  Json frames = Json::array();
  Json first;
  for (const Trajectory::Frame& frame : trajectory.frames) {
    Json figure = figure_json(frame.figure);
    if (frames.empty()) {
      first = figure;
    } else {
      for (const auto& [key, value] : first.items()) {
        if (figure.at(key) == value) figure.erase(key);
      }
    }
    frames.push_back({{"time", number(frame.time)}, {"figure", std::move(figure)}});
  }
  return {{"frames", std::move(frames)}, {"curves", curves_json(trajectory.curves)}};
}

Trajectory trajectory_from(const Json& from) {
  Trajectory trajectory;
  for (const Json& frame : from.at("frames")) {
    Json figure = from.at("frames").at(0).at("figure");
    figure.update(frame.at("figure"));
    trajectory.frames.push_back({.time = number(frame.at("time")), .figure = figure_from(figure)});
  }
  trajectory.curves = curves_from(from.at("curves"));
  return trajectory;
}

Json trials_json(const Trials& trials) {
  Json rows = Json::array();
  for (const Row& row : trials.rows) rows.push_back(row_json(row));
  return {{"key", trials.key},
          {"aim", trials.aim},
          {"metrics", trials.metrics},
          {"against", trials.against},
          {"rows", rows},
          {"found", trials.found},
          {"value", number(trials.value)},
          {"low", number(trials.low)},
          {"high", number(trials.high)},
          {"remarks", trials.remarks}};
}

Trials trials_from(const Json& from) {
  Trials trials;
  trials.key = from.at("key").get<std::string>();
  trials.aim = from.at("aim").get<std::string>();
  trials.metrics = from.at("metrics").get<std::vector<std::string>>();
  trials.against = from.at("against").get<std::string>();
  for (const Json& row : from.at("rows")) trials.rows.push_back(row_from(row));
  trials.found = from.at("found").get<bool>();
  trials.value = number(from.at("value"));
  trials.low = number(from.at("low"));
  trials.high = number(from.at("high"));
  trials.remarks = from.at("remarks").get<std::vector<std::string>>();
  return trials;
}

}  // namespace

void save_point(const std::filesystem::path& file, const std::string& config_text, const PointResult& result) {
  Json json;
  json["config"] = config_text;
  json["metrics"] = row_json(result.metrics);
  json["figures"] = Json::array();
  for (const MeshFigure& figure : result.figures) json["figures"].push_back(figure_json(figure));
  json["history"] = curves_json(result.history);
  json["trajectory"] = trajectory_json(result.trajectory);
  json["trials"] = Json::array();
  for (const Trials& trials : result.trials) json["trials"].push_back(trials_json(trials));
  json["probes"] = dense(result.probes);
  json["probe_scale"] = result.probe_scale;
  if (result.trace.solution.size() > 0) {
    json["trace"] = {
        {"solution", dense(result.trace.solution)},    {"length_scale", result.trace.length_scale},
        {"objective", number(result.trace.objective)}, {"energy", numbers(result.trace.energy)},
        {"seconds", numbers(result.trace.seconds)},    {"linear_residuals", numbers(result.trace.linear_residuals)}};
  }
  json["warnings"] = result.warnings;
  write_file(file, to_text(json, -1));
}

std::optional<PointResult> load_point(const std::filesystem::path& file, const std::string& config_text) {
  std::ifstream stream(file);
  if (!stream) return std::nullopt;
  try {
    const Json json = Json::parse(stream);
    if (json.at("config").get<std::string>() != config_text) return std::nullopt;
    PointResult result;
    result.metrics = row_from(json.at("metrics"));
    for (const Json& figure : json.at("figures")) result.figures.push_back(figure_from(figure));
    for (const Json& trials : json.at("trials")) result.trials.push_back(trials_from(trials));
    result.history = curves_from(json.at("history"));
    result.trajectory = trajectory_from(json.at("trajectory"));
    result.probes = dense<Matrix>(json.at("probes"));
    result.probe_scale = json.at("probe_scale").get<double>();
    if (json.contains("trace")) {
      const Json& trace = json.at("trace");
      result.trace = {.solution = dense<Matrix>(trace.at("solution")),
                      .length_scale = trace.at("length_scale").get<double>(),
                      .objective = number(trace.at("objective")),
                      .energy = numbers(trace.at("energy")),
                      .seconds = numbers(trace.at("seconds")),
                      .linear_residuals = numbers(trace.at("linear_residuals"))};
    }
    result.warnings = json.at("warnings").get<std::vector<std::string>>();
    return result;
  } catch (const Json::exception&) {
    return std::nullopt;  // half a file of a run that died, or of another version: the point is run again
  }
}

}  // namespace variform
