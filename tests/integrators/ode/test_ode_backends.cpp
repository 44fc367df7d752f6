// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "framework/base/error.h"
#include "integrators/ode/ode_backends.h"
#include "tests/allocation_count.h"
#include "tests/integrators/ode/fields.h"

namespace variform {
namespace {

using ::testing::HasSubstr;
using testing::Spirals;
using testing::TestField;

std::vector<std::string> available() {
  std::vector<std::string> names;
  for (const OdeBackendEntry& entry : ode_backends().entries()) {
    if (entry.available) names.push_back(entry.name);
  }
  return names;
}

bool fixed(const std::string& name) { return name == "euler" || name == "rk4"; }

std::vector<std::string> controlled() {
  std::vector<std::string> names = available();
  std::erase_if(names, fixed);
  return names;
}

bool has_control_parameter(const std::string& name) { return name == "abm3" || name == "odeint.dopri5"; }

/// Methods that can take steps of the same size.
std::vector<std::string> with_equal_steps() {
  std::vector<std::string> names = available();
  std::erase_if(names, [](const std::string& name) { return !fixed(name) && !has_control_parameter(name); });
  return names;
}

std::unique_ptr<OdeBackend> make(const std::string& name, const std::map<std::string, ParameterValue>& values) {
  Parameters parameters(ode_backends().find(name).parameters);
  for (const auto& [key, value] : values) parameters.set(key, value);
  return make_ode_backend(name, parameters);
}

std::unique_ptr<OdeBackend> with_equal_steps(const std::string& name) {
  return fixed(name) ? make_ode_backend(name) : make(name, {{"control", false}});
}

double largest(const Vector& difference) { return difference.cwiseAbs().maxCoeff(); }

std::string safe(const ::testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
}

class Each : public ::testing::TestWithParam<std::string> {};
class Controlled : public ::testing::TestWithParam<std::string> {};
class EqualSteps : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Ode, Each, ::testing::ValuesIn(available()), safe);
INSTANTIATE_TEST_SUITE_P(Ode, Controlled, ::testing::ValuesIn(controlled()), safe);
INSTANTIATE_TEST_SUITE_P(Ode, EqualSteps, ::testing::ValuesIn(with_equal_steps()), safe);

/// Largest errors at the ends of 4 n equal steps and at output times; orders as log2 of the ratio to those of 2 n.
struct Orders {
  double steps = 0.0;
  double outputs = 0.0;
  double error = 0.0;
};
Orders measured(const std::string& name, const Spirals& spirals, const std::vector<double>& breaks = {}) {
  std::vector<double> at_steps, at_outputs;
  const double n = name == "euler" ? 400 : 32;
  for (const double steps : {2.0 * n, 4.0 * n}) {
    TestField field = spirals.field();
    field.break_times = breaks;
    const auto backend = with_equal_steps(name);
    OdeOptions options{.first_step = 1.0 / steps, .outputs = {}};
    for (int i = 1; i < 500; ++i) options.outputs.push_back(0.0039 * i);
    double worst_step = 0.0, worst_output = 0.0;
    std::size_t given = 0;
    backend->integrate(field, Spirals::start(), 0.0, 2.0, options,
                       {.step =
                            [&](const OdeStep& step, const Vector& y) {
                              worst_step = std::max(worst_step, largest(y - spirals.exact(step.time)));
                              return true;
                            },
                        .output =
                            [&](double t, const Vector& y) {
                              EXPECT_EQ(t, options.outputs[given++]);
                              worst_output = std::max(worst_output, largest(y - spirals.exact(t)));
                              return true;
                            }});
    EXPECT_TRUE(backend->report().completed);
    EXPECT_EQ(given, options.outputs.size());
    at_steps.push_back(worst_step);
    at_outputs.push_back(worst_output);
  }
  return {std::log2(at_steps[0] / at_steps[1]), std::log2(at_outputs[0] / at_outputs[1]), at_steps[1]};
}

TEST_P(EqualSteps, HaveTheirOrderAtTheEndAndBetweenSteps) {
  const int order = with_equal_steps(GetParam())->order();
  const Orders orders = measured(GetParam(), Spirals());
  EXPECT_GT(orders.steps, order - 0.3);
  EXPECT_LT(orders.steps, order + 0.9);  // the first term of the error of dopri5 is small
  EXPECT_GT(orders.outputs, std::min(order, 4) - 0.3);
}

// Speeds 1, 0.2 and 3, which change at 0.37 and 1.1. `side`: value at the break itself.
Spirals jumping(bool side) {
  const auto after = [side](double t, double at) { return side ? t >= at : t > at; };
  return {[after](double t) { return after(t, 1.1)    ? 3.0
                                     : after(t, 0.37) ? 0.2
                                                      : 1.0; },
          [](double t) {
            return std::min(t, 0.37) + 0.2 * std::clamp(t - 0.37, 0.0, 0.73) + 3.0 * std::max(t - 1.1, 0.0);
          }};
}

TEST_P(EqualSteps, KeepTheirOrderAcrossJumpsOnWhicheverSideTheirTimeCounts) {
  for (const bool side : {false, true}) {
    const int order = with_equal_steps(GetParam())->order();
    const Orders orders = measured(GetParam(), jumping(side), {0.37, 1.1});
    EXPECT_GT(orders.steps, order - 0.4) << side;
    if (order > 1) {
      EXPECT_GT(measured(GetParam(), jumping(side)).error, 100.0 * orders.error) << "without breaks";
    }
  }
}

TEST_P(Each, LandsOnBreaksAndTheEndExactly) {
  TestField field = jumping(true).field();
  field.break_times = {0.37, 1.1};
  std::vector<double> asked;
  TestField recording(6, 2, [&](double t, const Vector& y, Vector& dy) {
    asked.push_back(t);
    field.velocity(t, y, dy);
  });
  recording.break_times = field.break_times;
  const auto backend = make_ode_backend(GetParam());
  const OdeOptions options{.tolerance = 1e-5, .first_step = 0.013};
  const Vector y = backend->integrate(recording, Spirals::start(), 0.0, 2.0, options);
  const OdeReport& report = backend->report();
  EXPECT_TRUE(report.completed);
  EXPECT_EQ(report.reason, "end of the interval");
  EXPECT_EQ(report.time, 2.0);
  EXPECT_EQ(report.restarts, 2);
  EXPECT_EQ(report.refused, 0);
  EXPECT_EQ(static_cast<std::size_t>(report.steps), report.history.size());
  for (const double time : {0.37, 1.1, 2.0}) {
    EXPECT_EQ(std::count_if(report.history.begin(), report.history.end(),
                            [&](const OdeStep& step) { return step.time == time; }),
              1)
        << time;
  }
  double time = 0.0;
  for (const OdeStep& step : report.history) {
    EXPECT_NEAR(step.time - time, step.size, 1e-14);
    time = step.time;
  }
  for (const double t : asked) EXPECT_TRUE(t > 0.0 && t < 2.0 && t != 0.37 && t != 1.1) << t;
  EXPECT_LT(largest(y - jumping(true).exact(2.0)), GetParam() == "euler" ? 0.3 : 2e-3);
}

TEST_P(Controlled, ErrorFollowsTheTolerance) {
  double before = std::numeric_limits<double>::infinity();
  for (const double tolerance : {1e-4, 1e-6, 1e-8}) {
    TestField field = Spirals().field();
    const auto backend = make_ode_backend(GetParam());
    const Vector y = backend->integrate(field, Spirals::start(), 0.0, 2.0, {.tolerance = tolerance});
    const double error = largest(y - Spirals().exact(2.0));
    EXPECT_TRUE(backend->report().completed) << backend->report().reason;
    EXPECT_LT(error, 300.0 * tolerance);
    EXPECT_GT(error, 1e-3 * tolerance);
    EXPECT_LT(error, 0.3 * before);
    before = error;
    for (const OdeStep& step : backend->report().history) EXPECT_LE(step.error, tolerance);
  }
}

TEST_P(Controlled, TheToleranceIsByPointAndByLengthScale) {
  // One point that moves, alone or among many at rest, however large the shape is: the same steps.
  const auto steps = [&](Index points, double length, const Eigen::Vector2d& direction) {
    TestField field(2 * points, 2, [&](double t, const Vector& y, Vector& dy) {
      dy.setZero(y.size());
      dy.head(2) = length * std::cos(5.0 * t) * direction;
    });
    field.length = length;
    const auto backend = make_ode_backend(GetParam());
    backend->integrate(field, Vector::Zero(2 * points), 0.0, 3.0, {.tolerance = 1e-5});
    std::vector<double> times;
    for (const OdeStep& step : backend->report().history) times.push_back(step.time);
    return times;
  };
  const std::vector<double> alone = steps(1, 1.0, {1.0, 0.0});
  EXPECT_EQ(steps(100, 1.0, {1.0, 0.0}), alone);
  EXPECT_EQ(steps(1, 1024.0, {1.0, 0.0}), alone);
  const std::vector<double> turned = steps(1, 1.0, {0.6, 0.8});
  ASSERT_EQ(turned.size(), alone.size());
  for (std::size_t i = 0; i < alone.size(); ++i) EXPECT_NEAR(turned[i], alone[i], 5e-3);
}

TEST(Abm3, IntegratesQuadraticVelocitiesExactlyOnUnevenSteps) {
  TestField field(2, 1, [](double t, const Vector&, Vector& dy) {
    dy[0] = 1.0 - 4.0 * t + 9.0 * t * t;
    dy[1] = 4.0 * std::exp(-50.0 * (t - 1.0) * (t - 1.0)) + t * t * t;  // makes the steps uneven
  });
  const auto backend = make_ode_backend("abm3");
  const Vector y = backend->integrate(field, Vector::Zero(2), 0.0, 2.0, {.tolerance = 1e-4});
  EXPECT_NEAR(y[0], 2.0 - 8.0 + 24.0, 1e-12);
  EXPECT_GT(std::abs(y[1] - (4.0 * std::sqrt(std::acos(-1.0) / 50.0) + 4.0)), 1e-9) << "not exact";
  EXPECT_GT(backend->report().rejected, 0);
  EXPECT_EQ(backend->report().restarts, 0);
  double shortest = 1.0, longest = 0.0;
  for (const OdeStep& step : backend->report().history) {
    shortest = std::min(shortest, step.size);
    longest = std::max(longest, step.size);
  }
  EXPECT_GT(longest, 3.0 * shortest);
}

TEST(Abm3, EqualStepsHaveThePublishedWeights) {
  // y_{n+1} from 23, -16, 5 and 5, 8, -1 twelfths, for a velocity of the state, after two Runge-Kutta steps.
  const auto f = [](double t, double y) { return std::sin(3.0 * t) - y * y; };
  TestField field(1, 1, [&](double t, const Vector& y, Vector& dy) { dy[0] = f(t, y[0]); });
  const auto backend = make("abm3", {{"control", false}});
  std::vector<double> t = {0.0}, y = {0.4};
  backend->integrate(field, Vector::Constant(1, 0.4), 0.0, 1.0, {.first_step = 0.1},
                     {.step = [&](const OdeStep& step, const Vector& state) {
                       t.push_back(step.time);
                       y.push_back(state[0]);
                       return true;
                     }});
  ASSERT_EQ(t.size(), 11u);
  for (std::size_t n = 2; n + 1 < t.size(); ++n) {
    const double f0 = f(t[n], y[n]), f1 = f(t[n - 1], y[n - 1]), f2 = f(t[n - 2], y[n - 2]);
    const double predicted = y[n] + 0.1 / 12.0 * (23.0 * f0 - 16.0 * f1 + 5.0 * f2);
    const double corrected = y[n] + 0.1 / 12.0 * (5.0 * f(t[n + 1], predicted) + 8.0 * f0 - f1);
    EXPECT_NEAR(y[n + 1], corrected, 1e-14);
    EXPECT_NEAR(backend->report().history[n].error, std::abs(corrected - predicted) / 10.0, 1e-14);
  }
}

TEST(Abm3, TheEstimateIsTheErrorOfAStepWhereTheThirdDerivativeIsConstant) {
  TestField field(1, 1, [](double t, const Vector&, Vector& dy) { dy[0] = t * t * t; });
  const auto backend = make_ode_backend("abm3");
  std::vector<double> t = {0.0}, y = {0.0};
  backend->integrate(field, Vector::Zero(1), 0.0, 2.0, {.tolerance = 1e-4, .first_step = 1e-3},
                     {.step = [&](const OdeStep& step, const Vector& state) {
                       t.push_back(step.time);
                       y.push_back(state[0]);
                       return true;
                     }});
  ASSERT_GT(t.size(), 10u);
  EXPECT_GT(t[5] - t[4], 1.5 * (t[4] - t[3])) << "uneven";
  for (std::size_t n = 2; n + 1 < t.size(); ++n) {
    const double exact = (std::pow(t[n + 1], 4) - std::pow(t[n], 4)) / 4.0;
    const double error = std::abs(y[n + 1] - y[n] - exact);
    EXPECT_NEAR(backend->report().history[n].error, error, 1e-13);
  }
}

TEST_P(Each, CountsEvaluations) {
  TestField field = Spirals().field();
  const auto backend = make_ode_backend(GetParam());
  backend->integrate(field, Spirals::start(), 0.0, 2.0, {.tolerance = 1e-5, .first_step = 0.02});
  EXPECT_EQ(backend->report().evaluations, field.evaluations);
  EXPECT_EQ(backend->report().history.back().evaluations, field.evaluations);
}

TEST_P(EqualSteps, TakeTheEvaluationsThatTheyDeclare) {
  const std::map<std::string, int> expected = {
      {"euler", 50}, {"rk4", 4 * 50}, {"abm3", 2 * 4 + 2 * 48}, {"odeint.dopri5", 6 * 50}};
  TestField field = Spirals().field();
  const auto backend = with_equal_steps(GetParam());
  backend->integrate(field, Spirals::start(), 0.0, 2.0, {.first_step = 0.02});
  EXPECT_EQ(backend->report().steps, 50);
  EXPECT_EQ(field.evaluations, expected.at(GetParam()) + 1) << "one at the start";
}

TEST_P(Each, ARefusedVelocityIsAnEventWhoseTimeIsFound) {
  TestField field(2, 1, [](double t, const Vector& y, Vector& dy) {
    if (y[0] >= 0.7123) throw StepRefused("cell 17 inverts");
    dy << 1.0, std::sin(t);
  });
  const auto backend = make_ode_backend(GetParam());
  const Vector y = backend->integrate(field, Vector::Zero(2), 0.0, 2.0, {.smallest_step = 1e-7});
  const OdeReport& report = backend->report();
  EXPECT_FALSE(report.completed);
  EXPECT_EQ(report.event, "cell 17 inverts");
  EXPECT_THAT(report.reason, HasSubstr("cell 17 inverts"));
  EXPECT_THAT(report.reason, HasSubstr("0.7123"));
  EXPECT_NEAR(report.time, 0.7123, 1e-6);
  EXPECT_EQ(report.time, report.history.back().time);
  EXPECT_NEAR(y[0], report.time, 1e-9) << "the last good state";
  EXPECT_GT(report.refused, 5);
  EXPECT_EQ(report.evaluations, field.evaluations);
}

TEST_P(Each, ARefusedEndIsAnEventWhoseTimeIsFound) {
  TestField field(2, 1, [](double t, const Vector&, Vector& dy) { dy << 1.0, std::sin(t); });
  field.refuses = [](double, const Vector& y) { return y[0] >= 0.7123 ? "cell 17 inverts" : ""; };
  const auto backend = make_ode_backend(GetParam());
  const Vector y = backend->integrate(field, Vector::Zero(2), 0.0, 2.0, {.smallest_step = 1e-7});
  const OdeReport& report = backend->report();
  EXPECT_FALSE(report.completed);
  EXPECT_EQ(report.event, "cell 17 inverts");
  EXPECT_NEAR(report.time, 0.7123, 1e-6);
  EXPECT_LT(y[0], 0.7123);
  EXPECT_NEAR(y[0], report.time, 1e-9);
}

TEST_P(Each, WhatIsRefusedAtTheStartIsAnEventThere) {
  TestField none(1, 1, [](double, const Vector&, Vector&) { throw StepRefused("no velocity"); });
  const auto backend = make_ode_backend(GetParam());
  EXPECT_EQ(backend->integrate(none, Vector::Ones(1), 0.5, 2.0, {})[0], 1.0);
  EXPECT_EQ(backend->report().event, "no velocity");
  EXPECT_EQ(backend->report().time, 0.5);
  EXPECT_EQ(backend->report().steps, 0);
  TestField bad(1, 1, [](double, const Vector&, Vector& dy) { dy[0] = 1.0; });
  bad.refuses = [](double, const Vector&) { return "inverted"; };
  backend->integrate(bad, Vector::Ones(1), 0.5, 2.0, {});
  EXPECT_EQ(backend->report().event, "inverted");
  EXPECT_EQ(bad.evaluations, 0);
}

TEST_P(Each, GoesOnWithShorterStepsWhereLongOnesAreRefused) {
  TestField field = Spirals().field();
  Vector last = Spirals::start();
  field.refuses = [&](double, const Vector& y) { return largest(y - last) > 0.03 ? "too far" : ""; };
  const auto backend = make_ode_backend(GetParam());
  const Vector y = backend->integrate(field, last, 0.0, 2.0, {.first_step = 0.1, .smallest_step = 1e-4},
                                      {.step = [&](const OdeStep&, const Vector& state) {
                                        last = state;
                                        return true;
                                      }});
  EXPECT_TRUE(backend->report().completed) << backend->report().reason;
  EXPECT_TRUE(backend->report().event.empty());
  EXPECT_GT(backend->report().refused, 2);
  EXPECT_LT(largest(y - Spirals().exact(2.0)), GetParam() == "euler" ? 0.1 : 1e-2);
}

TEST_P(Each, MeasuresDriftAndRemovesIt) {
  // The first point is on the unit circle; its velocity is taken at t, not at y.
  const auto path = [](double t) { return Eigen::Vector2d(std::cos(2.0 * t), std::sin(2.0 * t)); };
  TestField field(4, 2, [](double t, const Vector& y, Vector& dy) {
    dy.head(2) << -2.0 * std::sin(2.0 * t), 2.0 * std::cos(2.0 * t);
    dy.tail(2) = -y.tail(2);
  });
  field.length = 4.0;
  field.projects = [&](double t, Vector& y) {
    const double moved = (y.head(2) - path(t)).norm();
    y.head(2) = path(t);
    return moved;
  };
  const auto backend = make_ode_backend(GetParam());
  std::vector<double> times = {0.0};
  Vector y0(4);
  y0 << 1.0, 0.0, 1.0, 2.0;
  OdeOptions options{.tolerance = 1e-4, .outputs = {0.3, 0.77}};
  const Vector y = backend->integrate(field, y0, 0.0, 2.0, options,
                                      {.step =
                                           [&](const OdeStep& step, const Vector& state) {
                                             EXPECT_EQ(state.head(2), path(step.time));
                                             times.push_back(step.time);
                                             return true;
                                           },
                                       .output =
                                           [&](double t, const Vector& state) {
                                             EXPECT_EQ(state.head(2), path(t));
                                             return true;
                                           }});
  EXPECT_EQ(y.head(2), path(2.0));
  const OdeReport& report = backend->report();
  double drift = 0.0;
  for (const OdeStep& step : report.history) drift = std::max(drift, step.drift);
  EXPECT_EQ(report.drift, drift);
  EXPECT_GT(drift, 0.0);
  EXPECT_LT(drift, GetParam() == "euler" ? 0.05 : 1e-3);
  if (GetParam() == "euler") {
    Eigen::Vector2d sum = y0.head(2);
    for (std::size_t i = 0; i + 1 < times.size(); ++i) {
      const double t = times[i];
      sum += (times[i + 1] - t) * 2.0 * Eigen::Vector2d(-std::sin(2.0 * t), std::cos(2.0 * t));
    }
    EXPECT_NEAR(report.history.back().drift, (sum - path(2.0)).norm() / 4.0, 1e-12);
  }
}

struct Outcome {
  Vector end = {};
  OdeReport report = {};
  std::vector<OdeCheckpoint> checkpoints = {};
  std::vector<std::pair<double, Vector>> outputs = {};
};

Outcome run(const std::string& name, const OdeCheckpoint* from, bool checkpoints) {
  TestField field = jumping(true).field();
  field.break_times = {0.37, 1.1};
  Outcome result;
  OdeObserver observer{.output =
                           [&](double t, const Vector& y) {
                             result.outputs.emplace_back(t, y);
                             return true;
                           },
                       .checkpoint_steps = 3};
  if (checkpoints) {
    observer.checkpoint = [&](const OdeCheckpoint& checkpoint) { result.checkpoints.push_back(checkpoint); };
  }
  const OdeOptions options{.tolerance = 1e-4, .first_step = 0.03, .outputs = {0.0, 0.2, 0.37, 0.5, 1.3, 1.99, 2.0}};
  const auto backend = make_ode_backend(name);
  result.end = from != nullptr ? backend->resume(field, *from, 0.0, 2.0, options, observer)
                               : backend->integrate(field, Spirals::start(), 0.0, 2.0, options, observer);
  result.report = backend->report();
  return result;
}

void expect_same(const OdeReport& a, const OdeReport& b) {
  EXPECT_EQ(a.evaluations, b.evaluations);
  EXPECT_EQ(a.rejected, b.rejected);
  EXPECT_EQ(a.refused, b.refused);
  EXPECT_EQ(a.restarts, b.restarts);
  EXPECT_EQ(a.drift, b.drift);
  EXPECT_EQ(a.completed, b.completed);
  ASSERT_EQ(a.history.size(), b.history.size());
  for (std::size_t i = 0; i < a.history.size(); ++i) {
    EXPECT_EQ(a.history[i].number, b.history[i].number);
    EXPECT_EQ(a.history[i].time, b.history[i].time);
    EXPECT_EQ(a.history[i].size, b.history[i].size);
    EXPECT_TRUE(a.history[i].error == b.history[i].error || std::isnan(a.history[i].error)) << i;
    EXPECT_EQ(a.history[i].evaluations, b.history[i].evaluations);
  }
}

TEST_P(Each, GoesOnFromEveryCheckpointToTheSameBits) {
  const Outcome whole = run(GetParam(), nullptr, true);
  ASSERT_TRUE(whole.report.completed);
  ASSERT_GT(whole.checkpoints.size(), 3u);
  ASSERT_EQ(whole.outputs.size(), 7u);
  const std::size_t stride = 1 + whole.checkpoints.size() / 15;
  for (std::size_t k = 0; k < whole.checkpoints.size(); k += stride) {
    const OdeCheckpoint& checkpoint = whole.checkpoints[k];
    SCOPED_TRACE(checkpoint.time);
    EXPECT_EQ(checkpoint.report.steps % 3, 0);
    EXPECT_EQ(static_cast<std::size_t>(checkpoint.report.steps), checkpoint.report.history.size());
    const Outcome rest = run(GetParam(), &checkpoint, true);
    EXPECT_EQ(rest.end, whole.end);
    expect_same(rest.report, whole.report);
    ASSERT_EQ(rest.outputs.size() + checkpoint.outputs, whole.outputs.size());
    for (std::size_t i = 0; i < rest.outputs.size(); ++i) {
      EXPECT_EQ(rest.outputs[i], whole.outputs[i + checkpoint.outputs]);
    }
  }
}

TEST_P(Each, CheckpointsChangeNothingWhereTheHistoryIsKept) {
  const Outcome with = run(GetParam(), nullptr, true);
  const Outcome without = run(GetParam(), nullptr, false);
  if (GetParam().starts_with("cvode") || GetParam().starts_with("arkode")) {
    EXPECT_EQ(without.report.restarts, 2);
    EXPECT_GT(with.report.restarts, 2);
    EXPECT_LT(largest(with.end - without.end), 1e-2);
  } else {
    EXPECT_EQ(with.end, without.end);
    expect_same(with.report, without.report);
  }
}

TEST_P(Each, GoesBackToWhereItCameFrom) {
  TestField field = Spirals().field();
  TestField back(6, 2, [&](double t, const Vector& y, Vector& dy) {
    field.velocity(0.5 - t, y, dy);
    dy = -dy;
  });
  const auto backend = make_ode_backend(GetParam());
  const OdeOptions options{.tolerance = 1e-8, .first_step = 0.002};
  const Vector y = backend->integrate(field, Spirals::start(), 0.0, 0.5, options);
  const Vector again = backend->integrate(back, y, 0.0, 0.5, options);
  EXPECT_GT(largest(y - Spirals::start()), 0.3);
  EXPECT_LT(largest(again - Spirals::start()), GetParam() == "euler" ? 0.2 : 1e-4);
}

TEST_P(Each, GivesOutputsAtBothEndsAndMayBeStopped) {
  TestField field = Spirals().field();
  const auto backend = make_ode_backend(GetParam());
  std::vector<double> times;
  Vector first, last;
  const Vector y = backend->integrate(field, Spirals::start(), 0.0, 2.0, {.outputs = {0.0, 2.0}},
                                      {.output = [&](double t, const Vector& state) {
                                        times.push_back(t);
                                        (t == 0.0 ? first : last) = state;
                                        return true;
                                      }});
  EXPECT_EQ(times, (std::vector<double>{0.0, 2.0}));
  EXPECT_EQ(first, Spirals::start());
  EXPECT_EQ(last, y);
  backend->integrate(field, Spirals::start(), 0.0, 2.0, {},
                     {.step = [](const OdeStep& step, const Vector&) { return step.number < 3; }});
  EXPECT_EQ(backend->report().steps, 3);
  EXPECT_FALSE(backend->report().completed);
  EXPECT_EQ(backend->report().reason, "stopped by the observer");
  EXPECT_TRUE(backend->report().event.empty());
}

TEST_P(Each, EndsAtTheLimitOfSteps) {
  TestField field = Spirals().field();
  const auto backend = make_ode_backend(GetParam());
  backend->integrate(field, Spirals::start(), 0.0, 2.0, {.max_steps = 4});
  EXPECT_EQ(backend->report().steps, 4);
  EXPECT_FALSE(backend->report().completed);
  EXPECT_THAT(backend->report().reason, HasSubstr("step limit 4 at time"));
}

TEST_P(Controlled, EndsWhereTheToleranceNeedsStepsThatAreTooSmall) {
  TestField field(1, 1, [](double, const Vector& y, Vector& dy) { dy[0] = y[0] * y[0]; });  // 1 / (1 - t)
  const auto backend = make_ode_backend(GetParam());
  backend->integrate(field, Vector::Ones(1), 0.0, 2.0, {.tolerance = 1e-6, .smallest_step = 1e-5});
  EXPECT_FALSE(backend->report().completed);
  EXPECT_THAT(backend->report().reason, HasSubstr("smallest 2e-05"));
  EXPECT_TRUE(backend->report().event.empty());
  EXPECT_NEAR(backend->report().time, 1.0, 0.02);
}

TEST_P(Each, ValuesThatAreNotFiniteAreErrorsWithTheirTime) {
  TestField field(1, 1, [](double t, const Vector&, Vector& dy) {
    dy[0] = t > 0.75 ? std::numeric_limits<double>::quiet_NaN() : 1.0;
  });
  const auto backend = make_ode_backend(GetParam());
  try {
    backend->integrate(field, Vector::Zero(1), 0.0, 1.0, {});
    FAIL();
  } catch (const SolverError& error) {
    EXPECT_THAT(error.what(), HasSubstr(GetParam()));
    EXPECT_THAT(error.what(), ::testing::ContainsRegex("time (0\\.[789]|1)"));
  }
  Vector y0 = Vector::Constant(1, std::numeric_limits<double>::infinity());
  EXPECT_THROW(backend->integrate(field, y0, 0.0, 1.0, {}), SolverError);
}

TEST_P(Each, ErrorsOfTheFieldPassThrough) {
  TestField field(1, 1, [](double t, const Vector&, Vector& dy) {
    if (t > 0.5) throw DataError("broken beyond repair");
    dy[0] = 1.0;
  });
  const auto backend = make_ode_backend(GetParam());
  EXPECT_THROW(backend->integrate(field, Vector::Zero(1), 0.0, 1.0, {}), DataError);
  TestField good = Spirals().field();
  backend->integrate(good, Spirals::start(), 0.0, 1.0, {});
  EXPECT_TRUE(backend->report().completed) << "usable after an error";
}

TEST_P(Each, WhatMakesNoSenseIsRefused) {
  TestField field = Spirals().field();
  const Vector y0 = Spirals::start();
  const auto backend = make_ode_backend(GetParam());
  const auto bad = [&](double t0, double t1, const OdeOptions& options) {
    EXPECT_THROW(backend->integrate(field, y0, t0, t1, options), UsageError);
  };
  bad(1.0, 1.0, {});
  bad(1.0, 0.0, {});
  bad(0.0, std::numeric_limits<double>::infinity(), {});
  bad(0.0, 1.0, {.tolerance = 0.0});
  bad(0.0, 1.0, {.tolerance = std::numeric_limits<double>::quiet_NaN()});
  bad(0.0, 1.0, {.first_step = 0.0});
  bad(0.0, 1.0, {.first_step = 2.0});
  bad(0.0, 1.0, {.smallest_step = 0.5});
  bad(0.0, 1.0, {.smallest_step = 0.0});
  bad(1e12, 1e12 + 1.0, {});
  bad(0.0, 1.0, {.max_steps = 0});
  bad(0.0, 1.0, {.outputs = {0.5, 0.4}});
  bad(0.0, 1.0, {.outputs = {1.5}});
  EXPECT_THROW(backend->integrate(field, Vector::Zero(5), 0.0, 1.0, {}), UsageError);
  EXPECT_THROW(backend->integrate(field, y0, 0.0, 1.0, {}, {.checkpoint_steps = 0}), UsageError);
  field.length = 0.0;
  bad(0.0, 1.0, {});
  field.length = 1.0;
  field.break_times = {0.5, 0.3};
  bad(0.0, 1.0, {});
  field.break_times = {};
  OdeCheckpoint checkpoint;
  checkpoint.state = y0;
  checkpoint.step = 0.1;
  checkpoint.report.backend = "another";
  EXPECT_THROW(backend->resume(field, checkpoint, 0.0, 1.0, {}), UsageError);
  checkpoint.report.backend = GetParam();
  checkpoint.time = 3.0;
  EXPECT_THROW(backend->resume(field, checkpoint, 0.0, 1.0, {}), UsageError);
}

TEST_P(Each, StepsAllocateNothing) {
  TestField field = Spirals().field();
  field.break_times = {0.4};
  const auto backend = make_ode_backend(GetParam());
  OdeOptions options{.tolerance = 1e-6, .first_step = 0.005};
  for (int i = 1; i < 20; ++i) options.outputs.push_back(0.1 * i);
  long before = testing::allocation_count(), steps = 0, outputs = 0, during = 0;
  const Vector allocated = Vector::Zero(static_cast<Index>(options.outputs.size()));
  ASSERT_GT(testing::allocation_count(), before + static_cast<long>(allocated.norm())) << "they are counted";
  backend->integrate(field, Spirals::start(), 0.0, 2.0, options,
                     {.step =
                          [&](const OdeStep& step, const Vector&) {
                            // Libraries allocate when they start.
                            const long count = testing::allocation_count();
                            if (step.number > 1 && step.time - step.size != 0.4) during += count - before;
                            ++steps;
                            before = testing::allocation_count();
                            return true;
                          },
                      .output =
                          [&](double, const Vector&) {
                            ++outputs;
                            return true;
                          }});
  EXPECT_GT(steps, 20);
  EXPECT_EQ(outputs, 19);
  EXPECT_EQ(during, 0);
}

#ifdef VARIFORM_TEST_SUNDIALS

TEST(OdeBackends, StiffFieldsWantBdf) {
  const auto steps = [](const std::unique_ptr<OdeBackend>& backend) {
    TestField field(1, 1, [](double t, const Vector& y, Vector& dy) { dy[0] = -1e4 * (y[0] - std::cos(t)); });
    const Vector y = backend->integrate(field, Vector::Ones(1), 0.0, 3.0, {.smallest_step = 1e-9});
    EXPECT_TRUE(backend->report().completed) << backend->report().reason;
    EXPECT_NEAR(y[0], std::cos(3.0), 1e-3);
    return backend->report().steps;
  };
  EXPECT_LT(20 * steps(make_ode_backend("cvode.bdf")), steps(make_ode_backend("cvode.adams")));
}

TEST(OdeBackends, TheNonlinearSolverOfCvodeIsChosen) {
  for (const std::string name : {"cvode.adams", "cvode.bdf"}) {
    for (const std::string solver : {"fixed_point", "newton_krylov"}) {
      TestField field = Spirals().field();
      const auto backend = make(name, {{"nonlinear", solver}, {"max_order", std::int64_t{4}}});
      const Vector y = backend->integrate(field, Spirals::start(), 0.0, 2.0, {.tolerance = 1e-7});
      EXPECT_LT(largest(y - Spirals().exact(2.0)), 3e-5) << name << solver;
      EXPECT_EQ(backend->order(), 4);
    }
  }
}

TEST(OdeBackends, EveryTableOfArkodeHasItsOrder) {
  const OdeBackendEntry& entry = ode_backends().find("arkode.erk");
  ASSERT_EQ(entry.parameters.size(), 1u);
  int evaluations = std::numeric_limits<int>::max();
  for (const std::string& table : entry.parameters.front().choices) {
    TestField field = Spirals().field();
    const auto backend = make("arkode.erk", {{"table", table}});
    const Vector y = backend->integrate(field, Spirals::start(), 0.0, 2.0, {.tolerance = 1e-8});
    EXPECT_LT(largest(y - Spirals().exact(2.0)), 3e-6) << table;
    if (backend->order() <= 4) {  // the higher, the fewer
      EXPECT_LT(backend->report().evaluations, evaluations) << table;
      evaluations = static_cast<int>(backend->report().evaluations);
    }
  }
}

#endif

TEST(OdeBackends, ThoseThatAreNotCompiledInSaySo) {
  for (const OdeBackendEntry& entry : ode_backends().entries()) {
    if (entry.available) continue;
    try {
      make_ode_backend(entry.name);
      FAIL() << entry.name;
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr(entry.package));
      EXPECT_THAT(error.what(), HasSubstr(entry.option));
    }
  }
  EXPECT_THROW(make_ode_backend("nope"), UsageError);
}

}  // namespace
}  // namespace variform
