// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "framework/base/error.h"
#include "framework/base/parameters.h"

namespace variform {

/// A value of a config with the line it stands on: TOML, reduced to what experiments need.
struct ConfigValue {
  using Array = std::vector<ConfigValue>;
  using Table = std::vector<std::pair<std::string, ConfigValue>>;  ///< in order of appearance
  std::variant<bool, std::int64_t, double, std::string, Array, Table> data = Table{};
  int line = 0;  ///< 0: given on the command line

  bool is_table() const { return std::holds_alternative<Table>(data); }
  bool is_array() const { return std::holds_alternative<Array>(data); }
  /// "table", "array", "string", ...
  std::string type() const;
  /// As TOML would write it inline.
  std::string text() const;
};

/// A place in a config: a value, its dotted path and the file it comes from. Errors thrown through it are UsageErrors
/// that read "FILE:LINE: key 'path': what is wrong, what was expected".
class ConfigNode {
 public:
  ConfigNode(const ConfigValue& value, std::string file, std::string path)
      : value_(&value), file_(std::move(file)), path_(std::move(path)) {}

  const ConfigValue& value() const { return *value_; }
  const std::string& path() const { return path_; }
  const std::string& file() const { return file_; }

  /// Children of a table; all throw when this is no table.
  bool has(const std::string& key) const;
  ConfigNode at(const std::string& key) const;  ///< throws when the key is missing
  std::vector<ConfigNode> children() const;
  std::string name() const;  ///< last part of the path

  /// Elements of an array; one element for anything else if `or_single`.
  std::vector<ConfigNode> elements(bool or_single = false) const;

  bool boolean() const;
  std::int64_t integer() const;
  double number() const;
  std::string string() const;
  std::vector<double> numbers() const;
  std::vector<std::int64_t> integers() const;
  std::vector<std::string> strings() const;

  /// Throws for keys not in the list, naming the accepted ones.
  void accept_keys(const std::vector<std::string>& keys) const;

  /// This table as checked parameters. Keys in `others` are left alone, all other unknown keys are errors.
  Parameters parameters(const std::vector<Parameter>& declared, const std::vector<std::string>& others = {}) const;

  /// The value of a child key if present, else the fallback.
  double number_or(const std::string& key, double fallback) const { return has(key) ? at(key).number() : fallback; }
  std::string string_or(const std::string& key, const std::string& fallback) const {
    return has(key) ? at(key).string() : fallback;
  }
  bool boolean_or(const std::string& key, bool fallback) const { return has(key) ? at(key).boolean() : fallback; }

  [[noreturn]] void fail(const std::string& what) const;
  /// Runs an action and puts this place in front of any UsageError from it.
  template <class Action>
  decltype(auto) located(const Action& action) const {
    try {
      return action();
    } catch (const std::exception& error) {
      rethrow_located(error);
    }
  }

 private:
  const ConfigValue::Table& table() const;
  std::string place() const;
  [[noreturn]] void rethrow_located(const std::exception& error) const;

  const ConfigValue* value_;
  std::string file_;
  std::string path_;
};

/// Throws the error class that belongs to an exit code.
[[noreturn]] void throw_error(ExitCode code, const std::string& message);

/// A config file: a TOML document, possibly with values replaced.
class Config {
 public:
  /// Throws UsageError "FILE:LINE: ..." for unreadable files and TOML errors.
  static Config load(const std::filesystem::path& file);
  /// From text; `name` stands for the file in messages, relative paths are resolved against `folder`.
  static Config parse(const std::string& text, const std::string& name, const std::filesystem::path& folder);

  ConfigNode root() const { return {root_, file_, ""}; }
  const std::filesystem::path& folder() const { return folder_; }
  const std::string& file() const { return file_; }

  /// Replaces or adds the value at a dotted path ("norm.beta"; quotes protect dots in keys; [n] indexes an array,
  /// "constraint[0].weight"). Throws UsageError when a part of the path is no table.
  void set(const std::string& path, const ConfigValue& value);
  /// "path=value" as the command line gives it; a value that is no TOML value is taken as a string.
  /// Returns the path.
  std::string set(const std::string& assignment);
  /// Removes the value at a dotted path (tables only); false when it is not there.
  bool erase(const std::string& path);

  /// TOML text of the config as it is now.
  std::string text() const;

  /// Everything in one text, lines and file name included, for from_message in another process: errors there read as
  /// they would here.
  std::string message() const;
  /// Throws UsageError for a text that message did not make.
  static Config from_message(const std::string& message);

 private:
  ConfigValue root_;
  std::string file_;
  std::filesystem::path folder_;
};

}  // namespace variform
