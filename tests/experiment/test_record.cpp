// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <limits>
#include <set>

#include "framework/base/error.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/record.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

Record sample() {
  Row first;
  first.set("zeta", std::string("a"));
  first.set("error", 0.1);
  first.set("cells", std::int64_t{1} << 40);
  Row second;
  second.set("zeta", std::string("<b> & \"c\""));
  second.set("error", std::numeric_limits<double>::quiet_NaN());
  second.set("flag", true);
  return {.title = "<script>alert('x')</script>",
          .source = "Author & Writer, https://example.org/paper",
          .pipeline = "deform",
          .config = "[mesh]\nname = \"<bar>\"\n",
          .provenance = {{"version", "1.2"}, {"machine", "two & cores"}},
          .warnings = {"a < b"},
          .rows = {first, second},
          .columns = {{.key = "error", .title = "relative error", .unit = "%", .digits = 2}},
          .figures = {{"caption of <it>", "sub/first figure"}, {"lost", "lost"}},
          .verdicts = {{.text = "one", .condition = "e < 1", .outcome = Verdict::Outcome::holds},
                       {.text = "two", .condition = "", .ours = "3", .outcome = Verdict::Outcome::fails},
                       {.text = "three", .condition = "", .reason = "no row matched"}}};
}

TEST(Record, JsonKeepsRowsAndTheOrderOfKeys) {
  const auto json = nlohmann::ordered_json::parse(record_json(sample()));
  std::vector<std::string> keys;
  for (const auto& item : json.items()) keys.push_back(item.key());
  EXPECT_THAT(keys, ElementsAre("title", "source", "pipeline", "config", "provenance", "warnings", "rows", "figures",
                                "animations", "claims", "searches"));
  keys.clear();
  for (const auto& item : json["rows"][0].items()) keys.push_back(item.key());
  EXPECT_THAT(keys, ElementsAre("zeta", "error", "cells"));
  EXPECT_EQ(json["title"], "<script>alert('x')</script>");
  EXPECT_EQ(json["rows"][0]["error"].get<double>(), 0.1);
  EXPECT_EQ(json["rows"][0]["cells"].get<std::int64_t>(), std::int64_t{1} << 40);
  EXPECT_TRUE(json["rows"][1]["error"].is_null());
  EXPECT_EQ(json["rows"][1]["flag"], true);
  EXPECT_EQ(json["provenance"]["machine"], "two & cores");
  EXPECT_EQ(json["figures"][1]["path"], "lost");
  EXPECT_EQ(json["claims"][2]["outcome"], "undecided");
  EXPECT_EQ(json["claims"][2]["reason"], "no row matched");
}

TEST(Record, JsonSurvivesBytesThatAreNoText) {
  Record record = sample();
  record.warnings = {"bad \xff byte"};
  EXPECT_EQ(nlohmann::json::parse(record_json(record))["warnings"][0], "bad \xef\xbf\xbd byte");
}

TEST(Record, TableTakesColumnsFromTheRecord) {
  const Table all = record_table(sample());
  ASSERT_EQ(all.columns.size(), 4u);
  EXPECT_EQ(header_of(all.columns[1]), "relative error [%]");
  const Table chosen = record_table(sample(), {"flag", "error"});
  ASSERT_EQ(chosen.columns.size(), 2u);
  EXPECT_EQ(chosen.columns[0].key, "flag");
  EXPECT_EQ(chosen.columns[1].digits, 2);
  EXPECT_EQ(chosen.rows.size(), 2u);
}

TEST(Record, ClaimsTable) {
  EXPECT_EQ(claims_table(sample().verdicts).markdown(),
            "| statement | published | ours | verdict                    |\n"
            "| --------- | --------- | ---- | -------------------------- |\n"
            "| one       |           |      | holds                      |\n"
            "| two       |           | 3    | fails                      |\n"
            "| three     |           |      | undecided (no row matched) |\n");
}

TEST(Record, WritesAllFiles) {
  const TemporaryFolder folder;
  const Record record = sample();
  const std::filesystem::path path = folder / "new" / "run";
  write_record(record, path, {"zeta"});
  EXPECT_EQ(content_of(path / "record.json"), record_json(record));
  EXPECT_EQ(content_of(path / "table.csv"), record_table(record).csv());
  EXPECT_EQ(content_of(path / "table.json"), record_table(record).json());
  EXPECT_EQ(content_of(path / "table.md"), record_table(record, {"zeta"}).markdown());
  EXPECT_EQ(content_of(path / "table.tex"), record_table(record, {"zeta"}).latex());
  EXPECT_EQ(content_of(path / "report.html"), report_html(record, path, {"zeta"}));
}

TEST(Record, FailsWhereNothingCanBeWritten) {
  const TemporaryFolder folder;
  write_file(folder / "file", "not a folder");
  EXPECT_THROW(write_record(sample(), folder / "file" / "run", {}), DataError);
  std::filesystem::create_directories(folder / "run" / "record.json");
  EXPECT_THROW(write_record(sample(), folder / "run", {}), DataError);
}

TEST(Report, EscapesAllText) {
  const TemporaryFolder folder;
  const std::string html = report_html(sample(), folder.path(), {});
  EXPECT_THAT(html, HasSubstr("<h1>&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;</h1>"));
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  for (const char* text : {"Author &amp; Writer", "&lt;b&gt; &amp; &quot;c&quot;", "name = &quot;&lt;bar&gt;&quot;",
                           "a &lt; b", "two &amp; cores", "e &lt; 1", "caption of &lt;it&gt;"}) {
    EXPECT_THAT(html, HasSubstr(text));
  }
}

TEST(Report, ShowsVerdictsAndCounts) {
  const TemporaryFolder folder;
  const std::string html = report_html(sample(), folder.path(), {});
  for (const char* text : {">one<", ">two<", ">three<", ">holds</span>", ">fails</span>", ">undecided</span>",
                           "no row matched", "2 rows", "3 claims", "1 held", "1 failed", "1 undecided", "1 warning<"}) {
    EXPECT_THAT(html, HasSubstr(text));
  }
}

/// The first characters that follow a text wherever it occurs.
std::set<std::string> starts_of(const std::string& html, const std::string& text) {
  std::set<std::string> starts;
  for (std::size_t i = html.find(text); i != std::string::npos; i = html.find(text, i + 1)) {
    starts.insert(html.substr(i + text.size(), 10));
  }
  return starts;
}

TEST(Report, NeedsNoNetwork) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "sub");
  write_file(folder / "sub/first figure.png", "\x89PNG and more than twenty bytes");
  const std::string html = report_html(sample(), folder.path(), {});
  EXPECT_EQ(starts_of(html, " src=\""), std::set<std::string>{"data:image"});
  EXPECT_EQ(starts_of(html, " href=\""), std::set<std::string>{"sub/first%"});
  EXPECT_THAT(html, Not(HasSubstr("@import")));
  EXPECT_THAT(html, Not(HasSubstr("url(")));
  EXPECT_THAT(html, HasSubstr("<a href=\"sub/first%20figure.svg\"><img src=\"data:image/png;base64,iVBORyBhbmQg"));
  EXPECT_THAT(html, HasSubstr("lost.png was not drawn"));
}

TEST(Report, SortsByExactNumbers) {
  const TemporaryFolder folder;
  Record record = sample();
  record.rows[0].set("error", 1.0 / 3.0);
  EXPECT_THAT(report_html(record, folder.path(), {}),
              HasSubstr("<td class=\"number\" data-value=\"0.3333333333333333\">0.33</td>"));
}

}  // namespace
}  // namespace variform
