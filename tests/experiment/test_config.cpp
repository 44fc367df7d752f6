// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <functional>

#include "framework/base/error.h"
#include "framework/experiment/config.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

Config parsed(const std::string& text) { return Config::parse(text, "study.toml", "/data"); }

/// The message of the UsageError that an action throws.
std::string usage_error(const std::function<void()>& action) {
  try {
    action();
  } catch (const UsageError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no UsageError was thrown";
  return {};
}

std::vector<std::string> keys_of(const ConfigNode& node) {
  std::vector<std::string> keys;
  for (const ConfigNode& child : node.children()) keys.push_back(child.path());
  return keys;
}

/// The same values under the same keys in the same order, whatever the lines.
bool same(const ConfigValue& a, const ConfigValue& b) {
  if (a.data.index() != b.data.index()) return false;
  if (const auto* table = std::get_if<ConfigValue::Table>(&a.data)) {
    const auto& other = std::get<ConfigValue::Table>(b.data);
    return std::equal(table->begin(), table->end(), other.begin(), other.end(),
                      [](const auto& x, const auto& y) { return x.first == y.first && same(x.second, y.second); });
  }
  if (const auto* array = std::get_if<ConfigValue::Array>(&a.data)) {
    const auto& other = std::get<ConfigValue::Array>(b.data);
    return std::equal(array->begin(), array->end(), other.begin(), other.end(), same);
  }
  if (const auto* number = std::get_if<double>(&a.data); number != nullptr && std::isnan(*number)) {
    return std::isnan(std::get<double>(b.data));
  }
  return a.text() == b.text();
}

TEST(Config, ReadsEveryTypeOfValue) {
  const Config config =
      parsed("flag = true\ncount = -3\nnumber = 2.5e-3\ntext = \"a \\\"b\\\"\"\nlist = [1, 2.5]\n[table]\nkey = 'x'\n");
  const ConfigNode root = config.root();
  EXPECT_TRUE(root.at("flag").boolean());
  EXPECT_EQ(root.at("count").integer(), -3);
  EXPECT_EQ(root.at("count").number(), -3.0);
  EXPECT_EQ(root.at("number").number(), 2.5e-3);
  EXPECT_EQ(root.at("text").string(), "a \"b\"");
  EXPECT_THAT(root.at("list").numbers(), ElementsAre(1.0, 2.5));
  EXPECT_EQ(root.at("table").at("key").string(), "x");
  EXPECT_EQ(root.at("table").at("key").path(), "table.key");
  EXPECT_EQ(root.at("table").at("key").name(), "key");
  EXPECT_EQ(root.number_or("absent", 7.0), 7.0);
  EXPECT_EQ(config.folder(), "/data");
}

TEST(Config, KeepsTheOrderOfTheFileAndOfALine) {
  const Config config = parsed(
      "zeta = 1\nalpha = 2\n"
      "[sweep]\n\"norm.beta\" = [1]\n\"energy.type\" = [2]\n"
      "[inline]\ntable = { weight = 1, beta = 2, alpha = 3 }\n"
      "[dotted]\nz.y = 1\nb.a = 2\n");
  EXPECT_THAT(keys_of(config.root()), ElementsAre("zeta", "alpha", "sweep", "inline", "dotted"));
  EXPECT_THAT(keys_of(config.root().at("sweep")), ElementsAre("sweep.norm.beta", "sweep.energy.type"));
  EXPECT_EQ(config.root().at("inline").at("table").value().text(), "{ weight = 1, beta = 2, alpha = 3 }");
  EXPECT_THAT(keys_of(config.root().at("dotted")), ElementsAre("dotted.z", "dotted.b"));
}

TEST(Config, SyntaxErrorsNameFileAndLine) {
  EXPECT_THAT(usage_error([] { parsed("a = 1\nb = 2\nc = = 3\n"); }), StartsWith("study.toml:3: "));
  EXPECT_THAT(usage_error([] { parsed("[open\n"); }), StartsWith("study.toml:1: "));
  EXPECT_THAT(usage_error([] { parsed("a = 1\n\na = 2\n"); }), StartsWith("study.toml:3: "));
  EXPECT_THAT(usage_error([] { parsed("a = 1\nday = 2013-05-01\n"); }), StartsWith("study.toml:2: "));
  EXPECT_THAT(usage_error([] { parsed("a = \"\xff\xfe\"\n"); }), StartsWith("study.toml:1: "));
}

TEST(Config, ValuesOfTheWrongTypeAreNamedWithTheirLineAndWhatWasExpected) {
  const Config config = parsed("[a]\nb = \"text\"\nc = 1.5\n\n[a.d]\nlist = [1, true]\n");
  const ConfigNode a = config.root().at("a");
  const std::string place = "study.toml:2: key 'a.b': ";
  EXPECT_EQ(usage_error([&] { a.at("b").number(); }), place + "expected a number, got \"text\"");
  EXPECT_EQ(usage_error([&] { a.at("b").integer(); }), place + "expected an integer, got \"text\"");
  EXPECT_EQ(usage_error([&] { a.at("b").boolean(); }), place + "expected true or false, got \"text\"");
  EXPECT_EQ(usage_error([&] { a.at("b").elements(); }), place + "expected an array, got \"text\"");
  EXPECT_EQ(usage_error([&] { a.at("b").at("x"); }), place + "expected a table, got \"text\"");
  EXPECT_EQ(usage_error([&] { a.at("c").integer(); }), "study.toml:3: key 'a.c': expected an integer, got 1.5");
  EXPECT_EQ(usage_error([&] { a.at("c").string(); }), "study.toml:3: key 'a.c': expected a string, got 1.5");
  EXPECT_EQ(usage_error([&] { a.at("d").at("list").numbers(); }),
            "study.toml:6: key 'a.d.list[1]': expected a number, got true");
}

TEST(Config, MissingAndUnknownKeysAreNamed) {
  const Config config = parsed("[norm]\nbeta = 1\nbetta = 2\n");
  const ConfigNode norm = config.root().at("norm");
  EXPECT_EQ(usage_error([&] { norm.at("facet_weight"); }), "study.toml:1: key 'norm': 'facet_weight' is missing");
  EXPECT_EQ(usage_error([&] {
              norm.accept_keys({"beta", "facet_weight"});
            }),
            "study.toml:3: key 'norm.betta': unknown key; accepted here: beta, facet_weight");
}

TEST(Config, ParametersAreCheckedAndOthersLeftAlone) {
  const std::vector<Parameter> declared = {{.name = "beta", .value = 0.0, .doc = "", .min = 0.0, .max = 1.0},
                                           {.name = "steps", .value = std::int64_t{3}, .doc = ""},
                                           {.name = "list", .value = std::vector<double>(), .doc = ""}};
  const Config good = parsed("type = \"x\"\nbeta = 1\nlist = [1, 2]\n");
  const Parameters parameters = good.root().parameters(declared, {"type"});
  EXPECT_EQ(parameters.number("beta"), 1.0);
  EXPECT_EQ(parameters.integer("steps"), 3);
  EXPECT_THAT(parameters.numbers("list"), ElementsAre(1.0, 2.0));

  const auto error_of = [&](const std::string& text) {
    const Config config = parsed(text);
    return usage_error([&] { config.root().parameters(declared, {"type"}); });
  };
  EXPECT_THAT(error_of("\nbeta = 1.5\n"), AllOf(StartsWith("study.toml:2: key 'beta': "), HasSubstr("[0, 1]")));
  EXPECT_THAT(error_of("steps = 1.5\n"), HasSubstr("expected integer, got number"));
  EXPECT_THAT(error_of("beta = { a = 1 }\n"), HasSubstr("expected a value, got a table"));
  EXPECT_THAT(error_of("stepps = 1\n"), HasSubstr("unknown key; accepted here: type, beta, steps, list"));
}

TEST(Config, LocatedErrorsKeepTheirClassAndGetTheirPlaceOnce) {
  const Config config = parsed("[a]\nb = 1\n");
  const ConfigNode b = config.root().at("a").at("b");
  EXPECT_THROW(b.located([]() -> int { throw DataError("broken"); }), DataError);
  EXPECT_THROW(b.located([]() -> int { throw SolverError("broken"); }), SolverError);
  EXPECT_THROW(b.located([]() -> int { throw std::bad_alloc(); }), std::bad_alloc);
  EXPECT_EQ(usage_error([&] { b.located([]() -> int { throw std::runtime_error("broken"); }); }),
            "study.toml:2: key 'a.b': broken");
  EXPECT_EQ(usage_error([&] { config.root().located([&]() -> int { b.fail("broken"); }); }),
            "study.toml:2: key 'a.b': broken");
}

TEST(Config, SetReplacesAndAddsAtDottedQuotedAndIndexedPaths) {
  Config config = parsed("[norm]\nbeta = 0.1\n[[constraint]]\nmove = [1, 2]\n[[constraint]]\nweight = 1\n");
  config.set("norm.beta=0.3");
  config.set("norm.new.deep = [1, 'x']");
  config.set("sweep.\"norm.beta\"=[0, 1]");
  config.set("constraint[1].weight=2");
  config.set("constraint[0].move[1]=5");
  const ConfigNode root = config.root();
  EXPECT_EQ(root.at("norm").at("beta").number(), 0.3);
  EXPECT_EQ(root.at("norm").at("new").at("deep").value().text(), "[1, \"x\"]");
  EXPECT_THAT(root.at("sweep").at("norm.beta").numbers(), ElementsAre(0.0, 1.0));
  EXPECT_EQ(root.at("constraint").elements()[1].at("weight").number(), 2.0);
  EXPECT_THAT(root.at("constraint").elements()[0].at("move").numbers(), ElementsAre(1.0, 5.0));
}

TEST(Config, SetTakesWhatIsNoTomlValueAsText) {
  Config config = parsed("");
  for (const char* assignment : {"energy.type=arap", "title=two words", "empty=", "day=2013-05-01", "quoted=\"3\""}) {
    config.set(std::string(assignment));
  }
  const ConfigNode root = config.root();
  EXPECT_EQ(root.at("energy").at("type").string(), "arap");
  EXPECT_EQ(root.at("title").string(), "two words");
  EXPECT_EQ(root.at("empty").string(), "");
  EXPECT_EQ(root.at("day").string(), "2013-05-01");
  EXPECT_EQ(root.at("quoted").string(), "3");
}

TEST(Config, ValuesFromTheCommandLineHaveNoLine) {
  Config config = parsed("\n\n[norm]\nbeta = 0.1\n");
  config.set("norm.beta=[true]");
  const ConfigNode beta = config.root().at("norm").at("beta");
  EXPECT_EQ(usage_error([&] { beta.number(); }), "study.toml: key 'norm.beta': expected a number, got [true]");
  EXPECT_EQ(usage_error([&] { beta.numbers(); }), "study.toml: key 'norm.beta[0]': expected a number, got true");
}

TEST(Config, SetRefusesPathsThatLeadNowhere) {
  const auto error_of = [](const std::string& assignment) {
    Config config = parsed("a = 1\nlist = [1, 2]\n");
    return usage_error([&] { config.set(assignment); });
  };
  EXPECT_THAT(error_of("no equals sign"), HasSubstr("expected key=value"));
  EXPECT_THAT(error_of("=1"), HasSubstr("expected key=value"));
  EXPECT_THAT(error_of("a.b=1"), HasSubstr("key 'a.b': 'b' is inside a value that is no table"));
  EXPECT_THAT(error_of("list[2]=1"), HasSubstr("'list' has no element 2"));
  EXPECT_THAT(error_of("a[0]=1"), HasSubstr("'a' has no element 0"));
  EXPECT_THAT(error_of("absent[0]=1"), HasSubstr("there is no array 'absent'"));
  EXPECT_THAT(error_of("list[x]=1"), HasSubstr("expected [number]"));
  EXPECT_THAT(error_of("list[0=1"), HasSubstr("expected [number]"));
  EXPECT_THAT(error_of("\"open=1"), HasSubstr("a quote is not closed"));
  for (const char* path : {"a..b=1", ".a=1", "a.=1", "list[0]x=1", " =1"}) {
    EXPECT_THAT(error_of(path), HasSubstr("expected names separated by dots")) << path;
  }
}

TEST(Config, EraseRemovesATopLevelKeyOrNothing) {
  Config config = parsed("a = 1\n[b]\nc = 1\n");
  config.erase("b");
  config.erase("nothing");
  EXPECT_EQ(config.text(), "a = 1\n");
}

TEST(Config, TextReadsBackAsTheSameConfig) {
  const char* const texts[] = {
      "", "a = 1\nb = 1.0\nc = 1e-300\nd = 1e22\ne = inf\nf = -inf\ng = nan\nh = 0.1\ni = -0.0\n",
      "s = \"quote \\\" backslash \\\\ newline \\n tab \\t return \\r bell \\u0007 delete \\u007f umlaut ä\"\n",
      "\"dotted.key\" = 1\n\"\" = 2\n\"with \\\" quote\" = 3\n[\"a b\".\"c.d\"]\nx = true\n",
      "list = []\nnested = [[1, 2], [], [\"a\", true]]\ntable = {}\nmixed = [1, { a = 1 }]\n",
      "[a]\nx = 1\n[a.b]\ny = 2\n[a.b.c]\nz = 3\n[d]\n",
      "[[c]]\nk = 1\nselect = { box = [0, 1] }\n[[c]]\n[[c.inner]]\nq = 1\n[[c.inner]]\n[[d]]\n",
      // Tables in front of values: their order is the order of the sweep.
      "[sweep]\nnorm = [{ facet_weight = \"x\", beta = 0.2 }, { beta = 0 }]\n\"domain.h\" = [1]\nlast = { a = 1 }\n",
      "[a]\nt = { u = { v = 1 }, w = 2 }\nx = 1\n"};
  for (const char* text : texts) {
    const Config config = parsed(text);
    const std::string written = config.text();
    const Config again = parsed(written);
    EXPECT_TRUE(same(config.root().value(), again.root().value())) << text << "---\n" << written;
    EXPECT_EQ(again.text(), written);
  }
}

TEST(Config, TextReadsBackAfterSet) {
  Config config = parsed("[norm]\nbeta = 1\n[norm.deep]\nx = 1\n[[constraint]]\nkind = \"hard\"\n");
  for (const char* assignment : {"title=late", "norm.regularizer=tikhonov", "constraint[0].move={ translate = [1, 2] }",
                                 "probe.lattice=8", "sweep.\"constraint[0].move\"=[[0, 0], [1, 1]]"}) {
    config.set(std::string(assignment));
  }
  const std::string text = config.text();
  EXPECT_TRUE(same(config.root().value(), parsed(text).root().value())) << text;
  EXPECT_THAT(text, StartsWith("title = \"late\"\n\n[norm]\nbeta = 1\nregularizer = \"tikhonov\"\n\n[norm.deep]\n"));
}

TEST(Config, LoadNamesWhatCannotBeRead) {
  const TemporaryFolder folder;
  EXPECT_THAT(usage_error([&] { Config::load(folder / "absent.toml"); }), HasSubstr("absent.toml: cannot be read"));
  EXPECT_THAT(usage_error([&] { Config::load(folder.path()); }), HasSubstr("is a folder"));
  std::ofstream(folder / "a.toml") << "title = 'x'\n";
  const Config config = Config::load(folder / "a.toml");
  EXPECT_EQ(config.root().at("title").string(), "x");
  EXPECT_EQ(config.folder(), folder.path());
}

TEST(Config, AMessageCarriesEverythingThatErrorsAndRunsSee) {
  const std::string text =
      "b = true\n[table]\n\"quoted.key\" = [1, 2.5, \"three\"]\nempty = {}\ninf = -inf\nthird = 0.3333333333333333\n"
      "[[list]]\nx = 1.0\n[[list]]\ny = 9223372036854775807\n";
  const Config config = Config::parse(text, "study.toml", "/some/folder");
  const Config copy = Config::from_message(config.message());
  EXPECT_EQ(copy.text(), config.text());
  EXPECT_EQ(copy.message(), config.message());
  EXPECT_EQ(copy.folder(), config.folder());
  EXPECT_EQ(copy.root().at("table").at("third").number(), 0.3333333333333333);
  try {
    copy.root().at("list").elements()[1].at("y").string();
    ADD_FAILURE() << "no error";
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(), "study.toml:10: key 'list[1].y': expected a string, got 9223372036854775807");
  }
  EXPECT_THROW(Config::from_message("{"), UsageError);
}

}  // namespace
}  // namespace variform
