// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <map>

#include "framework/base/error.h"
#include "framework/experiment/runner.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

const RunOptions kNoFigures{.folder = {}, .figures = false};
const RunOptions kResume{.folder = {}, .figures = false, .resume = true};

/// What a made-up backend answers on problem p, in its n-th run (from 0) on that problem.
using Solver = std::function<PointResult(double p, int n)>;

/// A nonlinear result: energies from the start to the end, an iteration taking a tenth of a second.
PointResult nonlinear(const std::vector<double>& energies, bool converged = true, double solution = 0.0) {
  PointResult result;
  result.metrics.set("converged", converged);
  result.metrics.set("seconds_total", 1.0);
  result.trace.energy = energies;
  if (!energies.empty()) result.trace.objective = energies.back();
  for (std::size_t i = 0; i < energies.size(); ++i) result.trace.seconds.push_back(0.1 * static_cast<double>(i));
  result.trace.solution = Matrix::Constant(3, 2, solution);
  return result;
}

/// A linear one.
PointResult linear(double energy, double residual, double solution) {
  PointResult result = nonlinear({}, true, solution);
  result.trace.objective = energy;
  result.metrics.set("solver_residual", residual);
  return result;
}

PointResult timed(PointResult result, double total, double solve = 0.5) {
  result.metrics.set("seconds_total", total);
  result.metrics.set("seconds_solve", solve);
  return result;
}

/// A pipeline of made-up backends that keeps the [solver] of each run.
class Study {
 public:
  explicit Study(std::map<std::string, Solver> solvers) : solvers_(std::move(solvers)) {}

  Registry<PipelineEntry> registry() {
    PipelineEntry entry{.name = "fake", .doc = "for tests", .sections = {"problem", "solver"}};
    entry.parameters = {{"solver", {{"tolerance", 1e-6, "", {}}, {"max_iterations", std::int64_t{500}, "", {}}}}};
    entry.metrics = {{{"converged"}, ""},
                     {{"solver_residual"}, ""},
                     {{"run"}, "number of the run"},
                     {{"seconds_total", "", "s"}, ""},
                     {{"seconds_solve", "", "s"}, ""}};
    entry.figures = {"deformed"};
    entry.run = [this](const Config& config) { return run(config); };
    return Registry<PipelineEntry>("pipeline",
                                   {entry, {.name = "plain", .doc = "has no solvers", .sections = {"problem"}}});
  }

  Record run(const TemporaryFolder& folder, const std::string& text, const RunOptions& options = {}) {
    RunOptions at = options;
    at.folder = folder.path();
    return run_experiment(Config::parse("pipeline = \"fake\"\n" + text, "study.toml", fs::temp_directory_path()),
                          registry(), at);
  }

  Record run(const std::string& text) {
    const TemporaryFolder folder;
    return run(folder, text, kNoFigures);
  }

  /// [solver] of each run, in TOML.
  std::vector<std::string> seen;

 private:
  PointResult run(const Config& config) {
    const ConfigNode solver = config.root().at("solver");
    seen.push_back(solver.value().text());
    const std::string name = solver.has("nonlinear") ? solver.at("nonlinear").string() : solver.at("linear").string();
    const double p = config.root().has("problem") ? config.root().at("problem").number_or("p", 0.0) : 0.0;
    const int n = runs_[{name, p}]++;
    PointResult result = solvers_.at(name)(p, n);
    result.metrics.set("run", std::int64_t{n});
    return result;
  }

  std::map<std::string, Solver> solvers_;
  std::map<std::pair<std::string, double>, int> runs_;
};

Solver always(const PointResult& result) {
  return [result](double, int) { return result; };
}

/// [backends] with these nonlinear backends as variants, each run once.
std::string variants(const std::vector<std::string>& names, const std::string& more = "") {
  std::string text = "[backends]\nrepeats = 1\nwarm_up = 0\n" + more;
  for (const std::string& name : names) text += "[[backends.variant]]\nnonlinear = \"" + name + "\"\n";
  return text;
}

std::vector<std::string> column(const Record& record, const std::string& key) {
  std::vector<std::string> values;
  for (const Row& row : record.rows) values.push_back(row.find(key) == nullptr ? "-" : to_text(*row.find(key)));
  return values;
}

