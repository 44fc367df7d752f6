// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/experiment/escape.h"
#include "framework/experiment/json.h"

namespace variform {
namespace {

bool is_number(const Value& value) {
  return std::holds_alternative<double>(value) || std::holds_alternative<std::int64_t>(value);
}

bool is_empty(const Value* value) { return value == nullptr || std::holds_alternative<std::monostate>(*value); }

std::string csv_field(const std::string& text) {
  if (text.find_first_of("\",\r\n") == std::string::npos) return text;
  return fmt::format("\"{}\"", escape(text, {{'"', "\"\""}}));
}

std::string markdown_cell(const std::string& text) { return escape(text, {{'|', "\\|"}, {'\n', " "}, {'\r', " "}}); }

std::string latex_text(const std::string& text) {
  // '[' and '*' at the start of a row would be taken for arguments of the line break before.
  return escape(text, {{'\\', "\\textbackslash{}"},
                       {'{', "\\{"},
                       {'}', "\\}"},
                       {'#', "\\#"},
                       {'$', "\\$"},
                       {'%', "\\%"},
                       {'&', "\\&"},
                       {'_', "\\_"},
                       {'~', "\\textasciitilde{}"},
                       {'^', "\\textasciicircum{}"},
                       {'<', "\\textless{}"},
                       {'>', "\\textgreater{}"},
                       {'|', "\\textbar{}"},
                       {'"', "\\textquotedbl{}"},
                       {'[', "{[}"},
                       {'*', "{*}"},
                       {'\n', " "},
                       {'\r', " "}});
}

/// Numbers with a sign or an exponent need mathematical mode to look like numbers.
std::string latex_number(const std::string& text) {
  const std::size_t e = text.find('e');
  if (e != std::string::npos) {
    return fmt::format("${} \\times 10^{{{}}}$", text.substr(0, e), std::stoi(text.substr(e + 1)));
  }
  return text.front() == '-' ? fmt::format("${}$", text) : text;
}

std::string latex_cell(const Value& value, int digits) {
  const std::string text = to_text(value, digits);
  return is_number(value) ? latex_number(text) : latex_text(text);
}

/// Length in characters of UTF-8 text.
std::size_t length(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0u) != 0x80u; }));
}

}  // namespace

std::string to_text(const Value& value, int digits) {
  struct Printer {
    int digits;
    std::string operator()(std::monostate) const { return {}; }
    std::string operator()(bool flag) const { return flag ? "true" : "false"; }
    std::string operator()(std::int64_t count) const { return fmt::to_string(count); }
    std::string operator()(double number) const {
      if (std::isnan(number)) return "nan";  // whatever its sign bit
      return digits == 0 ? fmt::to_string(number) : fmt::format("{:.{}g}", number, digits);
    }
    std::string operator()(const std::string& text) const { return text; }
  };
  return std::visit(Printer{digits}, value);
}

double to_number(const Value& value) {
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? 1.0 : 0.0;
  if (const auto* count = std::get_if<std::int64_t>(&value)) return static_cast<double>(*count);
  if (const auto* number = std::get_if<double>(&value)) return *number;
  return std::numeric_limits<double>::quiet_NaN();
}

void Row::set(const std::string& key, Value value) {
  for (auto& [known, old] : entries_) {
    if (known == key) {
      old = std::move(value);
      return;
    }
  }
  entries_.emplace_back(key, std::move(value));
}

const Value* Row::find(const std::string& key) const {
  for (const auto& [known, value] : entries_) {
    if (known == key) return &value;
  }
  return nullptr;
}

Table Table::of(const std::vector<Row>& rows) {
  Table table{.rows = rows};
  for (const Row& row : rows) {
    for (const auto& [key, value] : row.entries()) {
      const bool is_known = std::any_of(table.columns.begin(), table.columns.end(),
                                        [&key = key](const Column& column) { return column.key == key; });
      if (!is_known) table.columns.push_back({.key = key});
    }
  }
  return table;
}

std::string Table::csv() const {
  const auto line = [this](const auto& text_of) {
    std::vector<std::string> fields;
    for (const Column& column : columns) fields.push_back(csv_field(text_of(column)));
    return fmt::format("{}\r\n", fmt::join(fields, ","));
  };
  std::string text = line([](const Column& column) { return column.key; });
  for (const Row& row : rows) {
    text += line([&row](const Column& column) {
      const Value* const value = row.find(column.key);
      return value == nullptr ? std::string() : to_text(*value);
    });
  }
  return text;
}

