// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "framework/experiment/table.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Row row_of(std::initializer_list<std::pair<std::string, Value>> entries) {
  Row row;
  for (const auto& [key, value] : entries) row.set(key, value);
  return row;
}

/// Two rows that lack different keys.
Table small_table() {
  Table table = Table::of({row_of({{"name", std::string("a_1")}, {"cells", std::int64_t{12}}, {"error", 1.25e-7}}),
                           row_of({{"name", std::string("b|c")}, {"error", -0.123456}, {"ok", true}})});
  table.columns[2] = {.key = "error", .title = "", .unit = "%"};
  return table;
}

TEST(Value, TextOfEveryAlternative) {
  EXPECT_EQ(to_text(Value()), "");
  EXPECT_EQ(to_text(false), "false");
  EXPECT_EQ(to_text(std::int64_t{-7}), "-7");
  EXPECT_EQ(to_text(0.1), "0.1");
  EXPECT_EQ(to_text(1.0 / 3.0), "0.3333333333333333");
  EXPECT_EQ(to_text(1.0 / 3.0, 3), "0.333");
  EXPECT_EQ(to_text(-kNaN), "nan");
  EXPECT_EQ(to_text(-kInfinity, 3), "-inf");
  EXPECT_EQ(to_text(std::string("text")), "text");
}

TEST(Value, NumberOfEveryAlternative) {
  EXPECT_EQ(to_number(2.5), 2.5);
  EXPECT_EQ(to_number(std::int64_t{3}), 3.0);
  EXPECT_EQ(to_number(true), 1.0);
  EXPECT_TRUE(std::isnan(to_number(Value())));
  EXPECT_TRUE(std::isnan(to_number(std::string("3"))));
}

TEST(Row, KeepsTheOrderOfKeysAndTheLastValue) {
  const Row row = row_of({{"b", 1.0}, {"a", 2.0}, {"b", 3.0}});
  ASSERT_EQ(row.entries().size(), 2u);
  EXPECT_EQ(row.entries()[0].first, "b");
  EXPECT_EQ(std::get<double>(*row.find("b")), 3.0);
  EXPECT_EQ(row.find("c"), nullptr);
}

TEST(Table, Csv) {
  EXPECT_EQ(small_table().csv(),
            "name,cells,error,ok\r\n"
            "a_1,12,1.25e-07,\r\n"
            "b|c,,-0.123456,true\r\n");
}

TEST(Table, CsvQuotesWhatHasSeparators) {
  const Table table = Table::of({row_of({{"a,b", std::string("say \"hi\"")}, {"c", std::string("two\nlines")}})});
  EXPECT_EQ(table.csv(), "\"a,b\",c\r\n\"say \"\"hi\"\"\",\"two\nlines\"\r\n");
}

TEST(Table, Markdown) {
  Table table = small_table();
  table.caption = "Errors";
  EXPECT_EQ(table.markdown(),
            "Errors\n"
            "\n"
            "| name | cells | error [%] | ok   |\n"
            "| ---- | ----: | --------: | ---- |\n"
            "| a_1  |    12 |  1.25e-07 |      |\n"
            "| b\\|c |       |   -0.1235 | true |\n");
}

TEST(Table, MarkdownAlignsByCharactersNotBytes) {
  const Table table = Table::of({row_of({{"β", std::string("äöü")}}), row_of({{"β", std::string("long")}})});
  EXPECT_EQ(table.markdown(), "| β    |\n| ---- |\n| äöü  |\n| long |\n");
}

TEST(Table, Latex) {
  EXPECT_EQ(small_table().latex(),
            "\\begin{tabular}{lrrl}\n"
            "\\toprule\n"
            "name & cells & error {[}\\%] & ok \\\\\n"
            "\\midrule\n"
            "a\\_1 & 12 & $1.25 \\times 10^{-7}$ &  \\\\\n"
            "b\\textbar{}c &  & $-0.1235$ & true \\\\\n"
            "\\bottomrule\n"
            "\\end{tabular}\n");
}

TEST(Table, LatexEscapesEverySpecialCharacter) {
  Table table = Table::of({row_of({{"x", std::string("\\{}#$%&_~^")}})});
  table.caption = "50 % & more";
  const std::string text = table.latex();
  EXPECT_THAT(text, HasSubstr("\\textbackslash{}\\{\\}\\#\\$\\%\\&\\_\\textasciitilde{}\\textasciicircum{} \\\\"));
  EXPECT_THAT(text, HasSubstr("\\begin{table}\n\\centering\n\\caption{50 \\% \\& more}\n\\begin{tabular}{l}"));
}

TEST(Table, Json) {
  EXPECT_EQ(small_table().json(),
            "[\n"
            "  {\"name\":\"a_1\",\"cells\":12,\"error\":1.25e-07},\n"
            "  {\"name\":\"b|c\",\"error\":-0.123456,\"ok\":true}\n"
            "]\n");
  EXPECT_EQ(Table().json(), "[]\n");
}

TEST(Table, JsonHasNoNaN) {
  const Table table = Table::of({row_of({{"a", kNaN}, {"b", -kInfinity}, {"c", Value()}})});
  EXPECT_EQ(table.json(), "[\n  {\"a\":null,\"b\":null,\"c\":null}\n]\n");
  EXPECT_EQ(table.csv(), "a,b,c\r\nnan,-inf,\r\n");
}

TEST(ConvergenceRate, IsTwoForQuadraticErrors) {
  std::vector<Row> rows;
  for (const double h : {0.5, 0.25, 0.1}) rows.push_back(row_of({{"h", h}, {"e", h * h}, {"note", true}}));
  Table table = Table::of(rows);
  add_convergence_rate(table, "e", "h");
  ASSERT_EQ(table.columns.size(), 4u);
  EXPECT_EQ(table.columns[2].key, "e_eoc");
  EXPECT_EQ(to_text(*table.rows[0].find("e_eoc")), "");
  EXPECT_NEAR(to_number(*table.rows[1].find("e_eoc")), 2.0, 1e-12);
  EXPECT_NEAR(to_number(*table.rows[2].find("e_eoc")), 2.0, 1e-12);
}

TEST(ConvergenceRate, IsEmptyWhereUndefined) {
  // An exact row, a negative error, equal sizes, a missing error.
  Table table = Table::of({row_of({{"h", 1.0}, {"e", 1.0}}), row_of({{"h", 0.5}, {"e", 0.0}}),
                           row_of({{"h", 0.25}, {"e", -1.0}}), row_of({{"h", 0.125}, {"e", -2.0}}),
                           row_of({{"h", 0.1}, {"e", 1.0}}), row_of({{"h", 0.1}, {"e", 0.5}}), row_of({{"h", 0.05}})});
  add_convergence_rate(table, "e", "h");
  for (const Row& row : table.rows) EXPECT_EQ(to_text(*row.find("e_eoc")), "");
}

}  // namespace
}  // namespace variform