double number(const Record& record, std::size_t row, const std::string& key) {
  const Value* const value = record.rows.at(row).find(key);
  EXPECT_NE(value, nullptr) << key;
  return value == nullptr ? std::nan("") : to_number(*value);
}

TEST(BackendComparison, EveryProblemIsSolvedByEveryVariantInTheirOrder) {
  Study study({{"b", always(nonlinear({2, 1}))}, {"a", always(nonlinear({2, 1}))}});
  const Record record = study.run("[sweep]\n\"problem.p\" = [3, 5]\n" + variants({"b", "a"}));
  EXPECT_THAT(record.swept, ElementsAre("problem.p", "backend"));
  EXPECT_THAT(column(record, "problem.p"), ElementsAre("3", "3", "5", "5"));
  EXPECT_THAT(column(record, "backend"), ElementsAre("b", "a", "b", "a"));
  EXPECT_EQ(record.rows[3].entries()[0].first, "problem.p");
  EXPECT_EQ(record.rows[3].entries()[1].first, "backend");
  EXPECT_THAT(column(record, "run"), Each("0"));
  EXPECT_EQ(study.seen.size(), 4U);
}

TEST(BackendComparison, AVariantIsNamedAfterItsBackends) {
  Study study({{"a", always(nonlinear({1}))}});
  const Record record = study.run(
      "[backends]\nwarm_up = 0\n[[backends.variant]]\nlinear = \"l\"\nnonlinear = \"a\"\n"
      "[[backends.variant]]\nname = \"other\"\nnonlinear = \"a\"\n");
  EXPECT_THAT(column(record, "backend"), ElementsAre("a, l", "other"));
}

TEST(BackendComparison, OptionsOfTheConfigHoldForItsOwnBackendAndEverythingElseForAll) {
  Study study({{"a", always(nonlinear({1}))}, {"b", always(nonlinear({1}))}});
  study.run(
      "[solver]\nnonlinear = \"a\"\nnonlinear_options = { memory = 3 }\nlinear = \"l\"\n"
      "linear_options = { levels = 2 }\ntolerance = 1e-3\n" +
      variants({"a", "b"}) +
      "[[backends.variant]]\nname = \"more\"\nnonlinear = \"a\"\nnonlinear_options = { depth = 7 }\n"
      "[[backends.variant]]\nname = \"options\"\nnonlinear_options = { memory = 9 }\n"
      "[[backends.variant]]\nlinear = \"m\"\n");
  ASSERT_EQ(study.seen.size(), 5U);
  for (const std::string& solver : study.seen) EXPECT_THAT(solver, HasSubstr("tolerance = 0.001"));
  const auto has = [&](std::size_t run, const std::string& text) {
    return study.seen[run].find(text) != std::string::npos;
  };
  EXPECT_TRUE(has(0, "memory = 3")) << study.seen[0];
  EXPECT_TRUE(has(0, "levels = 2")) << study.seen[0];
  EXPECT_FALSE(has(1, "nonlinear_options")) << study.seen[1];
  EXPECT_TRUE(has(1, "levels = 2")) << study.seen[1];
  EXPECT_TRUE(has(2, "depth = 7") && !has(2, "memory")) << study.seen[2];
  EXPECT_TRUE(has(3, "nonlinear = \"a\"") && has(3, "memory = 9")) << study.seen[3];
  EXPECT_TRUE(has(4, "linear = \"m\"") && has(4, "memory = 3") && !has(4, "levels")) << study.seen[4];
}

TEST(BackendComparison, ExcessIsMeasuredAgainstTheLowestEnergyOfTheProblem) {
  Study study({{"a",
                [](double p, int) {
                  return nonlinear({9 * p, 2 * p});
                }},
               {"b", [](double p, int) {
                  return nonlinear({9 * p, 5 * p, p == 1 ? 2.5 : 2.0 * p});
                }}});
  const Record record = study.run("[sweep]\n\"problem.p\" = [1, 10]\n" + variants({"a", "b"}, "accuracy = 0.2\n"));
  EXPECT_THAT(column(record, "objective"), ElementsAre("2", "2.5", "20", "20"));
  EXPECT_THAT(column(record, "excess"), ElementsAre("0", "0.25", "0", "0"));
  EXPECT_THAT(column(record, "solved"), ElementsAre("true", "false", "true", "true"));
}