std::string Table::markdown() const {
  std::vector<std::string> lines(rows.size() + 2, "|");
  for (const Column& column : columns) {
    const bool is_right = is_numeric(*this, column);
    std::vector<std::string> cells = {markdown_cell(header_of(column)), {}};
    for (const Row& row : rows) {
      const Value* const value = row.find(column.key);
      cells.push_back(value == nullptr ? std::string() : markdown_cell(to_text(*value, column.digits)));
    }
    std::size_t width = 3;  // the least a rule may have
    for (const std::string& cell : cells) width = std::max(width, length(cell));
    cells[1] = is_right ? std::string(width - 1, '-') + ':' : std::string(width, '-');
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string padding(width - length(cells[i]), ' ');
      lines[i] += is_right ? fmt::format(" {}{} |", padding, cells[i]) : fmt::format(" {}{} |", cells[i], padding);
    }
  }
  const std::string above = caption.empty() ? std::string() : escape(caption, {{'\n', " "}, {'\r', " "}}) + "\n\n";
  return fmt::format("{}{}\n", above, fmt::join(lines, "\n"));
}

std::string Table::latex() const {
  std::string alignment;
  for (const Column& column : columns) alignment += is_numeric(*this, column) ? 'r' : 'l';
  const auto line = [this](const auto& text_of) {
    std::vector<std::string> cells;
    for (const Column& column : columns) cells.push_back(text_of(column));
    return fmt::format("{} \\\\\n", fmt::join(cells, " & "));
  };
  std::string text = fmt::format("\\begin{{tabular}}{{{}}}\n\\toprule\n", alignment);
  text += line([](const Column& column) { return latex_text(header_of(column)); });
  text += "\\midrule\n";
  for (const Row& row : rows) {
    text += line([&row](const Column& column) {
      const Value* const value = row.find(column.key);
      return value == nullptr ? std::string() : latex_cell(*value, column.digits);
    });
  }
  text += "\\bottomrule\n\\end{tabular}\n";
  if (caption.empty()) return text;
  return fmt::format("\\begin{{table}}\n\\centering\n\\caption{{{}}}\n{}\\end{{table}}\n", latex_text(caption), text);
}

std::string Table::json() const {
  std::vector<std::string> objects;
  for (const Row& row : rows) {
    Row shown;
    for (const Column& column : columns) {
      if (const Value* const value = row.find(column.key)) shown.set(column.key, *value);
    }
    objects.push_back(to_text(to_json(shown), -1));
  }
  return objects.empty() ? "[]\n" : fmt::format("[\n  {}\n]\n", fmt::join(objects, ",\n  "));
}

std::string header_of(const Column& column) {
  const std::string& title = column.title.empty() ? column.key : column.title;
  return column.unit.empty() ? title : fmt::format("{} [{}]", title, column.unit);
}

bool is_numeric(const Table& table, const Column& column) {
  bool has_number = false;
  for (const Row& row : table.rows) {
    const Value* const value = row.find(column.key);
    if (is_empty(value)) continue;
    if (!is_number(*value)) return false;
    has_number = true;
  }
  return has_number;
}

void add_convergence_rate(Table& table, const std::string& key, const std::string& size_key) {
  const auto number_at = [&table](std::size_t row, const std::string& name) {
    const Value* const value = table.rows[row].find(name);
    return value == nullptr ? std::numeric_limits<double>::quiet_NaN() : to_number(*value);
  };
  const std::string rate_key = key + "_eoc";
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    Value rate;
    if (i > 0) {
      // A difference of logarithms, not a logarithm of the ratio, is undefined where an error is not positive.
      const double order = (std::log(number_at(i - 1, key)) - std::log(number_at(i, key))) /
                           (std::log(number_at(i - 1, size_key)) - std::log(number_at(i, size_key)));
      if (std::isfinite(order)) rate = order;
    }
    table.rows[i].set(rate_key, rate);
  }
  const auto column =
      std::find_if(table.columns.begin(), table.columns.end(), [&key](const Column& c) { return c.key == key; });
  table.columns.insert(column == table.columns.end() ? column : column + 1,
                       {.key = rate_key, .title = "EOC", .unit = "", .digits = 3});
}

}  // namespace variform
