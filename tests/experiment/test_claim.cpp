// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <limits>
#include <string>
#include <vector>

#include "framework/base/error.h"
#include "framework/experiment/claim.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr auto kHolds = Verdict::Outcome::holds;
constexpr auto kFails = Verdict::Outcome::fails;
constexpr auto kUndecided = Verdict::Outcome::undecided;

Row row_of(std::initializer_list<std::pair<std::string, Value>> entries) {
  Row row;
  for (const auto& [key, value] : entries) row.set(key, value);
  return row;
}

/// Claims are read as configs give them, so that reading and deciding are tested together.
Claim claim_of(const std::string& text) {
  const Config config = Config::parse("text = \"statement\"\n" + text, "study.toml", "");
  return read_claim(config.root());
}

const std::vector<std::string> kSwept = {"type", "beta"};

/// Two energies, three betas: E rises for a, falls for b; flips only without regularization.
std::vector<Row> study() {
  const auto row = [](const char* type, double beta, double E, std::int64_t flipped) {
    return row_of({{"type", std::string(type)}, {"beta", beta}, {"E", E}, {"flipped", flipped}});
  };
  return {row("a", 0.0, 1.0, 3), row("a", 0.2, 2.0, 0), row("a", 0.4, 3.0, 0),
          row("b", 0.0, 8.0, 1), row("b", 0.2, 4.0, 0), row("b", 0.4, 2.0, 0)};
}

Verdict verdict_on(const std::string& claim, const std::vector<Row>& rows = study()) {
  return decide(claim_of(claim), rows, kSwept);
}

Verdict::Outcome outcome_of(const std::string& claim, const std::vector<Row>& rows = study()) {
  return verdict_on(claim, rows).outcome;
}

