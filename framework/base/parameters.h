// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace variform {

/// Value of a parameter, as configs and registries exchange it.
using ParameterValue = std::variant<bool, std::int64_t, double, std::string, std::vector<double>>;

/// One parameter that a registered thing (energy, backend, generator, ...) takes: what `variform list` prints, what
/// configs are checked against.
struct Parameter {
  std::string name = {};
  ParameterValue value;                                   ///< default; its alternative is the type
  std::string doc;                                        ///< one line
  double min = -std::numeric_limits<double>::infinity();  ///< numbers only, inclusive
  double max = std::numeric_limits<double>::infinity();   ///< numbers only; see max_open
  bool max_open = false;                                  ///< the maximum itself is excluded
  std::vector<std::string> choices = {};                  ///< strings only; empty: any
};

/// "boolean", "integer", "number", "string", "list of numbers".
std::string type_name(const ParameterValue& value);

/// The value as TOML would write it.
std::string to_string(const ParameterValue& value);

/// Checked values of a list of parameters: every parameter is there, with its default where nothing was set.
class Parameters {
 public:
  Parameters() = default;
  /// All defaults.
  explicit Parameters(const std::vector<Parameter>& declared);

  /// Sets one value; integers are accepted where numbers are declared.
  /// Throws UsageError naming the parameter and what it accepts for unknown names, wrong types, values out of range.
  void set(const std::string& name, const ParameterValue& value);

  bool boolean(const std::string& name) const { return std::get<bool>(at(name)); }
  std::int64_t integer(const std::string& name) const { return std::get<std::int64_t>(at(name)); }
  double number(const std::string& name) const { return std::get<double>(at(name)); }
  const std::string& string(const std::string& name) const { return std::get<std::string>(at(name)); }
  const std::vector<double>& numbers(const std::string& name) const { return std::get<std::vector<double>>(at(name)); }

 private:
  const ParameterValue& at(const std::string& name) const;

  std::vector<Parameter> declared_;
  std::map<std::string, ParameterValue> values_;
};

}  // namespace variform