TEST(BackendComparison, ExcessOverAMinimumOfZeroIsAShareOfTheEnergyOfTheStart) {
  Study study(
      {{"a", always(nonlinear({5, 0}))}, {"b", always(nonlinear({5, 1e-3}))}, {"c", always(nonlinear({5, 1e-30}))}});
  const Record record = study.run(variants({"a", "b", "c"}));
  EXPECT_DOUBLE_EQ(number(record, 0, "excess"), 0.0);
  EXPECT_DOUBLE_EQ(number(record, 1, "excess"), 2e-4);
  EXPECT_THAT(column(record, "solved"), ElementsAre("true", "false", "true"));
  // Of rounding errors alone, too.
  Study rounding({{"a", always(nonlinear({5, 1e-25}))}, {"b", always(nonlinear({5, 3e-25}))}});
  EXPECT_THAT(column(rounding.run(variants({"a", "b"})), "solved"), ElementsAre("true", "true"));
}

TEST(BackendComparison, BackendsWhoseHistoryIsOfSomethingElseAreComparedByTheSameObjective) {
  PointResult other = nonlinear({9, 1});  // as an alternation over states and targets
  other.trace.objective = 2.5;
  Study study({{"a", always(nonlinear({9, 2}))}, {"b", always(other)}});
  const Record record = study.run(variants({"a", "b"}));
  EXPECT_THAT(column(record, "excess"), ElementsAre("0", "0.25"));
  EXPECT_THAT(column(record, "solved"), ElementsAre("true", "false"));
}

TEST(BackendComparison, NegativeEnergiesAreComparedByTheirSize) {
  Study study({{"a", always(nonlinear({0, -4}))}, {"b", always(nonlinear({0, -3}))}});
  EXPECT_THAT(column(study.run(variants({"a", "b"})), "excess"), ElementsAre("0", "0.25"));
}

TEST(BackendComparison, LinearProblemsAreComparedByTheEnergyOfTheirResult) {
  Study study({{"a", always(linear(2.0, 1e-3, 1.0))}, {"b", always(linear(2.0 + 1e-3, 1e-9, 0.0))}});
  const Record record = study.run(variants({"a", "b"}));
  EXPECT_THAT(column(record, "objective"), ElementsAre("2", "2.001"));
  EXPECT_NEAR(number(record, 1, "excess"), 5e-4, 1e-12);
  EXPECT_THAT(column(record, "solved"), ElementsAre("true", "false"));
  EXPECT_THAT(column(record, "rate"), Each("-"));
}

TEST(BackendComparison, OnlyRowsThatConvergedAreSolved) {
  Study study({{"a", always(nonlinear({9, 2}, false))},
               {"b", always(nonlinear({9, 2}))},
               {"c", always(nonlinear({9, 2.1}))},
               {"d", always(nonlinear({9, std::nan("")}))}});
  const Record record = study.run(variants({"a", "b", "c", "d"}, "accuracy = 1e-2\n"));
  EXPECT_THAT(column(record, "solved"), ElementsAre("false", "true", "false", "false"));
  // What did not converge may have found the lowest energy: others have not.
  Study lower({{"a", always(nonlinear({9, 1}, false))}, {"b", always(nonlinear({9, 2}))}});
  EXPECT_THAT(column(lower.run(variants({"a", "b"})), "solved"), ElementsAre("false", "false"));
}

TEST(BackendComparison, DifferencesAreThoseFromTheReference) {
  const auto solution = [](double energy, bool converged, double x) {
    PointResult result = nonlinear({9, energy}, converged, x);
    result.trace.solution(1, 1) -= 3.0 * x;  // the largest difference is that of one coordinate
    result.trace.length_scale = 4.0;
    return always(result);
  };
  const std::map<std::string, Solver> solvers = {
      {"a", solution(2.5, true, 1.0)}, {"b", solution(2.0, true, 2.0)}, {"c", solution(1.0, false, 4.0)}};
  const std::vector<std::string> names = {"a", "b", "c"};
  // The lowest energy that converged, which is b.
  EXPECT_THAT(column(Study(solvers).run(variants(names)), "difference"), ElementsAre("0.5", "0", "1"));
  EXPECT_THAT(column(Study(solvers).run(variants(names, "reference = \"a\"\n")), "difference"),
              ElementsAre("0", "0.5", "1.5"));
  EXPECT_THAT(column(Study(solvers).run(variants(names, "reference = \"c\"\n")), "difference"),
              ElementsAre("1.5", "1", "0"));
}