std::string reading_error(const std::string& claim) {
  try {
    claim_of(claim);
  } catch (const UsageError& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted: " << claim;
  return {};
}

TEST(Condition, ComparesNumbersTextsAndFlags) {
  const Row row = row_of({{"n", std::int64_t{2}}, {"x", 0.5}, {"s", std::string("a")}, {"ok", true}});
  for (const char* met : {"", "n == 2", "n != 3", "n < 2.5", "n <= 2", "n > 1e0", "n>=2", "x==0.5", "s == \"a\"",
                          "s == 'a'", "s != 'b'", "ok == true", "ok != false", "n > 1 and x < 1 and s == 'a'"}) {
    EXPECT_TRUE(Condition(met).holds(row)) << met;
  }
  for (const char* unmet : {"n == 3", "n != 2", "n < 2", "n <= 1.9", "n > 2", "n >= 3", "s == 'b'", "s != 'a'",
                            "ok == false", "n > 1 and x > 1", "x > 1 and n > 1"}) {
    EXPECT_FALSE(Condition(unmet).holds(row)) << unmet;
  }
}

TEST(Condition, ValuesInQuotesMayHoldAnything) {
  const Row row = row_of({{"s", std::string("this and that")}, {"move", std::string("{ kind = \"a\" }")}, {"n", 1.0}});
  EXPECT_TRUE(Condition("s == 'this and that' and n == 1").holds(row));
  EXPECT_TRUE(Condition("n == 1 and s == \"this and that\"").holds(row));
  EXPECT_TRUE(Condition("move == \"{ kind = \"a\" }\" and n == 1").holds(row));
  EXPECT_FALSE(Condition("s == 'this and' and n == 1").holds(row));
}

TEST(Condition, NotANumberStandsInNoRelation) {
  const Row row = row_of({{"x", kNaN}, {"empty", Value()}});
  for (const std::string relation : {"==", "!=", "<", "<=", ">", ">="}) {
    EXPECT_FALSE(Condition("x " + relation + " 1").holds(row)) << relation;
    EXPECT_FALSE(Condition("empty " + relation + " 1").holds(row)) << relation;
  }
}

TEST(Condition, NamesItsKeys) {
  EXPECT_THAT(Condition("norm.beta > 0 and energy.type == 'arap'").keys(), ElementsAre("norm.beta", "energy.type"));
  EXPECT_TRUE(Condition("").keys().empty());
}

TEST(Condition, RefusesWhatMakesNoSense) {
  for (const char* text : {"beta", "beta > ", "beta > high", "> 0", "beta = 0", "a == 1 and", "a == 1 and and b == 2",
                           "a == 1 or b == 2", "s < 'x'", "ok >= true", "a == nan", "a < inf", "s == 'open"}) {
    EXPECT_THROW(Condition{text}, UsageError) << text;
  }
  EXPECT_THROW(Condition("absent > 0").holds(row_of({{"x", 1.0}})), UsageError);
  EXPECT_THROW(Condition("s > 0").holds(row_of({{"s", std::string("1")}})), UsageError);
}

TEST(Claim, EveryComparisonHoldsAndFails) {
  const std::vector<Row> rows = {row_of({{"m", 2.0}}), row_of({{"m", std::int64_t{2}}})};
  for (const char* is : {"== 2", "!= 3", "< 3", "<= 2", "> 1", ">= 2", "<=2.0"}) {
    EXPECT_EQ(outcome_of("metric = 'm'\nis = '" + std::string(is) + "'", rows), kHolds) << is;
  }
  for (const char* is : {"== 3", "!= 2", "< 2", "<= 1", "> 2", ">= 3"}) {
    const Verdict verdict = verdict_on("metric = 'm'\nis = '" + std::string(is) + "'", rows);
    EXPECT_EQ(verdict.outcome, kFails) << is;
    EXPECT_THAT(verdict.reason, HasSubstr("does not hold")) << is;
  }
}

TEST(Claim, VerdictTellsStatementConditionPublishedAndOurs) {
  const Verdict verdict =
      verdict_on("published = '0'\nwhere = 'beta > 0'\nmetric = 'flipped'\nis = '== 0'\nquantifier = 'all'");
  EXPECT_EQ(verdict.outcome, kHolds);
  EXPECT_EQ(verdict.text, "statement");
  EXPECT_EQ(verdict.published, "0");
  EXPECT_EQ(verdict.condition, "flipped == 0, where beta > 0");
  EXPECT_EQ(verdict.ours, "0 (4 rows)");
  EXPECT_EQ(verdict.reason, "");
  EXPECT_EQ(verdict_on("metric = 'E'\nis = '> 0'").ours, "1 to 8 (6 rows)");
}

TEST(Claim, AllAndAny) {
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 0'"), kFails);
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 0'\nquantifier = 'any'"), kHolds);
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 3'\nquantifier = 'any'"), kFails);
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 0'\nwhere = 'beta == 0'"), kHolds);
}

TEST(Claim, MedianAndShareOfTheRows) {
  // Two of six rows have flipped cells.
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '== 0'\nquantifier = 'median'"), kHolds);
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 0'\nquantifier = 'median'"), kFails);
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 0'\nshare = 0.33"), kHolds);
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = '> 0'\nshare = 0.34"), kFails);
  EXPECT_THAT(verdict_on("metric = 'flipped'\nis = '> 0'\nshare = 0.34").reason, HasSubstr("2 of 6 rows"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nshare = 1.5"), HasSubstr("key 'share'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nshare = 0.5\nquantifier = 'any'"), HasSubstr("key 'share'"));
}

TEST(Claim, RelativeToDividesByTheRowThatAgreesInAllOtherSweptKeys) {
  // a: 2, 3; b: 0.5, 0.25.
  EXPECT_EQ(verdict_on("metric = 'E'\nis = '> 0'\nwhere = 'beta > 0'\nrelative_to = 'beta == 0'").ours,
            "0.25 to 3 (4 rows)");
  EXPECT_EQ(outcome_of("metric = 'E'\nis = '<= 0.5'\nwhere = \"beta > 0 and type == 'b'\"\nrelative_to = 'beta == 0'"),
            kHolds);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = '<= 0.5'\nwhere = 'beta > 0'\nrelative_to = 'beta == 0'"), kFails);
  // Across types at equal beta: 8/1, 4/2, 2/3.
  EXPECT_EQ(verdict_on("metric = 'E'\nis = '> 0'\nwhere = \"type == 'b'\"\nrelative_to = \"type == 'a'\"").ours,
            "0.6667 to 8 (3 rows)");
}

TEST(Claim, MinusSubtractsIt) {
  EXPECT_EQ(verdict_on("metric = 'E'\nis = '> 0'\nwhere = 'beta > 0'\nminus = 'beta == 0'").ours, "-6 to 2 (4 rows)");
  EXPECT_EQ(outcome_of("metric = 'E'\nis = '>= 1'\nwhere = \"beta > 0 and type == 'a'\"\nminus = 'beta == 0'"), kHolds);
}

TEST(Claim, AKeyThatIsPartOfAnotherIsNoReference) {
  // "beta" stands in "beta2": the condition is on beta2 alone, so rows still have to agree in beta.
  std::vector<Row> rows;
  for (const double beta : {1.0, 2.0}) {
    for (const double beta2 : {0.0, 1.0}) {
      rows.push_back(row_of({{"beta", beta}, {"beta2", beta2}, {"E", 10.0 * beta * (1.0 + beta2)}}));
    }
  }
  const Verdict verdict = decide(claim_of("metric = 'E'\nis = '== 2'\nwhere = 'beta2 > 0'\nrelative_to = 'beta2 == 0'"),
                                 rows, {"beta", "beta2"});
  EXPECT_EQ(verdict.outcome, kHolds) << verdict.reason;
}

TEST(Claim, MonotoneRelationsGroupByTheOtherSweptKeys) {
  const std::string a = "\nalong = 'beta'\nwhere = \"type == 'a'\"";
  const std::string b = "\nalong = 'beta'\nwhere = \"type == 'b'\"";
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'increasing'" + a), kHolds);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'nondecreasing'" + a), kHolds);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'decreasing'" + a), kFails);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'nonincreasing'" + a), kFails);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'decreasing'" + b), kHolds);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'increasing'" + b), kFails);
  // Both groups fall in steps, whatever lies between the groups.
  EXPECT_EQ(outcome_of("metric = 'flipped'\nis = 'nonincreasing'\nalong = 'beta'"), kHolds);
  const Verdict strict = verdict_on("metric = 'flipped'\nis = 'decreasing'\nalong = 'beta'");
  EXPECT_EQ(strict.outcome, kFails);
  EXPECT_THAT(strict.reason, HasSubstr("0 is followed by 0 at beta = 0.4"));
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'increasing'\nalong = 'beta'"), kFails);
}

