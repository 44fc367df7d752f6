// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

namespace variform::generators {

/// Point of a stroke: its place and half the width there.
struct Joint {
  Eigen::Vector2d place;
  double radius;
};

/// Row of capsules from joint to joint, their width changing linearly between them.
using Stroke = std::vector<Joint>;

/// Union of strokes, the corners between different strokes rounded off over about the length `blend`.
struct Silhouette {
  std::string name;
  std::vector<Stroke> strokes;
  double blend;
  bool symmetric = false;  ///< about the y axis

  /// Signed distance to the outline, negative inside: exact for a single capsule outside, nowhere more than the
  /// distance to the nearest stroke, and never changing faster than the place does.
  double distance(const Eigen::Vector2d& p) const;
  /// Half the width of the thinnest limb.
  double smallest_radius() const;
};

const std::vector<Silhouette>& silhouettes();

}  // namespace variform::generators
