// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "framework/experiment/claim.h"
#include "framework/experiment/table.h"
#include "framework/experiment/trials.h"

namespace variform {

/// Runs at one value of the key and returns its metrics. Errors pass through the search.
using TrialRun = std::function<Row(double value)>;

/// Coordinate in which values are stepped and halved.
enum class Spacing {
  arithmetic,  ///< the value itself
  geometric,   ///< its logarithm (values > 0; a lower end of 0 is tried, steps go to values above it)
  odds  ///< logarithm of value / (1 - value), for values in [0, 1) such as beta, whose lambda is beta / (1 - beta)
};

/// What is searched by find_threshold: the smallest value in [low, high] at which a condition holds.
struct ThresholdSearch {
  std::string key = {};
  Condition until = {};
  double low = 0.0;   ///< tried first: if the condition holds there, it is the answer
  double high = 1.0;  ///< largest value ever tried
  /// Without: `high` is tried next and the interval halved. With: the value tried after `low`; from there the search
  /// steps up by `factor` (down, if the condition holds) in the coordinate of `spacing` until it has a bracket.
  std::optional<double> start = {};
  double factor = 4.0;
  Spacing spacing = Spacing::arithmetic;
  /// The bracket is narrow enough when high - low <= max(absolute_tolerance, relative_tolerance * high).
  double absolute_tolerance = 1e-3;
  double relative_tolerance = 0.0;
  int max_trials = 200;  ///< runs, all in all; the search ends with the bracket that it has by then
};

/// Smallest value at which a condition holds, by bracketing and bisection (as in the study of smallest weights without
/// flipped cells, Martinez Esturo 2013, sec. 7.4.1).
///
/// found: `value` = `high` fulfils the condition (it was run), `low` does not (it was run, too) and is next to it
/// within the tolerance; both are the lower end if the condition holds there. Not found: the condition holds neither at
/// low nor at the largest value tried; [low, high] is then the interval between the largest two values that were tried.
///
/// Conditions that are not monotone in the value: every trial that failed lies below every one that held, so the trials
/// themselves never show it. The answer is then the upper end of one interval in which the condition changes, not
/// necessarily the lowest one; all of the above still holds. A start near the expected answer favours changes near it.
/// A condition on a NaN does not hold.
///
/// Throws UsageError for low >= high, ends that are not finite, start outside [low, high], factor <= 1, tolerances that
/// are both zero or negative, values outside of what the spacing admits; and whatever run and Condition::holds throw.
Trials find_threshold(const ThresholdSearch& search, const TrialRun& run);

/// The search for beta that needs no bracket from the user: 0 first, then from `start` up or down by factors of four of
/// lambda = beta / (1 - beta), then halving of log lambda to the tolerance, relative to beta.
ThresholdSearch smallest_beta(const Condition& until, double start = 0.05, double relative_tolerance = 0.05,
                              double high = 0.999);

/// What is searched by l_curve: the corner of the curve of (log residual, log regularizer) over beta.
struct LCurveSearch {
  std::string key = "norm.beta";
  std::string residual = {};     ///< metric: norm of the unregularized residual, or its square (the corner is the same)
  std::string regularizer = {};  ///< metric: norm of the regularizer (for W_n: the variation of the residual), or its
                                 ///< square, if the residual is squared
  double low = 1e-3;             ///< smallest value of the grid, > 0
  double high = 0.99;            ///< largest value, < 1
  double floor = 0.0;            ///< metrics at or below are rounding: their points are left out
  int count = 13;                ///< points of the grid, equally spaced in log(beta / (1 - beta)); at least 3
};

/// Corner of the L-curve (Hansen, "Analysis of discrete ill-posed problems by means of the L-curve", SIAM Review 34,
/// 1992): runs a grid of values and takes the inner point where the polygon of (log residual, log regularizer) has the
/// largest Menger curvature, 4 times the signed area of three successive points by the product of their distances,
/// positive where the curve turns as an L does.
///
/// found: there is an inner point of positive curvature; `value` is its beta, [low, high] its neighbours on the grid.
/// Points whose metrics are not finite and above the floor are left out (held = false), as are those that lie within
/// 1e-6 of the curve's length of a neighbour, where curvature is rounding. Along growing beta the residual must not
/// fall and the regularizer must not rise (by more than 1e-9 relatively): each violation is told in `remarks`. Rows
/// that were used carry "curvature".
///
/// Throws UsageError for a grid that makes no sense and metrics that rows lack; whatever run throws.
Trials l_curve(const LCurveSearch& search, const TrialRun& run);

}  // namespace variform
