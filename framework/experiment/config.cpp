// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>
#include <toml++/toml.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <new>
#include <sstream>

#include "framework/base/error.h"

namespace variform {
namespace {

ConfigValue converted(const toml::node& node, const std::string& file) {
  ConfigValue value;
  value.line = static_cast<int>(node.source().begin.line);
  if (const auto* table = node.as_table()) {
    // toml++ sorts keys by name; the order of the file decides the order of a sweep.
    std::vector<std::pair<toml::source_position, const toml::key*>> order;
    for (const auto& [key, child] : *table) order.emplace_back(child.source().begin, &key);
    std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    ConfigValue::Table entries;
    for (const auto& [position, key] : order) {
      entries.emplace_back(std::string(key->str()), converted(*table->get(key->str()), file));
    }
    value.data = std::move(entries);
  } else if (const auto* array = node.as_array()) {
    ConfigValue::Array entries;
    for (const auto& child : *array) entries.push_back(converted(child, file));
    value.data = std::move(entries);
  } else if (const auto* text = node.as_string()) {
    value.data = text->get();
  } else if (const auto* integer = node.as_integer()) {
    value.data = integer->get();
  } else if (const auto* number = node.as_floating_point()) {
    value.data = number->get();
  } else if (const auto* flag = node.as_boolean()) {
    value.data = flag->get();
  } else {
    throw UsageError(fmt::format("{}:{}: dates and times have no meaning here", file, value.line));
  }
  return value;
}

ConfigValue parse_toml(const std::string& text, const std::string& file) {
  try {
    return converted(toml::parse(text, file), file);
  } catch (const toml::parse_error& error) {
    throw UsageError(fmt::format("{}:{}: {}", file, error.source().begin.line, error.description()));
  }
}

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    switch (c) {
      case '"': result += "\\\""; break;
      case '\\': result += "\\\\"; break;
      case '\n': result += "\\n"; break;
      case '\t': result += "\\t"; break;
      case '\r': result += "\\r"; break;
      default:
        // Other control characters are not allowed as they are.
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
          result += fmt::format("\\u{:04X}", static_cast<unsigned>(c));
        } else {
          result += c;
        }
    }
  }
  return result + "\"";
}

bool is_bare(const std::string& key) {
  return !key.empty() && std::all_of(key.begin(), key.end(),
                                     [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '-'; });
}

std::string key_text(const std::string& key) { return is_bare(key) ? key : quoted(key); }

bool is_table_array(const ConfigValue& value) {
  const auto* array = std::get_if<ConfigValue::Array>(&value.data);
  return array != nullptr && !array->empty() &&
         std::all_of(array->begin(), array->end(), [](const ConfigValue& v) { return v.is_table(); });
}

bool has_header(const ConfigValue& value) { return value.is_table() || is_table_array(value); }

void write_table(const ConfigValue::Table& table, const std::string& prefix, std::string& out) {
  // Whatever follows a header belongs to it: tables in front of a plain value are written inline, so that the order of
  // keys stays.
  std::size_t headers = table.size();
  while (headers > 0 && has_header(table[headers - 1].second)) --headers;
  for (std::size_t i = 0; i < headers; ++i) {
    out += fmt::format("{} = {}\n", key_text(table[i].first), table[i].second.text());
  }
  for (std::size_t i = headers; i < table.size(); ++i) {
    const auto& [key, value] = table[i];
    const std::string path = prefix.empty() ? key_text(key) : prefix + "." + key_text(key);
    if (value.is_table()) {
      out += fmt::format("\n[{}]\n", path);
      write_table(std::get<ConfigValue::Table>(value.data), path, out);
    } else {
      for (const ConfigValue& element : std::get<ConfigValue::Array>(value.data)) {
        out += fmt::format("\n[[{}]]\n", path);
        write_table(std::get<ConfigValue::Table>(element.data), path, out);
      }
    }
  }
}

struct PathPart {
  std::string key;
  int index = -1;
};

std::vector<PathPart> split_path(const std::string& path) {
  std::vector<PathPart> parts;
  std::size_t i = 0;
  while (i <= path.size()) {
    PathPart part;
    if (i < path.size() && path[i] == '"') {
      const std::size_t end = path.find('"', i + 1);
      if (end == std::string::npos) throw UsageError(fmt::format("key '{}': a quote is not closed", path));
      part.key = path.substr(i + 1, end - i - 1);
      i = end + 1;
    } else {
      const std::size_t end = path.find_first_of(".[", i);
      part.key = path.substr(i, end == std::string::npos ? std::string::npos : end - i);
      i = end == std::string::npos ? path.size() : end;
    }
    if (i < path.size() && path[i] == '[') {
      const std::size_t end = path.find(']', i);
      const std::string digits = end == std::string::npos ? "" : path.substr(i + 1, end - i - 1);
      if (digits.empty() || digits.size() > 6 || digits.find_first_not_of("0123456789") != std::string::npos) {
        throw UsageError(fmt::format("key '{}': expected [number] after '{}'", path, part.key));
      }
      part.index = std::stoi(digits);
      i = end + 1;
    }
    if (part.key.empty() || (i < path.size() && path[i] != '.')) {
      throw UsageError(fmt::format("key '{}': expected names separated by dots", path));
    }
    parts.push_back(part);
    if (i >= path.size()) break;
    ++i;
  }
  return parts;
}

