// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/search.h"

#include <Eigen/Core>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "framework/base/error.h"

namespace variform {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Neighbours on an L-curve closer than this, relative to its length, tell nothing about its shape.
constexpr double kShortest = 1e-6;

/// Relative change against the expected direction that passes for rounding.
constexpr double kSlack = 1e-9;

/// Values whose coordinate is not finite (the lower end 0 of the logarithmic ones) can be tried, but not stepped from.
double to_coordinate(Spacing spacing, double value) {
  switch (spacing) {
    case Spacing::arithmetic: return value;
    case Spacing::geometric: return std::log(value);
    case Spacing::odds: return std::log(value) - std::log1p(-value);
  }
  return value;
}

double from_coordinate(Spacing spacing, double coordinate) {
  switch (spacing) {
    case Spacing::arithmetic: return coordinate;
    case Spacing::geometric: return std::exp(coordinate);
    case Spacing::odds: return 1.0 / (1.0 + std::exp(-coordinate));
  }
  return coordinate;
}

/// `up`: the next value of growing, else of shrinking.
double stepped(const ThresholdSearch& search, double value, bool up) {
  if (search.spacing == Spacing::arithmetic) {
    const double distance = value - search.low;
    return search.low + (up ? distance * search.factor : distance / search.factor);
  }
  const double step = std::log(search.factor);
  return from_coordinate(search.spacing, to_coordinate(search.spacing, value) + (up ? step : -step));
}

double middle_of(const ThresholdSearch& search, double low, double high) {
  const double a = to_coordinate(search.spacing, low);
  const double b = to_coordinate(search.spacing, high);
  if (!std::isfinite(a)) return 0.5 * (low + high);
  return from_coordinate(search.spacing, 0.5 * (a + b));
}

void check(const ThresholdSearch& search) {
  const auto fail = [&search](const std::string& what) {
    throw UsageError(fmt::format("search for {}: {}", search.key.empty() ? "a value" : search.key, what));
  };
  if (!(search.low < search.high && std::isfinite(search.high - search.low))) {
    fail(fmt::format("expected low < high, both finite, got {} and {}", search.low, search.high));
  }
  if (search.spacing != Spacing::arithmetic && search.low < 0.0) fail("expected low >= 0");
  if (search.spacing == Spacing::odds && search.high >= 1.0) fail("expected high < 1");
  if (search.start && !(*search.start > search.low && *search.start <= search.high)) {
    fail(fmt::format("expected a start above {} and up to {}, got {}", search.low, search.high, *search.start));
  }
  if (!(search.factor > 1.0)) fail("expected a factor above 1");
  if (!(search.absolute_tolerance >= 0.0 && search.relative_tolerance >= 0.0 &&
        search.absolute_tolerance + search.relative_tolerance > 0.0)) {
    fail("expected a positive tolerance");
  }
  if (search.max_trials < 2) fail("expected at least 2 trials");
}

class Threshold {
 public:
  Threshold(const ThresholdSearch& search, const TrialRun& run) : search_(search), run_(run) {
    trials_.key = search.key;
    trials_.aim = fmt::format("smallest {} with {}", search.key, search.until.text());
    for (const std::string& key : search.until.keys()) {
      if (std::find(trials_.metrics.begin(), trials_.metrics.end(), key) == trials_.metrics.end()) {
        trials_.metrics.push_back(key);
      }
    }
  }

  Trials result() {
    low_ = high_ = search_.low;
    found_ = holds(search_.low, "low end");
    if (!found_ && bracket()) halve();
    trials_.found = found_;
    trials_.value = found_ ? high_ : kNaN;
    trials_.low = low_;
    trials_.high = high_;
    return std::move(trials_);
  }

 private:
  bool holds(double value, const char* asked) {
    const Row metrics = run_(value);
    const bool held = search_.until.holds(metrics);
    Row row;
    row.set(search_.key, value);
    row.set("asked", std::string(asked));
    row.set("held", held);
    for (const auto& [key, metric] : metrics.entries()) {
      if (row.find(key) == nullptr) row.set(key, metric);
    }
    trials_.rows.push_back(std::move(row));
    return held;
  }

  bool may_run() const { return static_cast<int>(trials_.rows.size()) < search_.max_trials; }

  bool is_narrow() const {
    return high_ - low_ <= std::max(search_.absolute_tolerance, search_.relative_tolerance * high_);
  }

  /// The condition does not hold at low_. Finds low_ and high_ around a change; false when there is none.
  bool bracket() {
    double value = search_.start.value_or(search_.high);
    found_ = holds(value, search_.start ? "start" : "high end");
    high_ = value;
    while (!found_ && value < search_.high && may_run()) {
      low_ = value;
      value = std::min(stepped(search_, value, true), search_.high);
      found_ = holds(value, value == search_.high ? "high end" : "grow");
      high_ = value;
    }
    if (!search_.start || low_ > search_.low) return found_;
    while (found_ && !is_narrow() && may_run()) {
      value = stepped(search_, high_, false);
      // With a relative tolerance alone the way down to an end at 0 would never end: below this, it is 0.
      if (value - search_.low <= 1e-12 * (search_.high - search_.low)) break;
      if (!holds(value, "shrink")) {
        low_ = value;
        break;
      }
      high_ = value;
    }
    return found_;
  }

