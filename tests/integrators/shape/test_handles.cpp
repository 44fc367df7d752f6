// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>

#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "integrators/shape/handles.h"
#include "tests/integrators/shape/points.h"

namespace variform {
namespace {

using std::numbers::pi;
using ::testing::HasSubstr;
using testing::message_of;
using testing::point;
using testing::rows;

std::shared_ptr<const GuidanceCurve> wave(const TimeInterval& time) {  // inflections and a straight end
  return make_spline(rows({{0.0, 0.0}, {1.0, 1.0}, {2.0, -1.0}, {3.0, 0.0}, {4.0, 0.5}}), time);
}
std::shared_ptr<const GuidanceCurve> knot(const TimeInterval& time) {
  return make_spline(rows({{0.0, 0.0, 0.0}, {1.0, 1.0, 0.5}, {0.0, 2.0, 1.0}, {-1.0, 1.0, 2.0}, {0.5, 0.0, 2.5}}),
                     time);
}

std::map<std::string, MotionPointer> all_motions() {
  const TimeInterval time{0.2, 0.9};
  Eigen::MatrixXd A(2, 2);
  A << 0.4, -1.0, 0.7, 0.1;
  Eigen::MatrixXd B(3, 3);
  B << 0.1, -1.0, 0.5, 0.7, 0.3, 0.2, -0.4, 0.3, -0.5;
  std::map<std::string, MotionPointer> motions = {
      {"path", follow(wave(time))},
      {"path in space", follow(knot(time))},
      {"oriented path", follow_oriented(wave(time))},
      {"oriented path in space", follow_oriented(knot(time))},
      {"translation", translate(point({1.0, -2.0}), time)},
      {"rotation", rotate(point({0.5, 1.0}), {}, 3.0, time)},
      {"rotation in space", rotate(point({0.5, 1.0, 0.0}), point({1.0, 1.0, 2.0}), 3.0, time)},
      {"bend", bend(point({0.0, 0.0}), point({2.0, 1.0}), {}, 2.0, time)},
      {"bend in space", bend(point({0.0, 0.0, 1.0}), point({0.0, 0.0, 3.0}), point({1.0, 1.0, 0.0}), -3.0, time)},
      {"linear field", linear_field(A, point({0.3, 0.2}), time)},
      {"linear field in space", linear_field(B, point({0.3, 0.2, -0.1}), time)},
      {"singular linear field", linear_field(Eigen::MatrixXd::Zero(2, 2), point({0.3, 0.2}), time)},
      {"polynomial field", polynomial_field({A, -A, 0.5 * A}, {point({0.3, 0.2}), point({-2.0, 0.0})}, time)},
  };
  const MotionPointer there = follow_oriented(wave({0.0, 0.4}));
  motions["sequence"] =
      in_sequence({there, rotate(point({1.0, 0.0}), {}, 2.0, {0.5, 0.7}), reversed(there, {0.7, 1.0})});
  motions["weighted"] =
      weighted(follow_oriented(wave(time)), {{0.2, 0.0}, {0.5, 2.0}, {0.6, 0.0}, {0.7, 0.0}, {1.0, 3.0}});
  motions["weighted sequence"] = weighted(motions["sequence"], {{0.1, 1.0}, {0.6, 1.5}});
  return motions;
}

/// The trajectory as Runge and Kutta's method integrates the velocity, in pieces between breaks.
SpacePoint integrated(const Motion& motion, double t0, const SpacePoint& x0, double t1, int steps) {
  std::vector<double> times = motion.breaks(t0, t1);
  times.push_back(t1);
  SpacePoint x = x0;
  double from = t0;
  for (const double to : times) {
    const double h = (to - from) / steps;
    const auto f = [&](double t, const SpacePoint& y) {
      return motion.velocity(std::clamp(t, from + 1e-12, to - 1e-12), y);
    };
    for (int i = 0; i < steps; ++i) {
      const double t = from + i * h;
      const SpacePoint a = f(t, x);
      const SpacePoint b = f(t + 0.5 * h, x + 0.5 * h * a);
      const SpacePoint c = f(t + 0.5 * h, x + 0.5 * h * b);
      const SpacePoint d = f(t + h, x + h * c);
      x += h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
    }
    from = to;
  }
  return x;
}

TEST(Motions, ClosedFormsAreTheIntegralsOfTheVelocity) {
  for (const auto& [name, motion] : all_motions()) {
    SCOPED_TRACE(name);
    const SpacePoint x0 = motion->dimension() == 2 ? point({0.3, -0.4}) : point({0.3, -0.4, 0.7});
    const double t1 = 1.1;
    const SpacePoint by_steps = integrated(*motion, 0.0, x0, t1, 800);
    EXPECT_LT((flow(*motion, 0.0, x0, t1) - by_steps).norm(), 1e-9);
    EXPECT_GT((by_steps - x0).norm(), 0.01);
    // Composition: from any time to any other one, and back.
    for (const double t : {0.1, 0.33, 0.52, 0.8}) {
      const SpacePoint middle = flow(*motion, 0.0, x0, t);
      EXPECT_LT((flow(*motion, t, middle, t1) - flow(*motion, 0.0, x0, t1)).norm(), 2e-12) << t;
      EXPECT_LT((flow(*motion, t, middle, 0.0) - x0).norm(), 2e-12) << t;
    }
    if (!motion->closed_form()) {
      EXPECT_THAT(message_of([&] { motion->position(0.0, x0, 1.0); }), HasSubstr("no position in closed form"));
    }
  }
}

TEST(Motions, VelocityIsTheRateOfThePosition) {
  for (const auto& [name, motion] : all_motions()) {
    if (!motion->closed_form()) continue;
    SCOPED_TRACE(name);
    const SpacePoint x0 = motion->dimension() == 2 ? point({0.3, -0.4}) : point({0.3, -0.4, 0.7});
    constexpr double kStep = 1e-5;
    const std::vector<double> breaks = motion->breaks(0.0, 1.2);
    for (double t = 0.013; t < 1.1; t += 0.0371) {
      if (std::ranges::any_of(breaks, [&](double b) { return std::abs(b - t) < 2.0 * kStep; })) continue;
      const SpacePoint rate =
          (motion->position(0.0, x0, t + kStep) - motion->position(0.0, x0, t - kStep)) / (2.0 * kStep);
      EXPECT_LT((rate - motion->velocity(t, motion->position(0.0, x0, t))).norm(), 1e-5 * (1.0 + rate.norm())) << t;
    }
  }
}

TEST(Motions, StandStillOutsideTheirInterval) {
  const MotionPointer motion = translate(point({1.0, 0.0}), {0.2, 0.7});
  const SpacePoint x = point({5.0, 6.0});
  EXPECT_EQ(motion->velocity(0.1999, x).norm(), 0.0);
  EXPECT_EQ(motion->velocity(0.2, x).norm(), 1.0);
  EXPECT_EQ(motion->velocity(0.7, x).norm(), 1.0);
  EXPECT_EQ(motion->velocity(0.7001, x).norm(), 0.0);
  EXPECT_EQ(motion->position(0.0, x, 0.2), x);
  EXPECT_LT((motion->position(0.0, x, 9.0) - point({5.5, 6.0})).norm(), 1e-15);
  EXPECT_EQ(motion->position(0.7, x, 9.0), x);
  EXPECT_THAT(motion->breaks(0.0, 1.0), ::testing::ElementsAre(0.2, 0.7));
  EXPECT_THAT(motion->breaks(0.2, 0.7), ::testing::IsEmpty());
}

TEST(Motions, BreaksAreAllKnots) {
  const auto curve = wave({0.0, 1.0});
  std::vector<double> expected = curve->knots();
  ASSERT_EQ(expected.size(), 3U);
  EXPECT_EQ(follow(curve)->breaks(0.0, 1.0), expected);
  EXPECT_EQ(follow_oriented(curve)->breaks(0.0, 1.0), expected);
  // Twice as fast up to t = 0.25, then half as fast: tau = 2 t, then 0.5 + (t - 0.25) / 2 after a linear change.
  const MotionPointer slow = weighted(translate(point({1.0, 0.0}), {0.5, 1.0}), {{0.0, 1.0}, {1.0, 3.0}});
  // tau = t + t^2: 0.5 at (sqrt(3) - 1) / 2, 1 at (sqrt(5) - 1) / 2.
  const std::vector<double> breaks = slow->breaks(-1.0, 2.0);
  ASSERT_EQ(breaks.size(), 4U);
  EXPECT_EQ(breaks[0], 0.0);
  EXPECT_NEAR(breaks[1], (std::sqrt(3.0) - 1.0) / 2.0, 1e-15);
  EXPECT_NEAR(breaks[2], (std::sqrt(5.0) - 1.0) / 2.0, 1e-15);
  EXPECT_EQ(breaks[3], 1.0);
  EXPECT_NEAR(slow->time().start, breaks[1], 1e-15);
  EXPECT_NEAR(slow->time().end, breaks[2], 1e-15);
}

TEST(OrientedPath, EndsTurnedByTheAngleOfTheTangentAndAPlainPathUnturned) {
  const TimeInterval unit;
  for (const bool in_space : {false, true}) {
    // Three quarters of a turn: more than the angle between the tangents tells.
    const double angle = 1.5 * pi;
    const auto lift = [&](double x, double y) { return in_space ? point({x, y, 1.0}) : point({x, y}); };
    const std::shared_ptr<const GuidanceCurve> arc =
        make_arc(lift(1.0, 0.0), lift(0.0, 0.0), angle, in_space ? point({0.0, 0.0, 1.0}) : SpacePoint(), unit);
    const SpacePoint a = lift(1.2, 0.1);
    const SpacePoint b = lift(1.4, 0.1);
    const MotionPointer oriented = follow_oriented(arc);
    const SpacePoint turned = oriented->position(0.0, b, 1.0) - oriented->position(0.0, a, 1.0);
    EXPECT_NEAR(std::atan2(turned[1], turned[0]), angle - 2.0 * pi, 1e-12);
    EXPECT_NEAR(turned.norm(), 0.2, 1e-13);
    const MotionPointer plain = follow(arc);
    EXPECT_LT((plain->position(0.0, b, 1.0) - plain->position(0.0, a, 1.0) - (b - a)).norm(), 1e-15);
    // A circle turns the region about its centre, at every time.
    const MotionPointer about = rotate(lift(0.0, 0.0), in_space ? point({0.0, 0.0, 1.0}) : SpacePoint(), angle, unit);
    for (const double t : {0.1, 0.5, 0.9}) {
      EXPECT_LT((oriented->position(0.0, a, t) - about->position(0.0, a, t)).norm(), 1e-13);
      EXPECT_LT((oriented->velocity(t, a) - about->velocity(t, a)).norm(), 1e-13);
    }
  }
}

TEST(OrientedPath, TurnsAboutTheCentreOfCurvature) {
  // The centre of the source, repaired: its velocity vanishes there.
  const auto curve = wave({0.0, 1.0});
  const MotionPointer motion = follow_oriented(curve);
  for (const double t : {0.1, 0.4, 0.6}) {
    const CurvePoint c = curve->at(t);
    const double vv = c.velocity.squaredNorm();
    const double va = c.velocity.dot(c.acceleration);
    const double aa = c.acceleration.squaredNorm();
    const SpacePoint centre = c.position + (c.acceleration * vv * vv - c.velocity * va * vv) / (vv * aa - va * va);
    EXPECT_LT(motion->velocity(t, centre).norm(), 1e-10 * c.velocity.norm());
  }
}

TEST(OrientedPath, IsRegularAtInflectionsAndOnStraightPieces) {
  const TimeInterval unit;
  const MotionPointer line = follow_oriented(make_line(rows({{0.0, 0.0}, {2.0, 1.0}}), unit));
  EXPECT_LT((line->velocity(0.3, point({9.0, 9.0})) - point({2.0, 1.0})).norm(), 1e-14);
  EXPECT_LT((line->position(0.0, point({9.0, 9.0}), 1.0) - point({11.0, 10.0})).norm(), 1e-14);
  // y = x^3 on [-1, 1]: the tangent turns and turns back; an inflection in the middle.
  const MotionPointer cubic =
      follow_oriented(make_polynomial(rows({{-1.0, -1.0}, {2.0, 6.0}, {0.0, -12.0}, {0.0, 8.0}}), unit));
  EXPECT_LT((cubic->velocity(0.5, point({3.0, 4.0})) - point({2.0, 0.0})).norm(), 1e-12);
  const SpacePoint start = point({-1.0, 0.0});
  EXPECT_LT((cubic->position(0.0, start, 1.0) - start - point({2.0, 2.0})).norm(), 1e-13);
}

TEST(OrientedPath, InSpaceCarriesTangentsAndDoesNotTwist) {
  const auto curve = knot({0.0, 2.0});
  const MotionPointer motion = follow_oriented(curve);
  // The frame along the path, against steps of a method of its own (double reflection, order 4).
  const auto frame = [&](double t, int steps) {
    Eigen::Vector3d r = Eigen::Vector3d(curve->at(0.0).velocity).cross(Eigen::Vector3d(0.3, -0.2, 1.0)).normalized();
    for (int k = 0; k < steps; ++k) {
      const CurvePoint a = curve->at(t * k / steps);
      const CurvePoint b = curve->at(t * (k + 1) / steps);
      const Eigen::Vector3d v = b.position - a.position;
      const Eigen::Vector3d ta = a.velocity.normalized();
      const Eigen::Vector3d tb = b.velocity.normalized();
      const Eigen::Vector3d rl = r - 2.0 / v.squaredNorm() * v.dot(r) * v;
      const Eigen::Vector3d tl = ta - 2.0 / v.squaredNorm() * v.dot(ta) * v;
      const Eigen::Vector3d w = tb - tl;
      r = rl - 2.0 / w.squaredNorm() * w.dot(rl) * w;
    }
    return r;
  };
  for (const double t : {0.3, 1.1, 2.0}) {
    const Eigen::Vector3d c0 = curve->at(0.0).position;
    const Eigen::Vector3d c = curve->at(t).position;
    const auto carried = [&](const Eigen::Vector3d& direction) {
      return Eigen::Vector3d(motion->position(0.0, c0 + direction, t) - c);
    };
    EXPECT_LT((carried(curve->at(0.0).velocity.normalized()) - curve->at(t).velocity.normalized()).norm(), 1e-13);
    EXPECT_LT((carried(frame(0.0, 0)) - frame(t, 4000)).norm(), 1e-10) << t;
  }
}

TEST(OrientedPath, RefusesCurvesWithoutATangent) {
  const TimeInterval unit;
  EXPECT_THAT(message_of([&] {
                follow_oriented(make_parabola(rows({{0.0, 0.0}, {1.0, 0.5}, {0.0, 0.0}}), unit));
              }),
              HasSubstr("t = 0.5"));
  EXPECT_THAT(message_of([&] {
                follow_oriented(make_spline(rows({{0.0, 0.0}, {1.0, 0.0}, {0.2, 0.0}}), unit));
              }),
              HasSubstr("the curve"));
  EXPECT_THAT(message_of([&] {
                follow_oriented(make_polynomial(rows({{0.0, 0.0}, {0.0, 0.0}, {1.0, 1.0}}), unit));
              }),
              HasSubstr("t = 0"));
  EXPECT_EQ(message_of([&] { follow(make_parabola(rows({{0.0, 0.0}, {1.0, 0.5}, {0.0, 0.0}}), unit)); }), "no error");
}

TEST(Bend, IsTheWayOfTheEndOfARolledUpSheet) {
  // A sheet from x = 0.1 to 3.9 rolled up by half a turn: radius 3.8 / pi.
  const double length = 3.8;
  const MotionPointer motion = bend(point({0.1, 0.5, 0.0}), point({3.9, 0.5, 0.0}), point({0.0, -1.0, 0.0}), pi, {});
  for (const double t : {0.004, 0.25, 0.5, 1.0}) {
    const double radius = length / (pi * t);
    const auto rolled = [&](double x, double y) {  // exact, beyond the end along the tangent
      const double arc = std::min(x - 0.1, length);
      const double angle = arc / radius;
      const double beyond = x - 0.1 - arc;
      return point({0.1 + radius * std::sin(angle) + beyond * std::cos(angle), y,
                    radius * (1.0 - std::cos(angle)) + beyond * std::sin(angle)});
    };
    EXPECT_LT((motion->position(0.0, point({3.9, 0.2, 0.0}), t) - rolled(3.9, 0.2)).norm(), 1e-13);
    EXPECT_LT((motion->position(0.0, point({4.0, 0.9, 0.0}), t) - rolled(4.0, 0.9)).norm(), 1e-13);
  }
  EXPECT_THAT(message_of([] {
                bend(point({0.0, 0.0, 0.0}), point({1.0, 0.0, 0.0}), point({1.0, 1.0, 0.0}), 1.0, {});
              }),
              HasSubstr("right angle"));
  EXPECT_THAT(message_of([] { bend(point({1.0, 0.0}), point({1.0, 0.0}), {}, 1.0, {}); }), HasSubstr("coincide"));
}

TEST(Sequence, ThereAndBackReturns) {
  const SpacePoint x = point({0.7, 0.2});
  const MotionPointer there = follow_oriented(wave({0.0, 0.5}));
  const MotionPointer both = in_sequence({there, reversed(there, {0.5, 1.0})});
  EXPECT_LT((both->position(0.0, x, 1.0) - x).norm(), 1e-14);
  for (const double t : {0.1, 0.3, 0.5}) {
    EXPECT_LT((both->position(0.0, x, t) - both->position(0.0, x, 1.0 - t)).norm(), 1e-14);
    EXPECT_LT((both->velocity(t - 1e-9, x) + both->velocity(1.0 - t + 1e-9, x)).norm(), 1e-6);
  }
  const MotionPointer line = follow(make_line(rows({{0.0, 0.0}, {1.0, 3.0}}), {0.0, 0.5}));
  const MotionPointer slowly_back = in_sequence({line, reversed(line, {1.0, 3.0})});
  EXPECT_LT((slowly_back->position(0.0, x, 0.75) - point({1.7, 3.2})).norm(), 1e-15);
  EXPECT_LT((slowly_back->velocity(2.0, x) - point({-0.5, -1.5})).norm(), 1e-15);
  EXPECT_LT((slowly_back->position(0.0, x, 3.0) - x).norm(), 1e-15);
  EXPECT_THAT(slowly_back->breaks(0.0, 3.0), ::testing::ElementsAre(0.5, 1.0));
}

TEST(Sequence, TakesTheLaterPartWhereTwoMeet) {
  const MotionPointer both =
      in_sequence({translate(point({1.0, 0.0}), {0.0, 0.5}), translate(point({0.0, 1.0}), {0.5, 1.0})});
  const SpacePoint x = point({0.0, 0.0});
  EXPECT_EQ(both->velocity(0.5, x), point({0.0, 1.0}));
  EXPECT_EQ(both->velocity(std::nextafter(0.5, 0.0), x), point({1.0, 0.0}));
  EXPECT_EQ(both->velocity(1.0, x), point({0.0, 1.0}));
  EXPECT_THAT(message_of([] {
                in_sequence({translate(point({1.0, 0.0}), {0.0, 0.6}), translate(point({0.0, 1.0}), {0.5, 1.0})});
              }),
              HasSubstr("segment 1 starts at t = 0.5, before segment 0 ends at t = 0.6"));
}

TEST(Weights, ChangeTheSpeedOnly) {
  const MotionPointer plain = follow_oriented(wave({0.0, 1.0}));
  // The integral over [0, 1] is 1.
  const MotionPointer eased = weighted(plain, {{0.0, 0.0}, {0.5, 2.0}, {1.0, 0.0}});
  const SpacePoint x = point({0.7, 0.2});
  EXPECT_LT((eased->position(0.0, x, 1.0) - plain->position(0.0, x, 1.0)).norm(), 1e-13);
  EXPECT_EQ(eased->velocity(0.0, x).norm(), 0.0);
  EXPECT_EQ(eased->velocity(1.0, x).norm(), 0.0);
  for (const double t : {0.1, 0.3, 0.5}) {  // tau = 2 t^2 in the first half
    EXPECT_LT((eased->position(0.0, x, t) - plain->position(0.0, x, 2.0 * t * t)).norm(), 1e-13);
    EXPECT_LT((eased->velocity(t, x) - 4.0 * t * plain->velocity(2.0 * t * t, x)).norm(), 1e-12);
  }
  // With a weight of 3 all is over after a third of the time, and the end is not lost to rounding.
  const MotionPointer fast = weighted(translate(point({1.0, 0.0}), {0.0, 0.3}), {{0.0, 3.0}});
  EXPECT_NEAR(fast->velocity(0.1, x)[0], 3.0, 1e-15);
  EXPECT_EQ(fast->velocity(0.11, x)[0], 0.0);
  EXPECT_NEAR(fast->position(0.0, x, 1.0)[0], 1.0, 1e-15);
  EXPECT_THAT(message_of([&] { weighted(plain, {{0.0, 1.0}, {0.5, -1.0}}); }), HasSubstr("weight knot 1 = [0.5, -1]"));
  EXPECT_THAT(message_of([&] { weighted(plain, {{0.5, 1.0}, {0.5, 1.0}}); }), HasSubstr("not after the one before"));
  EXPECT_THAT(message_of([&] { weighted(plain, {}); }), HasSubstr("at least one knot"));
}

TEST(Motions, BadValuesAreToldApart) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message_of([&] { translate(point({nan, 0.0}), {}); }), HasSubstr("velocity = [nan, 0]"));
  EXPECT_THAT(message_of([&] { translate(point({1.0, 0.0}), {0.0, nan}); }), HasSubstr("a start before an end"));
  EXPECT_THAT(message_of([&] { rotate(point({0.0, 0.0}), {}, nan, {}); }), HasSubstr("angular speed"));
  EXPECT_THAT(message_of([&] { rotate(point({0.0, 0.0}), point({0.0, 0.0, 1.0}), 1.0, {}); }), HasSubstr("in space"));
  EXPECT_THAT(message_of([&] {
                rotate(point({0.0, 0.0, 0.0}), point({0.0, 0.0, 0.0}), 1.0, {});
              }),
              HasSubstr("needs an axis"));
  EXPECT_THAT(message_of([&] {
                linear_field(Eigen::MatrixXd::Zero(3, 2), point({0.0, 0.0}), {});
              }),
              HasSubstr("3 x 2"));
  EXPECT_THAT(message_of([&] {
                linear_field(Eigen::MatrixXd::Zero(2, 2), point({0.0, 0.0, 1.0}), {});
              }),
              HasSubstr("b has 3 coordinates"));
  EXPECT_THAT(message_of([&] { polynomial_field({}, {}, {}); }), HasSubstr("needs A or b"));
}