TEST(BackendComparison, TheReferenceOfALinearProblemHasTheSmallestResidual) {
  const auto nan = std::nan("");
  Study study({{"a", always(linear(2.0, nan, 4.0))},
               {"b", always(linear(2.0 - 1e-15, 1e-8, 1.0))},
               {"c", always(linear(2.0, 1e-14, 2.0))}});
  EXPECT_THAT(column(study.run(variants({"a", "b", "c"})), "difference"), ElementsAre("2", "1", "0"));
}

TEST(BackendComparison, SolutionsOfDifferentShapeHaveNoDifference) {
  PointResult other = nonlinear({9, 2});
  other.trace.solution = Matrix::Zero(4, 2);
  Study study({{"a", always(nonlinear({9, 2}))}, {"b", always(other)}});
  const Record record = study.run(variants({"a", "b"}, "reference = \"a\"\n"));
  EXPECT_TRUE(std::isnan(number(record, 1, "difference")));
}

TEST(BackendComparison, AVariantThatThrowsIsARowAndNoFailureOfTheRun) {
  Study study({{"a", [](double, int) -> PointResult { throw SolverError("no such luck"); }},
               {"b", always(nonlinear({9, 2}, true, 1.0))},
               {"c", [](double, int) -> PointResult { throw UsageError("needs a Hessian"); }}});
  const Record record = study.run(variants({"a", "b", "c"}, "reference = \"a\"\n"));
  EXPECT_EQ(record.failure, ExitCode::done);
  EXPECT_THAT(column(record, "status"), ElementsAre("failed", "ok", "failed"));
  EXPECT_THAT(column(record, "reason"), ElementsAre("no such luck", "-", "needs a Hessian"));
  EXPECT_THAT(column(record, "solved"), ElementsAre("false", "true", "false"));
  EXPECT_THAT(column(record, "objective"), ElementsAre("-", "2", "-"));
  EXPECT_THAT(column(record, "difference"), ElementsAre("-", "-", "-")) << "its reference has no solution";
  EXPECT_THAT(record.warnings, Contains("a: failed: no such luck"));
  EXPECT_THAT(record.tables, IsEmpty()) << "of one solution there are no differences";
}

TEST(BackendComparison, AProblemThatNobodySolvesIsStillARecord) {
  const Solver fails = [](double, int) -> PointResult { throw SolverError("no"); };
  const Record record = Study({{"a", fails}, {"b", fails}}).run(variants({"a", "b"}));
  EXPECT_EQ(record.failure, ExitCode::done);
  EXPECT_THAT(column(record, "status"), Each("failed"));
  EXPECT_THAT(record.tables, IsEmpty());
}

TEST(BackendComparison, MissingDataIsAFailureOfTheRun) {
  Study study({{"a", [](double, int) -> PointResult { throw DataError("no mesh"); }}});
  const TemporaryFolder folder;
  const Record record = study.run(folder, variants({"a"}), kNoFigures);
  EXPECT_EQ(record.failure, ExitCode::data);
  const std::string table = content_of(folder / "table.md");
  EXPECT_THAT(table, HasSubstr("no mesh"));
  EXPECT_EQ(table.find("status"), table.rfind("status"));
}

TEST(BackendComparison, TheRateOfAGeometricSequenceIsItsFactor) {
  std::vector<double> energies;
  for (int k = 0; k < 12; ++k) energies.push_back(3.0 + std::pow(0.7, k));
  // The rate is that of the last half: 0.9, 0.9, 0.9, then 0.5 four times.
  std::vector<double> late;
  for (const double excess : {1.0, 0.9, 0.81, 0.729, 0.3645, 0.18225, 0.091125, 0.0455625})
    late.push_back(3.0 + excess);
  // At the lowest one nothing is left to shrink: what follows does not count.
  std::vector<double> exact = late;
  exact.insert(exact.end(), {3.0, 3.0, 3.0});
  Study study({{"geometric", always(nonlinear(energies))},
               {"late", always(nonlinear(late))},
               {"exact", always(nonlinear(exact))},
               {"short", always(nonlinear({4, 3.5, 3}))}});
  const Record record = study.run(variants({"geometric", "late", "exact", "short"}));
  EXPECT_NEAR(number(record, 0, "rate"), 0.7, 1e-9);
  EXPECT_NEAR(number(record, 1, "rate"), 0.5, 1e-9);
  EXPECT_NEAR(number(record, 2, "rate"), 0.5, 1e-9);
  EXPECT_TRUE(std::isnan(number(record, 3, "rate"))) << "two values tell no rate";
}

