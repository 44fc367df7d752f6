// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/types.h"

namespace variform {

/// A point or vector of the plane or of space: 2 or 3 numbers, on the stack.
using SpacePoint = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 3, 1>;

/// How a region of a shape moves: a velocity at every point and time (Martinez Esturo 2013, sec. 3.5.1; methods:
/// continuous deformation, 3.4).
class Motion {
 public:
  virtual ~Motion() = default;

  /// Velocity at time t of what is at x.
  virtual SpacePoint velocity(double t, const SpacePoint& x) const = 0;

  /// Whether position() is known; else the region goes where its integrated velocity takes it.
  virtual bool closed_form() const = 0;
  /// Where a point that was at x0 at the start time t0 is at time t: the trajectory whose velocity is velocity().
  virtual SpacePoint position(double t0, const SpacePoint& x0, double t) const = 0;

  /// Times in (t0, t1), ascending, at which the velocity is not smooth.
  virtual std::vector<double> breaks(double t0, double t1) const = 0;
};

/// A constrained region: vertices of a domain, ascending, and what they do.
struct Handle {
  std::string name = {};  ///< for messages: "handle 2 (tip)"
  std::vector<Index> vertices = {};
  std::shared_ptr<const Motion> motion;  ///< null: fixed
  /// Components that are held; the others are free (rollers). All by default.
  std::array<bool, 3> held = {true, true, true};
};

}  // namespace variform