class HandleSets : public ::testing::Test {
 protected:
  Domain domain{rectangle_mesh({.h = 0.25})};  // 25 vertices
};

TEST_F(HandleSets, ConflictsAreNamed) {
  const MotionPointer right = translate(point({1.0, 0.0}), {});
  const MotionPointer up = translate(point({0.0, 1.0}), {});
  const auto message = [&](const std::vector<Handle>& handles) {
    return message_of([&] { check_handles(handles, domain); });
  };
  EXPECT_THAT(message({{.name = "handle 0 (rim)", .vertices = {1, 2}}, {.vertices = {2, 3}, .motion = right}}),
              HasSubstr("vertex 2 is in handle 0 (rim) and in handle 1, which move it differently"));
  EXPECT_EQ(message({{.vertices = {1, 2}}, {.vertices = {2, 3}}}), "no error");
  EXPECT_EQ(message({{.vertices = {1, 2}, .motion = up}, {.vertices = {2, 3}, .motion = up}}), "no error");
  // Rollers that hold different components may share a corner.
  EXPECT_EQ(message({{.vertices = {1, 2}, .motion = up, .held = {false, true, false}},
                     {.vertices = {2, 3}, .motion = right, .held = {true, false, false}}}),
            "no error");
  EXPECT_THAT(message({{.name = "empty"}}), HasSubstr("empty: the region has no vertices"));
  EXPECT_THAT(message({{.vertices = {1, 25}}}), HasSubstr("handle 0: vertex 25 does not exist"));
  EXPECT_THAT(message({{.vertices = {-1}}}), HasSubstr("vertex -1"));
  EXPECT_THAT(message({{.vertices = {2, 1}}}), HasSubstr("ascending"));
  EXPECT_THAT(message({{.vertices = {1}, .held = {false, false, true}}}), HasSubstr("no component is held"));
  EXPECT_THAT(message({{.vertices = {1}, .motion = translate(point({1.0, 0.0, 0.0}), {})}}),
              HasSubstr("3 coordinates, the mesh has 2"));
}

