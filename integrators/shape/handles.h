// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/domain.h"
#include "integrators/shape/curve.h"

namespace variform {

/// How a region of a shape moves: a velocity at every point and time (Martinez Esturo 2013, sec. 3.5.1; methods:
/// continuous deformation, 3.4). All motions here are affine fields v = A(t) x + b(t) that stand still outside an
/// interval of time. At the two ends of that interval, and at every other jump, velocity() is the value on the moving
/// side, of a sequence that of the later part: where one side of a break is meant, ask next to it.
class Motion {
 public:
  virtual ~Motion() = default;

  /// 2 or 3: of the points that it moves.
  virtual int dimension() const = 0;

  /// Velocity at time t of what is at x.
  virtual SpacePoint velocity(double t, const SpacePoint& x) const = 0;
  /// Whether velocity() depends on x: false where all points move in parallel.
  virtual bool depends_on_place() const = 0;

  /// Whether position() is known; else the region goes where its integrated velocity takes it.
  virtual bool closed_form() const = 0;
  /// Where a point that was at x0 at the start time t0 is at time t (before or after): the trajectory whose velocity is
  /// velocity(). Throws UsageError where there is no closed form.
  virtual SpacePoint position(double t0, const SpacePoint& x0, double t) const = 0;

  /// Times in (t0, t1), ascending, at which the velocity is not smooth.
  virtual std::vector<double> breaks(double t0, double t1) const = 0;

  /// When it moves.
  virtual TimeInterval time() const = 0;
};

using MotionPointer = std::shared_ptr<const Motion>;

// Factories throw UsageError for values that are not finite, dimensions that do not match and intervals that are none.

/// All points move as the curve does: v = c'. Position x0 + c(t) - c(t0).
MotionPointer follow(std::shared_ptr<const GuidanceCurve> curve);

/// The region also turns with the tangent of the curve: v = c' + w x (x - c), w = c' x c'' / |c'|^2, a rotation about
/// the centre of curvature that goes over into a translation where the curve is straight. The rotation is that of a
/// rotation-minimizing frame. Position c(t) + R(t, t0) (x0 - c(t0)), R from the angle between the tangents in the
/// plane; in space it carries tangent to tangent, and the angle about the tangent, the area between the tangents and an
/// arc on the sphere, is an integral by Gauss's rule, to about 1e-13. Throws UsageError naming the time where c'
/// vanishes or turns back: there is no tangent to follow.
MotionPointer follow_oriented(std::shared_ptr<const GuidanceCurve> curve);

/// Constant velocity.
MotionPointer translate(const SpacePoint& velocity, const TimeInterval& time);

/// Constant angular speed (radians per unit of time) about a centre in the plane, counter-clockwise, or an axis through
/// it in space. In the plane the axis is empty.
MotionPointer rotate(const SpacePoint& centre, const SpacePoint& axis, double speed, const TimeInterval& time);

/// As at the end of a rod from `base` to `tip` that is bent into an arc of constant length, by an angle that grows from
/// 0 to `angle` (radians) with constant speed: the tip goes where the rod's end goes and the region turns with it. The
/// way of the end of a sheet that is rolled up without stretch. In space `axis` is that of the turn, across the rod.
MotionPointer bend(const SpacePoint& base, const SpacePoint& tip, const SpacePoint& axis, double angle,
                   const TimeInterval& time);

/// v = A x + b. Position by the matrix exponential.
MotionPointer linear_field(const Eigen::MatrixXd& A, const SpacePoint& b, const TimeInterval& time);

/// v = sum_k s^k (A[k] x + b[k]), s = t - time.start, for lists of any length, the shorter one continued by zeros; not
/// both empty. No closed form unless both have at most one element.
MotionPointer polynomial_field(const std::vector<Eigen::MatrixXd>& A, const std::vector<SpacePoint>& b,
                               const TimeInterval& time);

/// The same motion run backwards over another interval: what moved there is taken back, in the time that there is.
MotionPointer reversed(MotionPointer motion, const TimeInterval& time);

/// One motion after the other; their intervals ascend and do not overlap. Position is the composition.
MotionPointer in_sequence(std::vector<MotionPointer> motions);

/// A weight at a time.
struct WeightKnot {
  double time;
  double weight;
};

/// The motion in a time of its own: v(t, x) = w(t) v0(tau(t), x), tau(t) = t_0 + integral of w from t_0 on, w piecewise
/// linear between knots (t_k, w_k), ascending, w_k >= 0, and constant before the first and after the last one. The same
/// way, at another speed; where the integral is too small the way is not gone to its end.
MotionPointer weighted(MotionPointer motion, std::vector<WeightKnot> knots);

/// Where a motion takes x0 from time t0 to t: position() where it is known, else integrated to about 1e-12.
SpacePoint flow(const Motion& motion, double t0, const SpacePoint& x0, double t);

/// A constrained region: vertices of a domain, ascending, and what they do.
struct Handle {
  std::string name = {};  ///< for messages: "handle 2 (tip)"
  std::vector<Index> vertices = {};
  MotionPointer motion = {};  ///< null: fixed
  /// Components that are held; the others are free (rollers). All by default.
  std::array<bool, 3> held = {true, true, true};

  /// Velocity at time t of its vertex at x; components that are not held mean nothing.
  SpacePoint velocity(double t, const SpacePoint& x) const;
  /// Whether the held components go where the motion says: not where others are free and their velocity depends on
  /// those.
  bool has_path(int dimension) const;
  /// Whether that path is known in closed form.
  bool closed_form(int dimension) const;
};

/// Throws DataError naming the handles for regions that are empty, vertices that do not exist, motions of another
/// dimension, handles that hold nothing, and vertices that two handles hold in the same component by different motions.
/// One motion may have several handles, and fixed vertices may be fixed twice.
void check_handles(const std::vector<Handle>& handles, const Domain& domain);

/// Times in (t0, t1), ascending, at which the velocity of any handle is not smooth.
std::vector<double> breaks_of(const std::vector<Handle>& handles, double t0, double t1);

/// The positions at time t0 (|V| x d) with the held components of all handles where they are at time t: the constraints
/// of a method that goes there in one step. Throws UsageError naming a handle whose place depends on what is free.
Matrix handle_positions(const std::vector<Handle>& handles, const Matrix& positions, double t0, double t);

}  // namespace variform