TEST(BackendComparison, TimesAreMediansOfTheRunsThatCount) {
  const std::vector<double> totals = {100, 50, 3, 1, 7, 2};
  const std::vector<double> solves = {90, 40, 0.1, 0.4, 0.3, 0.2};
  const std::map<std::string, Solver> solvers = {{"a", [&](double, int n) {
                                                    return timed(nonlinear({4, 3, 2}), totals.at(n), solves.at(n));
                                                  }}};
  const auto run = [&](int repeats, std::size_t runs) {
    Study study(solvers);
    const Record record = study.run("[backends]\nwarm_up = 2\nrepeats = " + std::to_string(repeats) +
                                    "\n[[backends.variant]]\nnonlinear = \"a\"\n");
    EXPECT_EQ(study.seen.size(), runs);
    return record;
  };
  const Record odd = run(3, 5);
  EXPECT_DOUBLE_EQ(number(odd, 0, "seconds_total"), 3.0);
  EXPECT_DOUBLE_EQ(number(odd, 0, "seconds_solve"), 0.3);
  EXPECT_DOUBLE_EQ(number(odd, 0, "seconds_min"), 1.0);
  EXPECT_DOUBLE_EQ(number(odd, 0, "seconds_max"), 7.0);
  EXPECT_DOUBLE_EQ(number(odd, 0, "seconds_per_iteration"), 0.1);
  EXPECT_EQ(number(odd, 0, "run"), 4.0) << "what is no time is of the last run";
  EXPECT_GT(number(odd, 0, "peak_memory"), 0.0);
  const Record even = run(4, 6);
  EXPECT_DOUBLE_EQ(number(even, 0, "seconds_total"), 2.5);
  EXPECT_DOUBLE_EQ(number(even, 0, "seconds_solve"), 0.25);

  Study usual({{"a", always(nonlinear({1}))}});
  usual.run("[backends]\n[[backends.variant]]\nnonlinear = \"a\"\n");
  EXPECT_EQ(usual.seen.size(), 6U) << "five after one";
}

TEST(BackendComparison, DifferencesOfAllPairsAreATable) {
  Study study({{"a", always(nonlinear({9, 2}, true, 1.0))},
               {"b", always(nonlinear({9, 2}, true, 1.5))},
               {"c", always(nonlinear({9, 2}, true, 4.0))},
               {"d", [](double, int) -> PointResult { throw SolverError("no"); }}});
  const Record record = study.run("[sweep]\n\"problem.p\" = [1, 2]\n" + variants({"a", "b", "d", "c"}));
  ASSERT_EQ(record.tables.size(), 2U);
  EXPECT_THAT(record.tables[1].caption, HasSubstr("p = 2"));
  EXPECT_EQ(record.tables[0].csv(), "backend,a,b\r\na,,\r\nb,0.5,\r\nc,3,2.5\r\n");
}

TEST(BackendComparison, EqualProblemsOfASampledSweepAndOtherSeedsAreProblemsOfTheirOwn) {
  int calls = 0;
  const Solver solver = [&calls](double, int) { return nonlinear({90, 10.0 * (1 + calls++ / 2)}); };
  const std::string two = variants({"a", "b"});
  const Record equal =
      Study({{"a", solver}, {"b", solver}}).run("[sweep]\nkind = \"random\"\nsamples = 2\n\"problem.p\" = [1]\n" + two);
  EXPECT_THAT(column(equal, "objective"), ElementsAre("10", "10", "20", "20"));
  EXPECT_THAT(column(equal, "excess"), Each("0"));
  EXPECT_EQ(equal.tables.size(), 2U);
  calls = 0;
  const Record seeded = Study({{"a", solver}, {"b", solver}})
                            .run(
                                "[sweep]\nkind = \"random\"\nsamples = 2\nseed_key = \"problem.seed\"\n"
                                "\"problem.p\" = [1]\n[problem]\n" +
                                two);
  EXPECT_THAT(column(seeded, "excess"), Each("0"));
  ASSERT_EQ(seeded.tables.size(), 2U);
  EXPECT_THAT(seeded.tables[0].caption, HasSubstr("seed = "));
}

