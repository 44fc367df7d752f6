// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace variform {

/// Entry of a table: nothing, a flag, a count, a number or a text.
using Value = std::variant<std::monostate, bool, std::int64_t, double, std::string>;

/// Text of a value; numbers with the given count of significant digits (0: shortest text that reads back the same).
std::string to_text(const Value& value, int digits = 0);

/// The value as a number, flags as 0 and 1; NaN if it is none.
double to_number(const Value& value);

/// One tidy row: keys in order of appearance, each once.
class Row {
 public:
  void set(const std::string& key, Value value);
  /// nullptr when there is no such key.
  const Value* find(const std::string& key) const;
  const std::vector<std::pair<std::string, Value>>& entries() const { return entries_; }

 private:
  std::vector<std::pair<std::string, Value>> entries_;
};

/// What is known of a column: how it is shown.
struct Column {
  std::string key;
  std::string title = {};  ///< key if empty
  std::string unit = {};   ///< shown in the header if not empty
  int digits = 4;          ///< significant digits of numbers in Markdown and LaTeX
};

/// Rectangular table over rows that may lack keys.
struct Table {
  std::string caption = {};
  std::vector<Column> columns = {};
  std::vector<Row> rows = {};

  /// Columns for all keys of the rows, in order of first appearance.
  static Table of(const std::vector<Row>& rows);

  std::string csv() const;       ///< RFC 4180; full precision; header of keys
  std::string markdown() const;  ///< columns aligned; caption above; '|' escaped
  std::string latex() const;     ///< booktabs tabular; special characters escaped
  std::string json() const;      ///< array of flat objects; NaN and infinities as null
};

/// Text in the header of a column: title and unit.
std::string header_of(const Column& column);

/// True when the column holds nothing but numbers, at least one: set flush right.
bool is_numeric(const Table& table, const Column& column);

/// Adds a column "<key>_eoc" after `key`: the experimental order of convergence between consecutive rows,
/// log(e_i / e_{i+1}) / log(h_i / h_{i+1}) with h the column `size_key`. Empty in the first row and wherever it is
/// undefined.
void add_convergence_rate(Table& table, const std::string& key, const std::string& size_key);

}  // namespace variform