using Json = nlohmann::ordered_json;

// [line, kind, content]; numbers as text, for JSON has no NaN and no infinities.
Json value_json(const ConfigValue& value) {
  Json json = Json::array({value.line, value.data.index()});
  if (const auto* table = std::get_if<ConfigValue::Table>(&value.data)) {
    Json entries = Json::array();
    for (const auto& [key, entry] : *table) entries.push_back(Json::array({key, value_json(entry)}));
    json.push_back(entries);
  } else if (const auto* array = std::get_if<ConfigValue::Array>(&value.data)) {
    Json entries = Json::array();
    for (const ConfigValue& entry : *array) entries.push_back(value_json(entry));
    json.push_back(entries);
  } else if (const auto* flag = std::get_if<bool>(&value.data)) {
    json.push_back(*flag);
  } else if (const auto* integer = std::get_if<std::int64_t>(&value.data)) {
    json.push_back(*integer);
  } else if (const auto* number = std::get_if<double>(&value.data)) {
    json.push_back(fmt::format("{}", *number));
  } else {
    json.push_back(std::get<std::string>(value.data));
  }
  return json;
}

ConfigValue value_from(const Json& json) {
  ConfigValue value;
  value.line = json.at(0).get<int>();
  const Json& content = json.at(2);
  switch (json.at(1).get<std::size_t>()) {
    case 0: value.data = content.get<bool>(); break;
    case 1: value.data = content.get<std::int64_t>(); break;
    case 2: value.data = std::strtod(content.get<std::string>().c_str(), nullptr); break;
    case 3: value.data = content.get<std::string>(); break;
    case 4: {
      ConfigValue::Array array;
      for (const Json& entry : content) array.push_back(value_from(entry));
      value.data = std::move(array);
      break;
    }
    default: {
      ConfigValue::Table table;
      for (const Json& entry : content) table.emplace_back(entry.at(0).get<std::string>(), value_from(entry.at(1)));
      value.data = std::move(table);
    }
  }
  return value;
}

}  // namespace

std::string ConfigValue::type() const {
  static const char* const kNames[] = {"boolean", "integer", "number", "string", "array", "table"};
  return kNames[data.index()];
}

std::string ConfigValue::text() const {
  if (const auto* array = std::get_if<Array>(&data)) {
    std::vector<std::string> parts;
    for (const ConfigValue& value : *array) parts.push_back(value.text());
    return fmt::format("[{}]", fmt::join(parts, ", "));
  }
  if (const auto* table = std::get_if<Table>(&data)) {
    std::vector<std::string> parts;
    for (const auto& [key, value] : *table) parts.push_back(fmt::format("{} = {}", key_text(key), value.text()));
    return parts.empty() ? "{}" : fmt::format("{{ {} }}", fmt::join(parts, ", "));
  }
  if (const auto* flag = std::get_if<bool>(&data)) return *flag ? "true" : "false";
  if (const auto* integer = std::get_if<std::int64_t>(&data)) return fmt::format("{}", *integer);
  if (const auto* number = std::get_if<double>(&data)) {
    std::string text = fmt::format("{}", *number);
    if (text.find_first_of(".eni") == std::string::npos) text += ".0";
    return text;
  }
  return quoted(std::get<std::string>(data));
}

void throw_error(ExitCode code, const std::string& message) {
  switch (code) {
    case ExitCode::data: throw DataError(message);
    case ExitCode::solver: throw SolverError(message);
    default: throw UsageError(message);
  }
}

std::string ConfigNode::place() const {
  const std::string line = value_->line > 0 ? fmt::format("{}:{}", file_, value_->line) : file_;
  return path_.empty() ? line : fmt::format("{}: key '{}'", line, path_);
}

void ConfigNode::fail(const std::string& what) const { throw UsageError(place() + ": " + what); }

void ConfigNode::rethrow_located(const std::exception& error) const {
  if (const auto* known = dynamic_cast<const Error*>(&error)) {
    const std::string message = known->what();
    // A message that already names this file is complete.
    const std::string complete = message.rfind(file_, 0) == 0 ? message : place() + ": " + message;
    throw_error(known->exit_code(), complete);
  }
  if (dynamic_cast<const std::bad_alloc*>(&error) != nullptr) throw;
  throw UsageError(place() + ": " + error.what());
}

