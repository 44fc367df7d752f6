// SPDX-License-Identifier: BSD-3-Clause
#include "framework/base/parameters.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "framework/base/error.h"

namespace variform {

std::string type_name(const ParameterValue& value) {
  static const char* const kNames[] = {"boolean", "integer", "number", "string", "list of numbers"};
  return kNames[value.index()];
}

std::string to_string(const ParameterValue& value) {
  struct Writer {
    std::string operator()(bool b) const { return b ? "true" : "false"; }
    std::string operator()(std::int64_t i) const { return fmt::format("{}", i); }
    std::string operator()(double d) const { return fmt::format("{}", d); }
    std::string operator()(const std::string& s) const { return fmt::format("\"{}\"", s); }
    std::string operator()(const std::vector<double>& v) const { return fmt::format("[{}]", fmt::join(v, ", ")); }
  };
  return std::visit(Writer{}, value);
}

Parameters::Parameters(const std::vector<Parameter>& declared) : declared_(declared) {
  for (const Parameter& parameter : declared_) values_[parameter.name] = parameter.value;
}

namespace {

void check_number(const Parameter& parameter, double value) {
  const bool too_large = parameter.max_open ? !(value < parameter.max) : !(value <= parameter.max);
  if (!(value >= parameter.min) || too_large) {
    throw UsageError(fmt::format("'{}' = {}: expected a value in [{}, {}{}", parameter.name, value, parameter.min,
                                 parameter.max, parameter.max_open ? ")" : "]"));
  }
}

}  // namespace

void Parameters::set(const std::string& name, const ParameterValue& value) {
  const auto found =
      std::find_if(declared_.begin(), declared_.end(), [&](const Parameter& p) { return p.name == name; });
  if (found == declared_.end()) {
    std::vector<std::string> names;
    for (const Parameter& parameter : declared_) names.push_back(parameter.name);
    throw UsageError(names.empty() ? fmt::format("unknown key '{}'; none is accepted here", name)
                                   : fmt::format("unknown key '{}'; accepted: {}", name, fmt::join(names, ", ")));
  }
  const Parameter& parameter = *found;
  ParameterValue stored = value;
  if (std::holds_alternative<double>(parameter.value) && std::holds_alternative<std::int64_t>(value)) {
    stored = static_cast<double>(std::get<std::int64_t>(value));
  }
  if (stored.index() != parameter.value.index()) {
    throw UsageError(fmt::format("'{}' = {}: expected {}, got {}", name, to_string(value), type_name(parameter.value),
                                 type_name(value)));
  }
  if (const auto* number = std::get_if<double>(&stored)) check_number(parameter, *number);
  if (const auto* integer = std::get_if<std::int64_t>(&stored)) {
    check_number(parameter, static_cast<double>(*integer));
  }
  if (const auto* list = std::get_if<std::vector<double>>(&stored)) {
    for (const double entry : *list) check_number(parameter, entry);
  }
  if (const auto* text = std::get_if<std::string>(&stored); text != nullptr && !parameter.choices.empty()) {
    if (std::find(parameter.choices.begin(), parameter.choices.end(), *text) == parameter.choices.end()) {
      throw UsageError(
          fmt::format("'{}' = \"{}\": expected one of {}", name, *text, fmt::join(parameter.choices, ", ")));
    }
  }
  values_[name] = std::move(stored);
}

const ParameterValue& Parameters::at(const std::string& name) const {
  const auto found = values_.find(name);
  if (found == values_.end()) throw UsageError(fmt::format("parameter '{}' is not declared", name));
  return found->second;
}

}  // namespace variform