TEST(BackendComparison, ConvergenceIsPlottedForEveryProblemAndAProfileOfAll) {
  PointResult iterative = linear(2.0, 1e-9, 0.0);
  iterative.trace.linear_residuals = {1.0, 0.25};
  Study study({{"a",
                [&](double p, int) {
                  return p == 2 ? iterative : timed(nonlinear({12, 6, 3}), 1.0);
                }},
               {"b",
                [](double p, int) {
                  return timed(p == 2 ? linear(2.0, 1e-9, 0.0) : nonlinear({12, 3}), 4.0);
                }},
               {"c", [](double p, int) {
                  return timed(p == 2 ? linear(2.0, 1e-9, 0.0) : nonlinear({12, 9}), 0.5);
                }}});
  const TemporaryFolder folder;
  const Record record = study.run(folder, "[sweep]\n\"problem.p\" = [1, 2]\n" + variants({"a", "b", "c"}));
  EXPECT_THAT(record.warnings, IsEmpty());
  std::vector<std::string> paths;
  for (const FigureFile& figure : record.figures) paths.push_back(figure.path);
  EXPECT_THAT(paths, ElementsAre("figures/energy-iterations-1", "figures/energy-time-1", "figures/residuals-2",
                                 "figures/profile"));
  for (const std::string& path : paths) EXPECT_TRUE(fs::exists(folder / (path + ".png"))) << path;
  EXPECT_THAT(content_of(folder / "figures/energy-iterations-1.gp"), HasSubstr("0 3\n1 1\n"));
  EXPECT_THAT(content_of(folder / "figures/energy-time-1.gp"), HasSubstr("0.1 1\n"));
  EXPECT_THAT(content_of(folder / "figures/residuals-2.gp"), HasSubstr("0 1\n1 0.25\n"));
  // a: best of one problem, half as fast as c in the other; b: a quarter and an eighth; c did not solve the first.
  const std::string profile = content_of(folder / "figures/profile.gp");
  EXPECT_THAT(profile, HasSubstr("0 0\n0 0.5\n1 0.5\n1 1\n"));
  EXPECT_THAT(profile, HasSubstr("0 0\n2 0\n2 0.5\n3 0.5\n3 1\n"));
  EXPECT_THAT(profile, HasSubstr("0 0\n0 0.5\n3.1500"));
}

TEST(BackendComparison, OneProblemHasNoProfileAndWithoutFiguresThereIsNone) {
  Study study({{"a", always(nonlinear({12, 6, 3}))}});
  const TemporaryFolder folder;
  study.run(folder, variants({"a"}));
  EXPECT_TRUE(fs::exists(folder / "figures/energy-iterations-1.gp"));
  EXPECT_FALSE(fs::exists(folder / "figures/profile.gp"));
  const TemporaryFolder& same = folder;
  fs::remove_all(folder / "figures");
  study.run(same, "[sweep]\n\"problem.p\" = [1, 2]\n" + variants({"a"}), kNoFigures);
  EXPECT_TRUE(fs::is_empty(folder / "figures"));
}

TEST(BackendComparison, WithoutTimesThereIsNoProfileButARecord) {
  PointResult untimed = nonlinear({12, 3});
  untimed.metrics = {};
  Study study({{"a", always(untimed)}});
  const TemporaryFolder folder;
  const Record record = study.run(folder, "[sweep]\n\"problem.p\" = [1, 2]\n" + variants({"a"}));
  EXPECT_THAT(record.warnings, ElementsAre(HasSubstr("performance profile")));
  EXPECT_THAT(column(record, "solved"), Each("true"));
}