const ConfigValue::Table& ConfigNode::table() const {
  const auto* table = std::get_if<ConfigValue::Table>(&value_->data);
  if (table == nullptr) fail(fmt::format("expected a table, got {}", value_->text()));
  return *table;
}

std::string ConfigNode::name() const {
  const std::size_t dot = path_.rfind('.');
  return dot == std::string::npos ? path_ : path_.substr(dot + 1);
}

bool ConfigNode::has(const std::string& key) const {
  const auto& entries = table();
  return std::any_of(entries.begin(), entries.end(), [&](const auto& entry) { return entry.first == key; });
}

ConfigNode ConfigNode::at(const std::string& key) const {
  for (const auto& [name, value] : table()) {
    if (name == key) return {value, file_, path_.empty() ? key : path_ + "." + key};
  }
  fail(fmt::format("'{}' is missing", key));
}

std::vector<ConfigNode> ConfigNode::children() const {
  std::vector<ConfigNode> nodes;
  for (const auto& [name, value] : table()) {
    nodes.emplace_back(value, file_, path_.empty() ? name : path_ + "." + name);
  }
  return nodes;
}

std::vector<ConfigNode> ConfigNode::elements(bool or_single) const {
  const auto* array = std::get_if<ConfigValue::Array>(&value_->data);
  if (array == nullptr) {
    if (or_single) return {*this};
    fail(fmt::format("expected an array, got {}", value_->text()));
  }
  std::vector<ConfigNode> nodes;
  for (std::size_t i = 0; i < array->size(); ++i)
    nodes.emplace_back((*array)[i], file_, fmt::format("{}[{}]", path_, i));
  return nodes;
}

bool ConfigNode::boolean() const {
  if (const auto* flag = std::get_if<bool>(&value_->data)) return *flag;
  fail(fmt::format("expected true or false, got {}", value_->text()));
}

std::int64_t ConfigNode::integer() const {
  if (const auto* integer = std::get_if<std::int64_t>(&value_->data)) return *integer;
  fail(fmt::format("expected an integer, got {}", value_->text()));
}

double ConfigNode::number() const {
  if (const auto* number = std::get_if<double>(&value_->data)) return *number;
  if (const auto* integer = std::get_if<std::int64_t>(&value_->data)) return static_cast<double>(*integer);
  fail(fmt::format("expected a number, got {}", value_->text()));
}

std::string ConfigNode::string() const {
  if (const auto* text = std::get_if<std::string>(&value_->data)) return *text;
  fail(fmt::format("expected a string, got {}", value_->text()));
}

std::vector<double> ConfigNode::numbers() const {
  std::vector<double> result;
  for (const ConfigNode& node : elements()) result.push_back(node.number());
  return result;
}

std::vector<std::int64_t> ConfigNode::integers() const {
  std::vector<std::int64_t> result;
  for (const ConfigNode& node : elements()) result.push_back(node.integer());
  return result;
}

std::vector<std::string> ConfigNode::strings() const {
  std::vector<std::string> result;
  for (const ConfigNode& node : elements()) result.push_back(node.string());
  return result;
}

void ConfigNode::accept_keys(const std::vector<std::string>& keys) const {
  for (const auto& [name, value] : table()) {
    if (std::find(keys.begin(), keys.end(), name) == keys.end()) {
      ConfigNode(value, file_, path_.empty() ? name : path_ + "." + name)
          .fail(keys.empty() ? std::string("unknown key; none is accepted here")
                             : fmt::format("unknown key; accepted here: {}", fmt::join(keys, ", ")));
    }
  }
}

Parameters ConfigNode::parameters(const std::vector<Parameter>& declared,
                                  const std::vector<std::string>& others) const {
  std::vector<std::string> accepted = others;
  for (const Parameter& parameter : declared) accepted.push_back(parameter.name);
  accept_keys(accepted);
  Parameters parameters(declared);
  for (const auto& [name, value] : table()) {
    if (std::find(others.begin(), others.end(), name) != others.end()) continue;
    const ConfigNode node(value, file_, path_.empty() ? name : path_ + "." + name);
    node.located([&] {
      struct Visitor {
        const ConfigNode& node;
        ParameterValue operator()(bool flag) const { return flag; }
        ParameterValue operator()(std::int64_t integer) const { return integer; }
        ParameterValue operator()(double number) const { return number; }
        ParameterValue operator()(const std::string& text) const { return text; }
        ParameterValue operator()(const ConfigValue::Array&) const { return node.numbers(); }
        ParameterValue operator()(const ConfigValue::Table&) const { node.fail("expected a value, got a table"); }
      };
      parameters.set(name, std::visit(Visitor{node}, value.data));
      return 0;
    });
  }
  return parameters;
}

