// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "framework/base/error.h"
#include "framework/experiment/performance_profile.h"

namespace variform {
namespace {

constexpr double kFailed = std::numeric_limits<double>::infinity();

/// The value of a step curve at x: that of its last point up to there.
double at(const Curve& curve, double x) {
  double value = 0.0;
  for (std::size_t i = 0; i < curve.x.size() && curve.x[i] <= x; ++i) value = curve.y[i];
  return value;
}

// Costs and shares by hand: ratios of a are 1, 1, 2, of b 4, 1 (a tie), and one failure.
TEST(PerformanceProfile, IsTheShareOfProblemsSolvedWithinAFactorOfTheBest) {
  const std::vector<Curve> curves =
      performance_profile({{"a", {1.0, 3.0, 8.0}}, {"b", {4.0, 3.0, kFailed}}, {"c", {2.0, kFailed, 4.0}}});
  ASSERT_EQ(curves.size(), 3U);
  EXPECT_EQ(curves[1].label, "b");
  EXPECT_DOUBLE_EQ(at(curves[0], 0.0), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(at(curves[0], 0.99), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(at(curves[0], 1.0), 1.0);
  EXPECT_DOUBLE_EQ(at(curves[1], 0.0), 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(at(curves[1], 1.9), 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(at(curves[1], 2.0), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(at(curves[2], 0.0), 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(at(curves[2], 1.0), 2.0 / 3.0);
  for (const Curve& curve : curves) {
    EXPECT_TRUE(std::is_sorted(curve.x.begin(), curve.x.end()));
    EXPECT_TRUE(std::is_sorted(curve.y.begin(), curve.y.end()));
    EXPECT_EQ(curve.x.back(), curves[0].x.back());
    EXPECT_GT(curve.x.back(), 2.0);
  }
}

TEST(PerformanceProfile, ProblemsThatNobodySolvesCountAgainstAll) {
  const std::vector<Curve> curves = performance_profile({{"a", {1.0, kFailed}}, {"b", {kFailed, kFailed}}});
  EXPECT_DOUBLE_EQ(curves[0].y.back(), 0.5);
  EXPECT_DOUBLE_EQ(curves[1].y.back(), 0.0);
}

TEST(PerformanceProfile, RefusesWhatIsNoSetOfCosts) {
  EXPECT_THROW(performance_profile({}), UsageError);
  EXPECT_THROW(performance_profile({{"a", {}}}), UsageError);
  EXPECT_THROW(performance_profile({{"a", {1.0, 2.0}}, {"b", {1.0}}}), UsageError);
  EXPECT_THROW(performance_profile({{"a", {0.0}}}), UsageError);
  EXPECT_THROW(performance_profile({{"a", {std::numeric_limits<double>::quiet_NaN()}}}), UsageError);
}

}  // namespace
}  // namespace variform