  void halve() {
    while (!is_narrow() && may_run()) {
      const double middle = middle_of(search_, low_, high_);
      if (!(middle > low_ && middle < high_)) break;  // the tolerance asks for more than doubles have
      if (low_ == search_.low && high_ - low_ <= 1e-12 * (search_.high - search_.low)) break;
      (holds(middle, "bisect") ? high_ : low_) = middle;
    }
  }

  const ThresholdSearch& search_;
  const TrialRun& run_;
  Trials trials_;
  double low_ = 0.0;
  double high_ = 0.0;
  bool found_ = false;
};

/// Signed: positive where a, b, c turn to the left.
double menger_curvature(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d ab = b - a;
  const Eigen::Vector2d bc = c - b;
  const double area_by_two = ab.x() * bc.y() - ab.y() * bc.x();
  return 2.0 * area_by_two / (ab.norm() * bc.norm() * (c - a).norm());
}

double metric_of(const Row& row, const std::string& key) {
  const Value* const value = row.find(key);
  if (value == nullptr) throw UsageError(fmt::format("L-curve: rows have no metric '{}'", key));
  return to_number(*value);
}

}  // namespace

Trials find_threshold(const ThresholdSearch& search, const TrialRun& run) {
  check(search);
  return Threshold(search, run).result();
}

ThresholdSearch smallest_beta(const Condition& until, double start, double relative_tolerance, double high) {
  return {.key = "norm.beta",
          .until = until,
          .low = 0.0,
          .high = high,
          .start = start,
          .spacing = Spacing::odds,
          .absolute_tolerance = 1e-6,
          .relative_tolerance = relative_tolerance};
}

Trials l_curve(const LCurveSearch& search, const TrialRun& run) {
  if (!(0.0 < search.low && search.low < search.high && search.high < 1.0)) {
    throw UsageError(fmt::format("L-curve: expected 0 < low < high < 1, got {} and {}", search.low, search.high));
  }
  if (search.count < 3) throw UsageError("L-curve: expected at least 3 points");
  Trials trials{.key = search.key,
                .aim = fmt::format("corner of the L-curve of {} and {}", search.residual, search.regularizer),
                .metrics = {search.regularizer},
                .against = search.residual,
                .value = kNaN,
                .low = search.low,
                .high = search.high};
  struct Point {
    std::size_t row;
    double value;
    Eigen::Vector2d place;
  };
  std::vector<Point> points;
  const double first = to_coordinate(Spacing::odds, search.low);
  const double last = to_coordinate(Spacing::odds, search.high);
  for (int i = 0; i < search.count; ++i) {
    const double value = i == 0 ? search.low
                         : i == search.count - 1
                             ? search.high
                             : from_coordinate(Spacing::odds, first + (last - first) * i / (search.count - 1));
    const Row metrics = run(value);
    const double residual = metric_of(metrics, search.residual);
    const double regularizer = metric_of(metrics, search.regularizer);
    const Eigen::Vector2d place(std::log(residual), std::log(regularizer));
    const bool usable = place.allFinite() && std::min(residual, regularizer) > search.floor;
    Row row;
    row.set(search.key, value);
    row.set("asked", std::string("grid"));
    row.set("held", usable);
    for (const auto& [key, metric] : metrics.entries()) {
      if (row.find(key) == nullptr) row.set(key, metric);
    }
    trials.rows.push_back(std::move(row));
    if (!usable) continue;
    if (!points.empty()) {
      const Eigen::Vector2d change = place - points.back().place;
      const auto remark = [&](const std::string& metric, const char* what) {
        trials.remarks.push_back(
            fmt::format("{} {} from {} = {:.6g} to {:.6g}", metric, what, search.key, points.back().value, value));
      };
      if (change.x() < -kSlack) remark(search.residual, "falls");
      if (change.y() > kSlack) remark(search.regularizer, "rises");
    }
    points.push_back({trials.rows.size() - 1, value, place});
  }

  double length = 0.0;
  for (std::size_t i = 1; i < points.size(); ++i) length += (points[i].place - points[i - 1].place).norm();
  double largest = 0.0;
  for (std::size_t i = 1; i + 1 < points.size(); ++i) {
    const auto& [a, b, c] = std::tie(points[i - 1].place, points[i].place, points[i + 1].place);
    if (std::min({(b - a).norm(), (c - b).norm(), (c - a).norm()}) <= kShortest * length) continue;
    const double curvature = menger_curvature(a, b, c);
    trials.rows[points[i].row].set("curvature", curvature);
    if (curvature <= largest) continue;
    largest = curvature;
    trials.found = true;
    trials.value = points[i].value;
    trials.low = points[i - 1].value;
    trials.high = points[i + 1].value;
  }
  return trials;
}

}  // namespace variform