Config Config::load(const std::filesystem::path& file) {
  std::error_code ignored;
  if (std::filesystem::is_directory(file, ignored)) {
    throw UsageError(fmt::format("{}: is a folder, expected a TOML config", file.string()));
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw UsageError(fmt::format("{}: cannot be read", file.string()));
  std::stringstream text;
  text << stream.rdbuf();
  return parse(text.str(), file.string(), std::filesystem::absolute(file).parent_path());
}

Config Config::parse(const std::string& text, const std::string& name, const std::filesystem::path& folder) {
  Config config;
  config.file_ = name;
  config.folder_ = folder;
  config.root_ = parse_toml(text, name);
  return config;
}

void Config::set(const std::string& path, const ConfigValue& value) {
  const std::vector<PathPart> parts = split_path(path);
  ConfigValue* at = &root_;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    auto* table = std::get_if<ConfigValue::Table>(&at->data);
    if (table == nullptr)
      throw UsageError(fmt::format("key '{}': '{}' is inside a value that is no table", path, parts[i].key));
    const auto found =
        std::find_if(table->begin(), table->end(), [&](const auto& entry) { return entry.first == parts[i].key; });
    if (found == table->end()) {
      if (parts[i].index >= 0) throw UsageError(fmt::format("key '{}': there is no array '{}'", path, parts[i].key));
      // Plain values go in front of sub-tables, where a person would write them.
      const bool plain = i + 1 == parts.size() && !has_header(value);
      const auto place =
          plain ? std::find_if(table->begin(), table->end(), [](const auto& entry) { return has_header(entry.second); })
                : table->end();
      at = &table->emplace(place, parts[i].key, ConfigValue{})->second;
    } else {
      at = &found->second;
    }
    if (parts[i].index >= 0) {
      auto* array = std::get_if<ConfigValue::Array>(&at->data);
      if (array == nullptr || parts[i].index >= static_cast<int>(array->size())) {
        throw UsageError(fmt::format("key '{}': '{}' has no element {}", path, parts[i].key, parts[i].index));
      }
      at = &(*array)[static_cast<std::size_t>(parts[i].index)];
    }
  }
  *at = value;
}

std::string Config::set(const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw UsageError(fmt::format("--set {}: expected key=value", assignment));
  }
  const auto trimmed = [](std::string text) {
    const std::size_t first = text.find_first_not_of(" \t");
    const std::size_t last = text.find_last_not_of(" \t");
    return first == std::string::npos ? std::string() : text.substr(first, last - first + 1);
  };
  std::string path = trimmed(assignment.substr(0, equals));
  const std::string text = trimmed(assignment.substr(equals + 1));
  ConfigValue value;
  try {
    value = std::get<ConfigValue::Table>(parse_toml("value = " + text, "--set").data).front().second;
  } catch (const UsageError&) {
    value.data = text;  // names need no quotes on the command line
  }
  const auto unplaced = [](ConfigValue& v, const auto& self) -> void {
    v.line = 0;
    if (auto* array = std::get_if<ConfigValue::Array>(&v.data)) {
      for (ConfigValue& element : *array) self(element, self);
    } else if (auto* table = std::get_if<ConfigValue::Table>(&v.data)) {
      for (auto& entry : *table) self(entry.second, self);
    }
  };
  unplaced(value, unplaced);
  set(path, value);
  return path;
}

bool Config::erase(const std::string& path) {
  const std::vector<PathPart> parts = split_path(path);
  ConfigValue* at = &root_;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    auto* table = std::get_if<ConfigValue::Table>(&at->data);
    if (table == nullptr || parts[i].index >= 0) return false;
    const auto found =
        std::find_if(table->begin(), table->end(), [&](const auto& entry) { return entry.first == parts[i].key; });
    if (found == table->end()) return false;
    if (i + 1 == parts.size()) {
      table->erase(found);
      return true;
    }
    at = &found->second;
  }
  return false;
}

std::string Config::text() const {
  std::string out;
  write_table(std::get<ConfigValue::Table>(root_.data), "", out);
  return out;
}

std::string Config::message() const {
  return Json{{"file", file_}, {"folder", folder_.string()}, {"root", value_json(root_)}}.dump();
}

Config Config::from_message(const std::string& message) {
  try {
    const Json json = Json::parse(message);
    Config config;
    config.file_ = json.at("file").get<std::string>();
    config.folder_ = json.at("folder").get<std::string>();
    config.root_ = value_from(json.at("root"));
    return config;
  } catch (const Json::exception& error) {
    throw UsageError(fmt::format("no message of a config: {}", error.what()));
  }
}

}  // namespace variform
