// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "framework/base/types.h"

namespace variform {

/// A point or vector of the plane or of space: 2 or 3 numbers, on the stack.
using SpacePoint = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 3, 1>;

/// From `start` to `end`, in units of the time of an integration.
struct TimeInterval {
  double start = 0.0;
  double end = 1.0;

  double length() const { return end - start; }
};

/// Throws UsageError unless both ends are finite and the start is before the end.
void require_interval(const TimeInterval& time);

/// A guidance curve c(t) at one time.
struct CurvePoint {
  SpacePoint position;
  SpacePoint velocity;      ///< c'
  SpacePoint acceleration;  ///< c''
};

/// A guidance curve c(t) in the plane or in space, at least C^2 over its time interval (Martinez Esturo 2013, sec.
/// 3.5.1; methods: continuous deformation, 3.4).
class GuidanceCurve {
 public:
  virtual ~GuidanceCurve() = default;

  int dimension() const { return dimension_; }
  const TimeInterval& time() const { return time_; }

  /// Position and derivatives by time, in closed form. Times outside the interval count as its nearest end.
  CurvePoint at(double t) const;

  /// Times inside the interval, ascending, at which c is C^2 but not smooth.
  std::vector<double> knots() const;

 protected:
  GuidanceCurve(int dimension, const TimeInterval& time);

  /// The same by the share s in [0, 1] of the interval that is over.
  virtual CurvePoint at_share(double s) const = 0;
  virtual std::vector<double> knot_shares() const { return {}; }

 private:
  int dimension_;
  TimeInterval time_;
};

// All of these take points as rows of 2 or 3 numbers and throw UsageError naming the point that is not finite, that
// coincides with the one before where two must differ, or how many are missing; and for intervals that are none.

/// From the first to the second point with constant speed.
std::unique_ptr<GuidanceCurve> make_line(const Matrix& ends, const TimeInterval& time);

/// Circular arc from a point about a centre with constant speed, by `angle` (radians, counter-clockwise in the plane,
/// about `axis` in space, where the arc lies in the plane across the axis). In the plane the axis is empty. Throws
/// UsageError where the point lies on the axis.
std::unique_ptr<GuidanceCurve> make_arc(const SpacePoint& from, const SpacePoint& centre, double angle,
                                        const SpacePoint& axis, const TimeInterval& time);

/// sum_k a_k s^k, s from 0 to 1 over the interval; row k holds a_k, at least two rows.
std::unique_ptr<GuidanceCurve> make_polynomial(const Matrix& coefficients, const TimeInterval& time);

/// The parabola through three points at the start, the middle and the end of the interval.
std::unique_ptr<GuidanceCurve> make_parabola(const Matrix& points, const TimeInterval& time);

/// Cubic C^2 spline through two or more points, the steps between its knots proportional to the square root of the
/// distance of the points (centripetal), with natural ends: the second derivatives there are 0.
std::unique_ptr<GuidanceCurve> make_spline(const Matrix& points, const TimeInterval& time);

}  // namespace variform