TEST(BackendComparison, TheRecordSaysHowOftenAndUntilWhenEachRan) {
  Study study({{"a", always(nonlinear({1}))}});
  const Record record = study.run("[solver]\ntolerance = 1e-3\n" + variants({"a"}, "accuracy = 0.5\n"));
  const auto fact = [&](const std::string& name) {
    for (const auto& [key, value] : record.provenance) {
      if (key == name) return value;
    }
    return std::string();
  };
  EXPECT_THAT(fact("comparison"), StartsWith("1 timed runs of each after 0; solved: converged, energy at most 0.5"));
  EXPECT_THAT(fact("stopping criterion of all"), HasSubstr("tolerance = 0.001"));
  EXPECT_THAT(fact("stopping criterion of all"), HasSubstr("max_iterations = 500"));
  for (const char* sweep : {"\"solver.tolerance\" = [1e-3, 1e-5]\n", "solver = [{ tolerance = 1e-3 }]\n"}) {
    const Record swept =
        Study({{"a", always(nonlinear({1.0}))}}).run("[sweep]\n" + std::string(sweep) + variants({"a"}));
    const auto found = std::find_if(swept.provenance.begin(), swept.provenance.end(),
                                    [](const auto& entry) { return entry.first == "stopping criterion of all"; });
    ASSERT_NE(found, swept.provenance.end());
    EXPECT_THAT(found->second, HasSubstr("tolerance = as swept"));
  }
}

TEST(BackendComparison, TablesShowWhatTheConfigSaysOrTheComparison) {
  Study study({{"a", always(nonlinear({9, 2}))}});
  const TemporaryFolder folder;
  study.run(folder, variants({"a"}), kNoFigures);
  EXPECT_THAT(content_of(folder / "table.md"), HasSubstr("solved"));
  study.run(folder, "[output]\ncolumns = [\"run\"]\n" + variants({"a"}), kNoFigures);
  EXPECT_THAT(content_of(folder / "table.md"), AllOf(HasSubstr("run"), Not(HasSubstr("solved"))));
}

TEST(BackendComparison, ClaimsCanNameItsMetricsAndVariants) {
  Study study({{"a", always(nonlinear({9, 2}))}, {"b", always(nonlinear({9, 3}))}});
  const Record record = study.run(
      variants({"a", "b"}) +
      "[[claim]]\ntext = \"a finds it\"\nwhere = \"backend == \\\"a\\\"\"\nmetric = \"solved\"\nis = \"== 1\"\n"
      "[[claim]]\ntext = \"b does not\"\nwhere = \"backend == \\\"b\\\"\"\nmetric = \"excess\"\nis = \"> 0.4\"\n");
  ASSERT_EQ(record.verdicts.size(), 2U);
  for (const Verdict& verdict : record.verdicts) EXPECT_EQ(verdict.outcome, Verdict::Outcome::holds) << verdict.reason;
}

TEST(BackendComparison, ResumeTakesFinishedPointsWithTheirTraces) {
  const std::map<std::string, Solver> solvers = {
      {"a",
       [](double p, int) {
         return timed(nonlinear({8, 5, 3, 2.5, 2.25, 2 + 1e-9}, true, p), 0.25);
       }},
      {"b", always(nonlinear({8, 2}, false, 3.0))}};
  const std::string text = "[sweep]\n\"problem.p\" = [1, 2]\n" + variants({"a", "b"});
  const TemporaryFolder folder;
  Study first(solvers);
  first.run(folder, text, {.folder = {}, .figures = false, .progress = [](const Progress& at) { return at.done < 3; }});
  EXPECT_EQ(first.seen.size(), 3U);
  Study second(solvers);
  const Record resumed = second.run(folder, text, kResume);
  EXPECT_EQ(second.seen.size(), 1U);
  Study third(solvers);
  const Record again = third.run(folder, text, kResume);
  EXPECT_THAT(third.seen, IsEmpty());
  EXPECT_EQ(Table::of(again.rows).csv(), Table::of(resumed.rows).csv());
  EXPECT_EQ(again.tables.at(1).csv(), "backend,a\r\na,\r\nb,1\r\n");
  const Record fresh = Study(solvers).run(text);
  for (const char* key : {"objective", "excess", "difference", "solved", "rate", "seconds_per_iteration"}) {
    EXPECT_EQ(column(again, key), column(fresh, key)) << key;
  }
  Study more(solvers);
  std::string repeated = text;
  repeated.replace(repeated.find("repeats = 1"), 11, "repeats = 2");
  more.run(folder, repeated, kResume);
  EXPECT_EQ(more.seen.size(), 8U) << "times of one run are not those of two";
}

