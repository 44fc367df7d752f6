// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <limits>

#include "framework/base/error.h"
#include "framework/experiment/pivot.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

Row row_of(const std::string& method, double beta, std::int64_t seed, Value energy) {
  Row row;
  row.set("energy.type", method);
  row.set("norm.beta", beta);
  row.set("seed", seed);
  if (!std::holds_alternative<std::monostate>(energy)) row.set("E", std::move(energy));
  row.set("status", std::string("ok"));
  return row;
}

/// Two methods, two betas, three seeds; one point of arap at 0.2 has no energy.
std::vector<Row> study() {
  return {row_of("asap", 0.0, 1, 4.0), row_of("asap", 0.0, 2, 1.0),    row_of("asap", 0.0, 3, 7.0),
          row_of("asap", 0.2, 1, 2.0), row_of("asap", 0.2, 2, 8.0),    row_of("arap", 0.0, 1, 5.0),
          row_of("arap", 0.2, 1, 6.0), row_of("arap", 0.2, 2, Value())};
}

std::string csv(const std::string& aggregate) {
  return pivot(study(), {.rows = {"energy.type"}, .columns = {"norm.beta"}, .value = "E", .aggregate = aggregate})
      .csv();
}

std::string error_of(const PivotRequest& request) {
  try {
    pivot(study(), request);
  } catch (const UsageError& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted";
  return {};
}

TEST(Pivot, CellsAggregateTheRowsOfTheirKeys) {
  const std::string header = "energy.type,norm.beta = 0,norm.beta = 0.2\r\n";
  EXPECT_EQ(csv("mean"), header + "asap,4,5\r\narap,5,6\r\n");
  EXPECT_EQ(csv("median"), header + "asap,4,5\r\narap,5,6\r\n");
  EXPECT_EQ(csv("min"), header + "asap,1,2\r\narap,5,6\r\n");
  EXPECT_EQ(csv("max"), header + "asap,7,8\r\narap,5,6\r\n");
  EXPECT_EQ(csv("count"), header + "asap,3,2\r\narap,1,1\r\n") << "a row without the metric does not count";
}

TEST(Pivot, WithoutAggregateACellIsTheValueOfItsOneRow) {
  EXPECT_EQ(pivot(study(), {.rows = {"energy.type", "norm.beta"}, .columns = {"seed"}, .value = "E"}).csv(),
            "energy.type,norm.beta,seed = 1,seed = 2,seed = 3\r\n"
            "asap,0,4,1,7\r\nasap,0.2,2,8,\r\narap,0,5,,\r\narap,0.2,6,,\r\n");
  EXPECT_EQ(pivot({study()[0]}, {.rows = {"seed"}, .columns = {"energy.type"}, .value = "status"}).csv(),
            "seed,energy.type = asap\r\n1,ok\r\n")
      << "texts, too";
  EXPECT_THAT(error_of({.rows = {"energy.type"}, .columns = {"norm.beta"}, .value = "E"}),
              HasSubstr("3 rows for energy.type = asap, norm.beta = 0: name more keys, or an aggregate: mean, median"));
}

TEST(Pivot, RowsOrColumnsAloneWillDo) {
  EXPECT_EQ(pivot(study(), {.rows = {"norm.beta"}, .value = "E", .aggregate = "max"}).csv(),
            "norm.beta,E\r\n0,7\r\n0.2,8\r\n");
  EXPECT_EQ(pivot(study(), {.columns = {"energy.type"}, .value = "E", .aggregate = "count"}).csv(),
            "energy.type = asap,energy.type = arap\r\n5,2\r\n");
}

TEST(Pivot, NumbersThatAreNotFiniteAreLeftOutOfAggregates) {
  const std::vector<Row> rows = {row_of("asap", 0.0, 1, std::numeric_limits<double>::quiet_NaN()),
                                 row_of("asap", 0.0, 2, 3.0),
                                 row_of("asap", 0.0, 3, std::numeric_limits<double>::infinity())};
  EXPECT_EQ(pivot(rows, {.rows = {"energy.type"}, .value = "E", .aggregate = "mean"}).csv(),
            "energy.type,E\r\nasap,3\r\n");
}

TEST(Pivot, FlagsCountAsNumbersInAggregates) {
  std::vector<Row> rows = study();
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].set("converged", i % 4 == 0);
  EXPECT_EQ(pivot(rows, {.rows = {"status"}, .value = "converged", .aggregate = "mean"}).csv(),
            "status,converged\r\nok,0.25\r\n");
}

TEST(Pivot, HeadersAreShortForPeopleAndFullForPrograms) {
  const Table table = pivot({row_of("asap", 1.0 / 3.0, 1, 2.0)},
                            {.columns = {"energy.type", "norm.beta"}, .value = "E", .aggregate = "mean"});
  EXPECT_EQ(table.columns[0].title, "asap, beta = 0.3333");
  EXPECT_EQ(table.columns[0].key, "energy.type = asap, norm.beta = 0.3333333333333333");
  EXPECT_EQ(table.caption, "mean of E");
}

TEST(Pivot, UnknownKeysAndWrongAggregatesAreErrorsThatNameWhatIsThere) {
  EXPECT_THAT(error_of({.rows = {"norm.bta"}, .value = "E"}),
              HasSubstr("no row has 'norm.bta' (did you mean 'norm.beta'?); accepted: keys of the rows: energy.type, "
                        "norm.beta, seed, E, status"));
  EXPECT_THAT(error_of({.rows = {"seed"}, .value = "F"}), HasSubstr("no row has 'F'"));
  EXPECT_THAT(error_of({.rows = {"seed"}, .value = "E", .aggregate = "sum"}), HasSubstr("no aggregate 'sum'"));
  EXPECT_THAT(error_of({.rows = {"seed"}, .value = "status", .aggregate = "mean"}),
              HasSubstr("'status' is the text \"ok\", which has no mean"));
}

TEST(Pivot, RequestsAreReadFromConfigs) {
  const Config config = Config::parse(
      "p = { rows = \"a\", columns = [\"b\", \"c\"], value = \"E\", aggregate = \"max\" }\n"
      "q = { value = \"E\" }\nr = { rows = \"a\", value = \"E\", aggregate = \"sum\" }\n",
      "study.toml", ".");
  const PivotRequest request = read_pivot(config.root().at("p"));
  EXPECT_EQ(request.rows, std::vector<std::string>{"a"});
  EXPECT_EQ(request.columns, (std::vector<std::string>{"b", "c"}));
  EXPECT_EQ(request.value, "E");
  EXPECT_EQ(request.aggregate, "max");
  EXPECT_THROW(read_pivot(config.root().at("q")), UsageError);
  EXPECT_THROW(read_pivot(config.root().at("r")), UsageError);
}

}  // namespace
}  // namespace variform