TEST(Claim, MonotoneRelationsOrderRowsThemselves) {
  std::vector<Row> rows = study();
  std::reverse(rows.begin(), rows.end());
  std::swap(rows[0], rows[1]);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = 'increasing'\nalong = 'beta'\nwhere = \"type == 'a'\"", rows), kHolds);
}

TEST(Claim, ToleranceIsSlackOfMonotoneRelations) {
  const std::vector<Row> rows = {row_of({{"beta", 0.0}, {"E", 1.0}}), row_of({{"beta", 1.0}, {"E", 1.001}})};
  const auto outcome = [&](const std::string& is, const std::string& tolerance) {
    return decide(claim_of("metric = 'E'\nalong = 'beta'\nis = '" + is + "'\n" + tolerance), rows, {"beta"}).outcome;
  };
  EXPECT_EQ(outcome("nonincreasing", ""), kFails);
  EXPECT_EQ(outcome("nonincreasing", "tolerance = 0.01"), kHolds);
  EXPECT_EQ(outcome("increasing", ""), kHolds);
  EXPECT_EQ(outcome("increasing", "tolerance = 0.01"), kFails);
}

TEST(Claim, NothingToDecideOnIsUndecided) {
  const auto reason = [](const std::string& claim, const std::vector<Row>& rows) {
    const Verdict verdict = verdict_on(claim, rows);
    EXPECT_EQ(verdict.outcome, kUndecided) << claim;
    return verdict.reason;
  };
  const std::vector<Row> rows = study();
  for (const std::string quantifier : {"all", "any"}) {
    const std::string any = "\nquantifier = '" + quantifier + "'";
    EXPECT_EQ(reason("metric = 'E'\nis = '> 0'" + any, {}), "no row matches");
    EXPECT_EQ(reason("metric = 'E'\nis = '> 0'\nwhere = 'beta > 1'" + any, rows), "no row matches");
    EXPECT_THAT(reason("metric = 'typo'\nis = '!= 0'" + any, rows), HasSubstr("'typo' is not a number"));
    EXPECT_THAT(reason("metric = 'type'\nis = '!= 0'" + any, rows), HasSubstr("'type' is not a number"));
    EXPECT_THAT(reason("metric = 'E'\nis = '> 0'\nwhere = 'betta > 0'" + any, rows), HasSubstr("no key 'betta'"));
    EXPECT_THAT(reason("metric = 'E'\nis = '> 0'\nwhere = 'type > 0'" + any, rows), HasSubstr("no number"));
  }
  EXPECT_EQ(reason("metric = 'E'\nis = 'increasing'\nalong = 'beta'", {}), "no row matches");
  EXPECT_THAT(reason("metric = 'E'\nis = 'increasing'\nalong = 'beta'\nwhere = 'beta == 0'", rows),
              HasSubstr("fewer than two rows along 'beta'"));
  EXPECT_THAT(reason("metric = 'E'\nis = 'increasing'\nalong = 'betta'", rows), HasSubstr("'betta' is not a number"));
  EXPECT_THAT(reason("metric = 'E'\nis = 'increasing'\nalong = 'type'", rows), HasSubstr("'type' is not a number"));
  EXPECT_THAT(reason("metric = 'E'\nis = '> 0'\nrelative_to = 'beta == 9'", rows), HasSubstr("no row with 'E'"));
  EXPECT_THAT(reason("metric = 'E'\nis = '> 0'\nrelative_to = 'beta < 0.3'", rows), HasSubstr("more than one row"));
  EXPECT_THAT(reason("metric = 'E'\nis = '> 0'\nminus = 'betta == 0'", rows), HasSubstr("no key 'betta'"));
}

