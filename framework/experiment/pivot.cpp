// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/pivot.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "framework/base/error.h"
#include "framework/experiment/config_keys.h"
#include "framework/experiment/known_keys.h"

namespace variform {
namespace {

constexpr std::array<const char*, 5> kAggregates = {"mean", "median", "min", "max", "count"};

bool is_aggregate(const std::string& name) {
  return name.empty() || std::find(kAggregates.begin(), kAggregates.end(), name) != kAggregates.end();
}

std::vector<std::string> strings_of(const ConfigNode& node, const char* key) {
  std::vector<std::string> strings;
  if (!node.has(key)) return strings;
  for (const ConfigNode& element : node.at(key).elements(true)) strings.push_back(element.string());
  return strings;
}

// The values of keys, as one text.
std::string combination(const Row& row, const std::vector<std::string>& keys) {
  std::vector<std::string> parts;
  for (const std::string& key : keys) {
    const Value* const value = row.find(key);
    parts.push_back(fmt::format("{} = {}", key, value == nullptr ? std::string() : to_text(*value)));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

// In headers numbers are short.
std::string header(const Row& row, const std::vector<std::string>& keys) {
  std::vector<std::string> parts;
  for (const std::string& key : keys) {
    const Value* const value = row.find(key);
    const std::string text = value == nullptr ? std::string() : to_text(*value, 4);
    const bool is_text = value != nullptr && std::holds_alternative<std::string>(*value);
    parts.push_back(is_text ? text : fmt::format("{} = {}", key.substr(key.rfind('.') + 1), text));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

bool is_empty(const Value* value) { return value == nullptr || std::holds_alternative<std::monostate>(*value); }

Value aggregated(std::vector<Value> values, const PivotRequest& request, const std::string& cell) {
  if (values.empty()) return {};
  if (request.aggregate.empty()) {
    if (values.size() > 1) {
      throw UsageError(fmt::format("{} rows for {}: name more keys, or an aggregate: {}", values.size(), cell,
                                   fmt::join(kAggregates, ", ")));
    }
    return values.front();
  }
  if (request.aggregate == "count") return static_cast<std::int64_t>(values.size());
  std::vector<double> numbers;
  for (const Value& value : values) {
    if (std::holds_alternative<std::string>(value)) {
      throw UsageError(
          fmt::format("'{}' is the text \"{}\", which has no {}", request.value, to_text(value), request.aggregate));
    }
    if (const double number = to_number(value); std::isfinite(number)) numbers.push_back(number);
  }
  if (numbers.empty()) return {};
  std::sort(numbers.begin(), numbers.end());
  const std::size_t count = numbers.size();
  if (request.aggregate == "min") return numbers.front();
  if (request.aggregate == "max") return numbers.back();
  if (request.aggregate == "mean") {
    return std::accumulate(numbers.begin(), numbers.end(), 0.0) / static_cast<double>(count);
  }
  return count % 2 == 1 ? numbers[count / 2] : 0.5 * (numbers[count / 2 - 1] + numbers[count / 2]);
}

void require_keys(const std::vector<Row>& rows, const PivotRequest& request) {
  std::vector<std::string> there;
  for (const Column& column : Table::of(rows).columns) there.push_back(column.key);
  KnownKeys known;
  known.add("keys of the rows", there);
  std::vector<std::string> wanted = request.rows;
  wanted.insert(wanted.end(), request.columns.begin(), request.columns.end());
  wanted.push_back(request.value);
  for (const std::string& key : wanted) known.require(key, "no row has");
}

}  // namespace

PivotRequest read_pivot(const ConfigNode& node) {
  node.accept_keys(config_section("[[output.pivot]]").names());
  PivotRequest request{.rows = strings_of(node, "rows"),
                       .columns = strings_of(node, "columns"),
                       .value = node.at("value").string(),
                       .aggregate = node.string_or("aggregate", "")};
  if (request.rows.empty() && request.columns.empty()) node.fail("expected 'rows', 'columns' or both");
  if (!is_aggregate(request.aggregate)) {
    node.at("aggregate").fail(fmt::format("expected one of {}", fmt::join(kAggregates, ", ")));
  }
  return request;
}

Table pivot(const std::vector<Row>& rows, const PivotRequest& request) {
  if (!is_aggregate(request.aggregate)) {
    throw UsageError(
        fmt::format("there is no aggregate '{}'; expected one of {}", request.aggregate, fmt::join(kAggregates, ", ")));
  }
  if (!rows.empty()) require_keys(rows, request);
  struct Line {
    std::string name;
    Row row;
    std::vector<std::vector<Value>> cells;
  };
  std::vector<Line> lines;
  std::vector<Column> columns;
  for (const Row& row : rows) {
    const std::string line_name = combination(row, request.rows);
    const std::string column_name = request.columns.empty() ? request.value : combination(row, request.columns);
    auto line = std::find_if(lines.begin(), lines.end(), [&](const Line& l) { return l.name == line_name; });
    if (line == lines.end()) {
      Row keys;
      for (const std::string& key : request.rows) {
        if (const Value* const value = row.find(key)) keys.set(key, *value);
      }
      line = lines.insert(lines.end(), {line_name, keys, {}});
    }
    auto column = std::find_if(columns.begin(), columns.end(), [&](const Column& c) { return c.key == column_name; });
    if (column == columns.end()) {
      const std::string title = request.columns.empty() ? request.value : header(row, request.columns);
      column = columns.insert(columns.end(), {.key = column_name, .title = title});
    }
    const auto place = static_cast<std::size_t>(column - columns.begin());
    line->cells.resize(std::max(line->cells.size(), place + 1));
    if (const Value* const value = row.find(request.value); !is_empty(value)) line->cells[place].push_back(*value);
  }
  Table table;
  table.caption = request.value;
  if (!request.aggregate.empty()) table.caption = fmt::format("{} of {}", request.aggregate, request.value);
  for (const std::string& key : request.rows) table.columns.push_back({.key = key});
  table.columns.insert(table.columns.end(), columns.begin(), columns.end());
  for (Line& line : lines) {
    for (std::size_t i = 0; i < line.cells.size(); ++i) {
      const std::string cell = line.name.empty()         ? columns[i].key
                               : request.columns.empty() ? line.name
                                                         : line.name + ", " + columns[i].key;
      line.row.set(columns[i].key, aggregated(std::move(line.cells[i]), request, cell));
    }
    table.rows.push_back(std::move(line.row));
  }
  return table;
}

}  // namespace variform
