// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "framework/base/error.h"
#include "integrators/shape/curve.h"
#include "tests/integrators/shape/points.h"

namespace variform {
namespace {

using std::numbers::pi;
using ::testing::HasSubstr;
using testing::message_of;
using testing::point;
using testing::rows;

std::vector<std::unique_ptr<GuidanceCurve>> all_curves() {
  const TimeInterval time{0.5, 3.0};
  std::vector<std::unique_ptr<GuidanceCurve>> curves;
  curves.push_back(make_line(rows({{1.0, 2.0}, {3.0, -1.0}}), time));
  curves.push_back(make_arc(point({1.0, 0.0}), point({0.2, 0.3}), 2.5, {}, time));
  curves.push_back(make_arc(point({1.0, 0.0, 2.0}), point({0.2, 0.3, 0.1}), -4.0, point({1.0, 1.0, 0.5}), time));
  curves.push_back(make_polynomial(rows({{0.0, 1.0, 2.0}, {1.0, 0.5, 0.0}, {0.0, 1.0, -2.0}, {0.3, 0.0, 1.0}}), time));
  curves.push_back(make_parabola(rows({{0.0, 0.0}, {1.0, 1.0}, {2.0, 0.0}}), time));
  curves.push_back(make_spline(rows({{0.0, 0.0}, {1.0, 1.0}, {1.5, -1.0}, {4.0, 0.0}}), time));
  curves.push_back(make_spline(rows({{0.0, 0.0, 1.0}, {1.0, 1.0, 0.0}, {1.5, -1.0, 0.2}}), time));
  return curves;
}

TEST(Curves, DerivativesAreThoseOfThePosition) {
  for (const auto& curve : all_curves()) {
    constexpr double kStep = 1e-4;
    for (double t = 0.51; t < 2.99; t += 0.0837) {
      const CurvePoint before = curve->at(t - kStep);
      const CurvePoint here = curve->at(t);
      const CurvePoint after = curve->at(t + kStep);
      EXPECT_LT(((after.position - before.position) / (2.0 * kStep) - here.velocity).norm(), 1e-6);
      EXPECT_LT(((after.velocity - before.velocity) / (2.0 * kStep) - here.acceleration).norm(), 2e-3);
    }
    EXPECT_EQ(curve->at(-7.0).position, curve->at(0.5).position);
    EXPECT_EQ(curve->at(7.0).position, curve->at(3.0).position);
  }
}

TEST(Curves, GoThroughTheirPoints) {
  const TimeInterval time{1.0, 3.0};
  const auto line = make_line(rows({{1.0, 2.0}, {3.0, -1.0}}), time);
  EXPECT_EQ(line->at(1.0).position, point({1.0, 2.0}));
  EXPECT_EQ(line->at(3.0).position, point({3.0, -1.0}));
  EXPECT_EQ(line->at(1.7).velocity, point({1.0, -1.5}));
  EXPECT_TRUE(line->knots().empty());

  const auto parabola = make_parabola(rows({{0.0, 0.0}, {1.0, 1.0}, {2.0, 0.0}}), time);
  EXPECT_LT((parabola->at(2.0).position - point({1.0, 1.0})).norm(), 1e-15);
  EXPECT_LT((parabola->at(1.5).position - point({0.5, 0.75})).norm(), 1e-15);
  EXPECT_LT((parabola->at(3.0).position - point({2.0, 0.0})).norm(), 1e-15);

  const auto arc = make_arc(point({1.0, 0.0}), point({0.0, 0.0}), pi / 2, {}, time);
  EXPECT_LT((arc->at(3.0).position - point({0.0, 1.0})).norm(), 1e-15);
  EXPECT_NEAR(arc->at(2.0).velocity.norm(), pi / 4, 1e-15);
  // In space about (1, 2, z), at the height of its first point.
  const auto raised = make_arc(point({2.0, 2.0, 5.0}), point({1.0, 2.0, 0.0}), pi, point({0.0, 0.0, -3.0}), time);
  EXPECT_LT((raised->at(3.0).position - point({0.0, 2.0, 5.0})).norm(), 1e-14);
  EXPECT_LT((raised->at(2.0).position - point({1.0, 1.0, 5.0})).norm(), 1e-14);
}

TEST(Curves, SplinesInterpolateWithCentripetalKnotsAndNaturalEnds) {
  // Distances 1, 4, 9: steps between knots 1 : 2 : 3.
  const Matrix points = rows({{0.0, 0.0}, {1.0, 0.0}, {1.0, 4.0}, {10.0, 4.0}});
  const auto spline = make_spline(points, {2.0, 8.0});
  const std::vector<double> knots = spline->knots();
  ASSERT_EQ(knots.size(), 2U);
  EXPECT_NEAR(knots[0], 3.0, 1e-14);
  EXPECT_NEAR(knots[1], 5.0, 1e-14);
  const std::vector<double> times = {2.0, knots[0], knots[1], 8.0};
  for (Index k = 0; k < 4; ++k) {
    EXPECT_LT((spline->at(times[k]).position.transpose() - points.row(k)).norm(), 1e-13) << k;
  }
  EXPECT_EQ(spline->at(2.0).acceleration.norm(), 0.0);
  EXPECT_LT(spline->at(8.0).acceleration.norm(), 1e-15);
  // C^2 at the knots and no more: the third derivative jumps.
  for (const double knot : knots) {
    constexpr double kNear = 1e-9;
    const CurvePoint left = spline->at(knot - kNear);
    const CurvePoint right = spline->at(knot + kNear);
    EXPECT_LT((left.velocity - right.velocity).norm(), 1e-7);
    EXPECT_LT((left.acceleration - right.acceleration).norm(), 1e-7);
    const SpacePoint before = (left.acceleration - spline->at(knot - 0.1).acceleration) / 0.1;
    const SpacePoint after = (spline->at(knot + 0.1).acceleration - right.acceleration) / 0.1;
    EXPECT_GT((before - after).norm(), 0.1);
  }
}

TEST(Curves, ASplineOfTwoPointsIsALine) {
  const auto spline = make_spline(rows({{1.0, 2.0}, {3.0, -1.0}}), {0.0, 2.0});
  EXPECT_LT((spline->at(0.5).position - point({1.5, 1.25})).norm(), 1e-15);
  EXPECT_LT((spline->at(0.5).velocity - point({1.0, -1.5})).norm(), 1e-15);
  EXPECT_TRUE(spline->knots().empty());
}

TEST(Curves, BadPointsAreNamed) {
  const TimeInterval unit;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message_of([&] { make_spline(rows({{0.0, 0.0}}), unit); }), HasSubstr("at least 2 points, got 1"));
  EXPECT_THAT(message_of([&] { make_spline(Matrix(0, 2), unit); }), HasSubstr("got 0"));
  EXPECT_THAT(message_of([&] {
                make_spline(rows({{0.0, 0.0}, {1.0, 0.0}, {1.0, 0.0}}), unit);
              }),
              HasSubstr("point 2 = [1, 0] coincides with point 1"));
  EXPECT_THAT(message_of([&] {
                make_spline(rows({{0.0, 0.0}, {1.0, 0.0}, {1.0 + 1e-15, 0.0}}), unit);
              }),
              HasSubstr("coincides with point 1"));
  EXPECT_THAT(message_of([&] { make_spline(rows({{0.0, 0.0}, {nan, 0.0}}), unit); }), HasSubstr("point 1 = [nan, 0]"));
  EXPECT_THAT(message_of([&] { make_spline(rows({{0.0}, {1.0}}), unit); }), HasSubstr("2 or 3 coordinates, got 1"));
  EXPECT_THAT(message_of([&] { make_line(rows({{0.0, 1.0}, {0.0, 1.0}}), unit); }), HasSubstr("coincides"));
  EXPECT_THAT(message_of([&] { make_line(rows({{0.0, 1.0}, {0.0, 2.0}, {0.0, 3.0}}), unit); }), HasSubstr("got 3"));
  EXPECT_THAT(message_of([&] { make_polynomial(rows({{0.0, 1.0}}), unit); }), HasSubstr("at least 2 points"));
  EXPECT_THAT(message_of([&] { make_parabola(rows({{0.0, 1.0}, {1.0, 1.0}}), unit); }), HasSubstr("at least 3"));
  EXPECT_THAT(message_of([&] {
                make_line(rows({{0.0, 1.0}, {0.0, 2.0}}), {1.0, 1.0});
              }),
              HasSubstr("time = [1, 1]: expected a start before an end"));
  EXPECT_THAT(message_of([&] { make_arc(point({1.0, 1.0}), point({1.0, 1.0}), 1.0, {}, unit); }), HasSubstr("centre"));
  EXPECT_THAT(message_of([&] {
                make_arc(point({1.0, 1.0, 2.0}), point({1.0, 1.0, 0.0}), 1.0, point({0.0, 0.0, 1.0}), unit);
              }),
              HasSubstr("lies on its axis"));
  EXPECT_THAT(message_of([&] {
                make_arc(point({1.0, 1.0, 2.0}), point({1.0, 0.0, 0.0}), 1.0, {}, unit);
              }),
              HasSubstr("needs an axis"));
  EXPECT_THAT(message_of([&] { make_arc(point({1.0, 1.0}), point({1.0, 0.0}), nan, {}, unit); }), HasSubstr("nan"));
}

}  // namespace
}  // namespace variform
