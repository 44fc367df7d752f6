// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>

#include "framework/base/error.h"
#include "framework/experiment/search.h"

namespace variform {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A run whose only metric is y = f(value).
TrialRun run_of(const std::function<double(double)>& f) {
  return [f](double value) {
    Row row;
    row.set("y", f(value));
    return row;
  };
}

std::vector<double> tried(const Trials& trials) {
  std::vector<double> values;
  for (const Row& row : trials.rows) values.push_back(to_number(*row.find(trials.key)));
  return values;
}

std::vector<std::string> asked(const Trials& trials) {
  std::vector<std::string> texts;
  for (const Row& row : trials.rows) texts.push_back(to_text(*row.find("asked")));
  return texts;
}

bool held_at(const Trials& trials, double value) {
  for (const Row& row : trials.rows) {
    if (to_number(*row.find(trials.key)) == value) return std::get<bool>(*row.find("held"));
  }
  ADD_FAILURE() << value << " was not tried";
  return false;
}

ThresholdSearch arithmetic(double low, double high, double tolerance) {
  return {.key = "x", .until = Condition("y >= 2"), .low = low, .high = high, .absolute_tolerance = tolerance};
}

TEST(FindThreshold, HalvesTheIntervalDownToTheTolerance) {
  const Trials trials = find_threshold(arithmetic(0.0, 4.0, 1e-6), run_of([](double x) { return x * x; }));
  EXPECT_TRUE(trials.found);
  EXPECT_EQ(trials.value, trials.high);
  EXPECT_GE(trials.high, std::sqrt(2.0));
  EXPECT_LT(trials.low, std::sqrt(2.0));
  EXPECT_LE(trials.high - trials.low, 1e-6);
  // Both ends, then 4 / 2^22 is the first width below the tolerance.
  EXPECT_EQ(trials.rows.size(), 2u + 22u);
  EXPECT_TRUE(held_at(trials, trials.high));
  EXPECT_FALSE(held_at(trials, trials.low));
  EXPECT_THAT(trials.remarks, IsEmpty());
  EXPECT_THAT(trials.metrics, ElementsAre("y"));
}

TEST(FindThreshold, RecordsWhatWasTriedInOrder) {
  const Trials trials = find_threshold(arithmetic(0.0, 4.0, 1.0), run_of([](double x) { return x; }));
  EXPECT_THAT(tried(trials), ElementsAre(0, 4, 2, 1));
  EXPECT_THAT(asked(trials), ElementsAre("low end", "high end", "bisect", "bisect"));
  EXPECT_EQ(trials.low, 1.0);
  EXPECT_EQ(trials.value, 2.0);
  EXPECT_EQ(to_number(*trials.rows[2].find("y")), 2.0);
}

TEST(FindThreshold, TheLowerEndIsTheAnswerWhereTheConditionHoldsThere) {
  const Trials trials = find_threshold(arithmetic(3.0, 4.0, 1.0), run_of([](double x) { return x; }));
  EXPECT_TRUE(trials.found);
  EXPECT_EQ(trials.rows.size(), 1u);
  EXPECT_EQ(trials.value, 3.0);
  EXPECT_EQ(trials.low, 3.0);
  EXPECT_EQ(trials.high, 3.0);
}

TEST(FindThreshold, SaysWhenThereIsNone) {
  const Trials trials = find_threshold(arithmetic(0.0, 1.0, 1e-3), run_of([](double x) { return x; }));
  EXPECT_FALSE(trials.found);
  EXPECT_TRUE(std::isnan(trials.value));
  EXPECT_EQ(trials.low, 0.0);
  EXPECT_EQ(trials.high, 1.0);
  EXPECT_EQ(trials.rows.size(), 2u);
  const Trials undefined = find_threshold(arithmetic(0.0, 1.0, 1e-3), run_of([](double) { return std::nan(""); }));
  EXPECT_FALSE(undefined.found);
}

TEST(FindThreshold, StopsAtThePrecisionOfDoublesAndAtTheLimitOfTrials) {
  ThresholdSearch search = arithmetic(0.0, 4.0, 1e-300);
  const Trials fine = find_threshold(search, run_of([](double x) { return x; }));
  EXPECT_EQ(fine.value, 2.0);
  EXPECT_LT(fine.rows.size(), 70u);
  search.max_trials = 5;
  const Trials few = find_threshold(search, run_of([](double x) { return x * x; }));
  EXPECT_EQ(few.rows.size(), 5u);
  EXPECT_TRUE(few.found);
  EXPECT_EQ(few.high - few.low, 0.5);
}

TEST(FindThreshold, OfANonMonotoneConditionItGivesOneChange) {
  // Holds in [0.3, 0.4] and from 0.7 on; bisection sees 0.5 fail, so the lower interval stays unknown.
  const auto f = [](double x) { return (x >= 0.3 && x <= 0.4) || x >= 0.7 ? 2.0 : 0.0; };
  const Trials upper = find_threshold(arithmetic(0.0, 1.0, 1e-4), run_of(f));
  EXPECT_NEAR(upper.value, 0.7, 1e-4);
  // From a start in the lower interval the search goes down.
  ThresholdSearch search = arithmetic(0.0, 1.0, 1e-4);
  search.start = 0.35;
  const Trials lower = find_threshold(search, run_of(f));
  EXPECT_NEAR(lower.value, 0.3, 1e-4);
  for (const Trials& trials : {upper, lower}) {
    EXPECT_TRUE(trials.found);
    for (const Row& row : trials.rows) {
      const double x = to_number(*row.find("x"));
      if (std::get<bool>(*row.find("held")))
        EXPECT_GE(x, trials.high);
      else
        EXPECT_LE(x, trials.low);
    }
  }
}

TEST(FindThreshold, BetaIsTriedAtZeroThenAroundTheStart) {
  int runs = 0;
  const auto step_at = [&runs](double threshold) {
    return [&runs, threshold](double beta) {
      ++runs;
      Row row;
      row.set("flipped", beta >= threshold ? std::int64_t{0} : std::int64_t{3});
      return row;
    };
  };
  const Condition none("flipped == 0");
  for (const double threshold : {1e-4, 0.003, 0.04, 0.06, 0.5, 0.9, 0.99}) {
    runs = 0;
    const Trials trials = find_threshold(smallest_beta(none), step_at(threshold));
    ASSERT_TRUE(trials.found) << threshold;
    EXPECT_EQ(tried(trials)[0], 0.0);
    EXPECT_EQ(tried(trials)[1], 0.05);
    EXPECT_GE(trials.value, threshold);
    EXPECT_LT(trials.low, threshold);
    EXPECT_LE(trials.value - trials.low, 0.05 * trials.value);
    EXPECT_EQ(runs, static_cast<int>(trials.rows.size()));
    EXPECT_LE(runs, 16) << threshold;
    EXPECT_EQ(trials.key, "norm.beta");
  }
  EXPECT_EQ(find_threshold(smallest_beta(none), step_at(0.0)).rows.size(), 1u);
  const Trials never = find_threshold(smallest_beta(none), step_at(2.0));
  EXPECT_FALSE(never.found);
  EXPECT_EQ(never.high, 0.999);
  EXPECT_THAT(asked(never), Contains("grow"));
  const Trials always_above_zero = find_threshold(smallest_beta(none), step_at(1e-300));
  EXPECT_TRUE(always_above_zero.found);
  EXPECT_LE(always_above_zero.value, 2e-6);
  EXPECT_EQ(always_above_zero.low, 0.0);
}

TEST(FindThreshold, GeometricSpacingHalvesTheLogarithm) {
  const ThresholdSearch search{.key = "w",
                               .until = Condition("y >= 1"),
                               .low = 1e-6,
                               .high = 1e6,
                               .spacing = Spacing::geometric,
                               .absolute_tolerance = 0.0,
                               .relative_tolerance = 0.01};
  const Trials trials = find_threshold(search, run_of([](double w) { return w >= 7e-4 ? 1.0 : 0.0; }));
  EXPECT_NEAR(trials.value, 7e-4, 7e-6);
  EXPECT_NEAR(tried(trials)[2], 1.0, 1e-12);
  EXPECT_LE(trials.rows.size(), 15u);
}

TEST(FindThreshold, RefusesWhatMakesNoSense) {
  const TrialRun run = run_of([](double x) { return x; });
  const auto refuse = [&run](const std::function<void(ThresholdSearch&)>& change) {
    ThresholdSearch search = arithmetic(0.0, 1.0, 1e-3);
    change(search);
    EXPECT_THROW(find_threshold(search, run), UsageError);
  };
  refuse([](ThresholdSearch& search) { search.low = 1.0; });
  refuse([](ThresholdSearch& search) { search.high = std::numeric_limits<double>::infinity(); });
  refuse([](ThresholdSearch& search) { search.start = 2.0; });
  refuse([](ThresholdSearch& search) { search.start = 0.0; });
  refuse([](ThresholdSearch& search) { search.factor = 1.0; });
  refuse([](ThresholdSearch& search) { search.absolute_tolerance = 0.0; });
  refuse([](ThresholdSearch& search) { search.spacing = Spacing::odds; });
  refuse([](ThresholdSearch& search) { search.until = Condition("z > 0"); });
}

/// min |A x - b|^2 + lambda |x|^2 with A = diag(1, 1e-2), b the data plus noise in the second entry: for lambda in
/// between of 1e-4 and 1 the residual is that of the noise and x is that of the data.
struct Tikhonov {
  static constexpr double kS[2] = {1.0, 1e-2};
  static constexpr double kB[2] = {1.0, 1e-1};  // x without regularization: 1 and 10
  double residual(double lambda) const {
    double sum = 0.0;
    for (int i = 0; i < 2; ++i) sum += std::pow(lambda * kB[i] / (kS[i] * kS[i] + lambda), 2);
    return std::sqrt(sum);
  }
  double solution(double lambda) const {
    double sum = 0.0;
    for (int i = 0; i < 2; ++i) sum += std::pow(kS[i] * kB[i] / (kS[i] * kS[i] + lambda), 2);
    return std::sqrt(sum);
  }
  /// Where the smooth curve over log lambda turns most, by differences on a grid of a thousandth of a decade.
  double corner(double low, double high) const {
    const auto curvature = [this](double t) {
      const double h = 1e-3;
      const auto x = [this](double s) { return std::log(residual(std::exp(s))); };
      const auto y = [this](double s) { return std::log(solution(std::exp(s))); };
      const double dx = (x(t + h) - x(t - h)) / (2 * h);
      const double dy = (y(t + h) - y(t - h)) / (2 * h);
      const double ddx = (x(t + h) - 2 * x(t) + x(t - h)) / (h * h);
      const double ddy = (y(t + h) - 2 * y(t) + y(t - h)) / (h * h);
      return (dx * ddy - dy * ddx) / std::pow(dx * dx + dy * dy, 1.5);
    };
    double best = low;
    for (double t = std::log(low); t < std::log(high); t += 2e-3) {
      if (curvature(t) > curvature(std::log(best))) best = std::exp(t);
    }
    return best;
  }
};

Row tikhonov_row(double beta, double power) {
  const Tikhonov problem;
  const double lambda = beta / (1.0 - beta);
  Row row;
  row.set("rho", std::pow(problem.residual(lambda), power));
  row.set("eta", std::pow(problem.solution(lambda), power));
  return row;
}

TEST(LCurve, TheCornerIsThatOfTheSmoothCurve) {
  const double exact = Tikhonov().corner(1e-4, 0.5);
  ASSERT_GT(exact, 1e-4);
  ASSERT_LT(exact, 0.1);
  for (const double power : {1.0, 2.0}) {  // norms and their squares have the same corner
    for (const int count : {25, 61}) {
      const LCurveSearch search{.residual = "rho", .regularizer = "eta", .low = 1e-5, .high = 0.9, .count = count};
      const Trials trials = l_curve(search, [power](double beta) { return tikhonov_row(beta, power); });
      ASSERT_TRUE(trials.found);
      EXPECT_EQ(trials.rows.size(), static_cast<std::size_t>(count));
      const double step = (std::log(9.0) - std::log(1e-5)) / (count - 1);
      EXPECT_NEAR(std::log(trials.value / (1.0 - trials.value)), std::log(exact), 1.01 * step);
      EXPECT_LT(trials.low, trials.value);
      EXPECT_GT(trials.high, trials.value);
      EXPECT_THAT(trials.remarks, IsEmpty());
      EXPECT_EQ(trials.against, "rho");
    }
  }
}

TEST(LCurve, TellsWhereMonotonyIsViolatedAndLeavesOutWhatHasNoLogarithm) {
  const LCurveSearch search{.residual = "rho", .regularizer = "eta", .low = 1e-3, .high = 0.99, .count = 9};
  int i = 0;
  const Trials trials = l_curve(search, [&i](double beta) {
    Row row = tikhonov_row(beta, 1.0);
    if (i == 2) row.set("eta", 0.0);
    if (i == 5) row.set("rho", 1e-9);
    ++i;
    return row;
  });
  EXPECT_FALSE(std::get<bool>(*trials.rows[2].find("held")));
  EXPECT_TRUE(std::get<bool>(*trials.rows[3].find("held")));
  ASSERT_EQ(trials.remarks.size(), 1u);
  EXPECT_THAT(trials.remarks[0], HasSubstr("rho falls from norm.beta = "));
}

TEST(LCurve, ACurveWithoutCornerHasNone) {
  // A straight line, and one that turns the other way.
  const LCurveSearch search{.residual = "rho", .regularizer = "eta", .count = 7};
  const auto none = [&search](const std::function<double(double)>& eta) {
    const Trials trials = l_curve(search, [&eta](double beta) {
      const double lambda = beta / (1.0 - beta);
      Row row;
      row.set("rho", lambda);
      row.set("eta", eta(lambda));
      return row;
    });
    return trials;
  };
  const Trials concave = none([](double lambda) { return std::exp(-lambda); });
  EXPECT_FALSE(concave.found);
  EXPECT_TRUE(std::isnan(concave.value));
  // All points in one place.
  const Trials point = l_curve(search, [](double) {
    Row row;
    row.set("rho", 1.0);
    row.set("eta", 1.0);
    return row;
  });
  EXPECT_FALSE(point.found);
}

TEST(LCurve, RefusesWhatMakesNoSense) {
  const TrialRun run = [](double beta) { return tikhonov_row(beta, 1.0); };
  EXPECT_THROW(l_curve({.residual = "rho", .regularizer = "eta", .low = 0.0}, run), UsageError);
  EXPECT_THROW(l_curve({.residual = "rho", .regularizer = "eta", .high = 1.0}, run), UsageError);
  EXPECT_THROW(l_curve({.residual = "rho", .regularizer = "eta", .count = 2}, run), UsageError);
  EXPECT_THROW(l_curve({.residual = "rho", .regularizer = "missing"}, run), UsageError);
}

}  // namespace
}  // namespace variform