std::string config_error(const std::string& text, const std::string& pipeline = "fake") {
  Study study({});
  try {
    check_experiment(Config::parse("pipeline = \"" + pipeline + "\"\n" + text, "study.toml", fs::temp_directory_path()),
                     study.registry());
  } catch (const UsageError& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted: " << text;
  return {};
}

TEST(BackendComparison, ConfigsThatMakeNoSenseAreRefusedWithTheirPlace) {
  const std::string a = "[[backends.variant]]\nnonlinear = \"a\"\n";
  EXPECT_THAT(config_error("[backends]\n"), StartsWith("study.toml:2: key 'backends': 'variant' is missing"));
  EXPECT_THAT(config_error("[backends]\nvariant = []\n"),
              StartsWith("study.toml:3: key 'backends.variant': expected at least one"));
  EXPECT_THAT(config_error("[backends]\nruns = 3\n" + a), StartsWith("study.toml:3: key 'backends.runs': unknown key"));
  EXPECT_THAT(config_error("[backends]\n" + a + "eigen = \"b\"\n"),
              StartsWith("study.toml:5: key 'backends.variant[0].eigen': unknown key"));
  EXPECT_THAT(config_error("[backends]\n" + a + a),
              StartsWith("study.toml:5: key 'backends.variant[1]': 'a' is there already"));
  EXPECT_THAT(config_error("[backends]\n[[backends.variant]]\nname = \"n\"\n"),
              StartsWith("study.toml:3: key 'backends.variant[0]': expected at least one of linear, nonlinear"));
  EXPECT_THAT(config_error("[backends]\n[[backends.variant]]\nlinear_options = { n = 1 }\n"),
              StartsWith("study.toml:3: key 'backends.variant[0]': expected a name"));
  EXPECT_THAT(config_error("[backends]\n[[backends.variant]]\nlinear = \"l\"\nlinear_options = 3\n"),
              StartsWith("study.toml:5: key 'backends.variant[0].linear_options': expected a table"));
  EXPECT_THAT(config_error("[backends]\nreference = \"b\"\n" + a),
              StartsWith("study.toml:3: key 'backends.reference': no variant of this name; expected one of a"));
  EXPECT_THAT(config_error("[backends]\nrepeats = 0\n" + a),
              StartsWith("study.toml:3: key 'backends.repeats': expected 1 to 1000"));
  EXPECT_THAT(config_error("[backends]\nwarm_up = -1\n" + a),
              StartsWith("study.toml:3: key 'backends.warm_up': expected 0 to 1000"));
  EXPECT_THAT(config_error("[backends]\naccuracy = 0\n" + a),
              StartsWith("study.toml:3: key 'backends.accuracy': expected a positive number"));
  EXPECT_THAT(config_error("[backends]\n" + a, "plain"),
              StartsWith("study.toml:2: key 'backends': pipeline 'plain' has no [solver]"));
  EXPECT_THAT(config_error("[problem]\n[backends]\n" + a +
                           "[bisect]\nkey = \"problem.p\"\nlow = 0\nhigh = 1\nuntil = \"run > 1\"\n"),
              StartsWith("study.toml:6: key 'bisect': a comparison of backends does not bisect"));
}

TEST(BackendComparison, WhatVariantsDifferInIsNotSwept) {
  const std::string a = "[backends]\n[[backends.variant]]\nnonlinear = \"a\"\n";
  const std::string solver = "[solver]\nnonlinear_options = { memory = 1 }\n[sweep]\n";
  for (const std::string key : {"solver.nonlinear", "solver.nonlinear_options", "solver.nonlinear_options.memory"}) {
    const std::string value = key == "solver.nonlinear_options" ? "{ memory = 2 }" : "\"b\"";
    EXPECT_THAT(config_error(solver + "\"" + key + "\" = [" + value + "]\n" + a),
                StartsWith("study.toml:5: key 'sweep." + key + "': '" + key + "' is what the variants"));
  }
  Study study({{"a", always(nonlinear({1}))}});
  study.run("[sweep]\n\"solver.linear\" = [\"l\"]\n\"solver.tolerance\" = [1, 2]\n" + a);
  EXPECT_THAT(study.seen, Each(HasSubstr("linear = \"l\"")));
}

}  // namespace
}  // namespace variform