TEST(Claim, OneGroupOfASingleRowLeavesAMonotoneClaimUndecided) {
  std::vector<Row> rows = study();
  rows.resize(4);  // of type b, only beta = 0 is left
  const Verdict verdict = verdict_on("metric = 'flipped'\nis = 'nonincreasing'\nalong = 'beta'", rows);
  EXPECT_EQ(verdict.outcome, kUndecided);
  EXPECT_THAT(verdict.reason, HasSubstr("type=b"));
}

TEST(Claim, ValuesThatAreNoNumbersNeverHold) {
  for (const double bad : {kNaN, kInfinity, -kInfinity}) {
    std::vector<Row> rows = study();
    rows[4].set("E", bad);
    for (const char* claim : {"metric = 'E'\nis = '!= 0'", "metric = 'E'\nis = '> 0'\nquantifier = 'any'",
                              "metric = 'E'\nis = 'decreasing'\nalong = 'beta'\nwhere = \"type == 'b'\"",
                              "metric = 'E'\nis = '> 0'\nminus = 'beta == 0.2'\nwhere = 'beta == 0'"}) {
      EXPECT_EQ(outcome_of(claim, rows), kUndecided) << claim << " with " << bad;
    }
    EXPECT_EQ(outcome_of("metric = 'E'\nis = '> 0'\nwhere = 'beta == 0'", rows), kHolds);
  }
  std::vector<Row> rows = study();
  rows[0].set("E", 0.0);
  EXPECT_EQ(outcome_of("metric = 'E'\nis = '> 0'\nwhere = 'beta > 0'\nrelative_to = 'beta == 0'", rows), kUndecided);
}

TEST(Claim, ReadingNamesThePlaceOfWhatMakesNoSense) {
  EXPECT_THAT(reading_error("metric = 'm'"), HasSubstr("'is' is missing"));
  EXPECT_THAT(reading_error("is = '> 0'"), HasSubstr("'metric' is missing"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = 'about 3'"), HasSubstr("study.toml:3: key 'is'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '== nan'"), HasSubstr("study.toml:3: key 'is'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0 or so'"), HasSubstr("expected a comparison with a number"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = 3"), HasSubstr("expected a string"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nwhere = 'x'"), HasSubstr("study.toml:4: key 'where'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nrelative_to = 'x ='"), HasSubstr("key 'relative_to'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nminus = '=='"), HasSubstr("key 'minus'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nminus = 'a == 1'\nrelative_to = 'a == 1'"),
              HasSubstr("either 'relative_to' or 'minus'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = 'increasing'"), HasSubstr("needs 'along'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = 'increasing'\nalong = 'x'\nquantifier = 'any'"),
              HasSubstr("key 'quantifier'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nalong = 'x'"), HasSubstr("key 'along'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nquantifier = 'some'"), HasSubstr("expected \"all\", \"any\" or \"median\""));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\ntolerance = -1"), HasSubstr("key 'tolerance'"));
  EXPECT_THAT(reading_error("metric = 'm'\nis = '> 0'\nwher = 'x > 0'"), HasSubstr("key 'wher': unknown key"));
}

TEST(Claim, AnIntegrationThatEndedEarlyCountsAsNotConverged) {
  const std::vector<Row> rows = {row_of({{"type", std::string("a")}, {"E", 1.0}, {"completed", true}}),
                                 row_of({{"type", std::string("b")}, {"E", 2.0}, {"completed", false}})};
  const Verdict verdict = decide(claim_of("metric = 'E'\nis = '> 0'"), rows, {"type"});
  EXPECT_EQ(verdict.outcome, kHolds);
  EXPECT_THAT(verdict.ours, HasSubstr("1 not converged"));
}

}  // namespace
}  // namespace variform