TEST_F(HandleSets, FinalPositionsAreThoseOfTheMotions) {
  const MotionPointer turn = rotate(point({0.0, 0.0}), {}, pi / 2, {});
  Eigen::MatrixXd A(2, 2);
  A << 0.0, -pi / 2, pi / 2, 0.0;
  // The same quarter turn, begun slowly: no closed form, s in the field's own time.
  const MotionPointer growing = polynomial_field({Eigen::MatrixXd::Zero(2, 2), 2.0 * A}, {}, {});
  const std::vector<Handle> handles = {
      {.vertices = {0, 4}, .motion = turn},
      {.vertices = {20}, .motion = growing},
      {.vertices = {24}, .motion = translate(point({3.0, 5.0}), {0.0, 0.5}), .held = {false, true, true}},
      {.vertices = {12}}};
  const Matrix moved = handle_positions(handles, domain.positions(), 0.0, 1.0);
  EXPECT_LT((moved.row(4) - Eigen::RowVector2d(0.0, 1.0)).norm(), 1e-15);
  EXPECT_LT((moved.row(20) - Eigen::RowVector2d(-1.0, 0.0)).norm(), 1e-12);
  EXPECT_LT((moved.row(24) - Eigen::RowVector2d(1.0, 3.5)).norm(), 1e-15);
  EXPECT_EQ(moved.row(12), domain.positions().row(12));
  EXPECT_EQ(moved.row(7), domain.positions().row(7));
  EXPECT_EQ(breaks_of(handles, 0.0, 1.0), std::vector<double>{0.5});
  EXPECT_TRUE(handles[0].closed_form(2));
  EXPECT_FALSE(handles[1].closed_form(2));
  EXPECT_TRUE(handles[2].closed_form(2));
  EXPECT_TRUE(handles[3].closed_form(2));
  const Handle roller = {.vertices = {0}, .motion = turn, .held = {true, false, true}};
  EXPECT_FALSE(roller.closed_form(2));
  EXPECT_THAT(message_of([&] { handle_positions({roller}, domain.positions(), 0.0, 1.0); }),
              HasSubstr("handle 0: where it goes depends on"));
}

}  // namespace
}  // namespace variform
