// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/continuous_deformations/saved_integration.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdint>
#include <utility>

namespace variform {
namespace {

using Json = nlohmann::json;

// CBOR keeps the bits of doubles; arrays of them travel as one string of bytes.
Json packed(const Vector& values) {
  const auto* const first = reinterpret_cast<const std::uint8_t*>(values.data());
  return Json::binary(
      std::vector<std::uint8_t>(first, first + static_cast<std::size_t>(values.size()) * sizeof(double)));
}

Vector unpacked(const Json& json) {
  const auto& bytes = json.get_binary();
  Vector values(static_cast<Eigen::Index>(bytes.size() / sizeof(double)));
  std::copy_n(bytes.begin(), static_cast<std::size_t>(values.size()) * sizeof(double),
              reinterpret_cast<std::uint8_t*>(values.data()));
  return values;
}

Json packed(const std::vector<double>& values) {
  return packed(Vector(Eigen::Map<const Vector>(values.data(), static_cast<Eigen::Index>(values.size()))));
}

std::vector<double> numbers(const Json& json) {
  const Vector values = unpacked(json);
  return {values.data(), values.data() + values.size()};
}

Json packed(const std::vector<Vector>& list) {
  Json json = Json::array();
  for (const Vector& values : list) json.push_back(packed(values));
  return json;
}

std::vector<Vector> vectors(const Json& json) {
  std::vector<Vector> list;
  for (const Json& entry : json) list.push_back(unpacked(entry));
  return list;
}

Json report_json(const OdeReport& report) {
  Json steps = Json::array();
  for (const OdeStep& s : report.history) {
    steps.push_back({s.number, packed(std::vector<double>{s.time, s.size, s.error, s.drift}), s.evaluations});
  }
  return {{"backend", report.backend},
          {"numbers", packed(std::vector<double>{report.time, report.drift, report.seconds})},
          {"steps", report.steps},
          {"rejected", report.rejected},
          {"refused", report.refused},
          {"restarts", report.restarts},
          {"evaluations", report.evaluations},
          {"history", std::move(steps)}};
}

OdeReport report_from(const Json& json) {
  OdeReport report;
  report.backend = json.at("backend").get<std::string>();
  const std::vector<double> values = numbers(json.at("numbers"));
  report.time = values.at(0);
  report.drift = values.at(1);
  report.seconds = values.at(2);
  report.steps = json.at("steps").get<int>();
  report.rejected = json.at("rejected").get<int>();
  report.refused = json.at("refused").get<int>();
  report.restarts = json.at("restarts").get<int>();
  report.evaluations = json.at("evaluations").get<std::int64_t>();
  for (const Json& entry : json.at("history")) {
    const std::vector<double> step = numbers(entry.at(1));
    report.history.push_back({.number = entry.at(0).get<int>(),
                              .time = step.at(0),
                              .size = step.at(1),
                              .error = step.at(2),
                              .drift = step.at(3),
                              .evaluations = entry.at(2).get<std::int64_t>()});
  }
  return report;
}

}  // namespace

std::string to_bytes(const SavedIntegration& saved) {
  const OdeCheckpoint& at = saved.checkpoint;
  const Json json = {{"time", packed(std::vector<double>{at.time, at.step})},
                     {"state", packed(at.state)},
                     {"memory", packed(at.memory)},
                     {"outputs", at.outputs},
                     {"report", report_json(at.report)},
                     {"times", packed(saved.times)},
                     {"states", packed(saved.states)},
                     {"turned", packed(std::vector<double>{saved.turned, saved.seconds})},
                     {"axis", packed(saved.axis)}};
  std::string bytes;
  Json::to_cbor(json, bytes);
  return bytes;
}

std::optional<SavedIntegration> integration_from(const std::string& bytes) {
  try {
    const Json json = Json::from_cbor(bytes);
    SavedIntegration saved;
    OdeCheckpoint& at = saved.checkpoint;
    const std::vector<double> time = numbers(json.at("time"));
    at.time = time.at(0);
    at.step = time.at(1);
    at.state = unpacked(json.at("state"));
    at.memory = vectors(json.at("memory"));
    at.outputs = json.at("outputs").get<std::size_t>();
    at.report = report_from(json.at("report"));
    saved.times = numbers(json.at("times"));
    saved.states = vectors(json.at("states"));
    const std::vector<double> turned = numbers(json.at("turned"));
    saved.turned = turned.at(0);
    saved.seconds = turned.at(1);
    saved.axis = numbers(json.at("axis"));
    return saved;
  } catch (const Json::exception&) {
    return std::nullopt;
  } catch (const std::out_of_range&) {
    return std::nullopt;
  }
}

}  // namespace variform
