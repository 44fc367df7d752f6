// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/domain_source.h"
#include "framework/form/constraints.h"

namespace variform {

/// What the values of constraints are, in a kind of study.
struct ConstraintSpace {
  /// |V| x d: what each vertex is held at where a constraint says no more. Empty: rest positions.
  Matrix state = {};
  /// Values are velocities at the rest positions, 0 where a constraint says no more; `velocity` takes the place of
  /// `positions` and `move`.
  bool velocities = false;
};

/// Constraints as the [[constraint]] tables describe them:
///
///   [[constraint]]
///   kind = "hard"                      # hard, soft, identify, linear
///   vertices = [0, 1, 2]               # by index, or
///   select = { box = [x0, y0, x1, y1] }  # also: near = [x, y] (one vertex), points = [[x, y], ...] (the nearest of
///                                      # each), circle = [x, y, radius], boundary = true; coordinates x, y, z in space
///   relative = false                   # coordinates of select and move in units of the bounding box: see below
///   positions = [[x, y], ...]          # one per vertex, or
///   move = [dx, dy]                    # relative to where the vertex is, or
///   move = { translate = [dx, dy], rotate = degrees, axis = [x, y, z], about = [x, y], scale = 1.0 }
///   velocity = [vx, vy]                # in studies of velocities, or
///   velocity = { translate = [vx, vy], rotate = degrees, axis = [x, y, z], about = [x, y], scale = rate }
///   weight = 0.0                       # soft only; 0: the default weight
///   weights = [w0, w1, ...]            # linear only, with value = [x, y] (a velocity in studies of velocities)
///
/// Without positions and move the vertices stay where they are. With relative = true a point (a, b) means the lower
/// left corner of the bounding box plus (a width, b height), and lengths and translations are in units of its longest
/// side. A velocity is the field translate + rotate * axis x (x - about) + scale (x - about), the angle in degrees per
/// unit of time; axis is for space only. Where states have another dimension than the mesh (maps of surfaces to the
/// plane), points in `select` may have either: of the mesh, or of the state.
struct LoadedConstraints {
  Constraints constraints;
  std::vector<Index> fixed;  ///< hard, staying where they are; these lists number vertices as the domain does
  std::vector<Index> moved;  ///< hard, elsewhere
  std::vector<Index> soft;
};

/// Throws UsageError for tables that make no sense on any mesh.
void check_constraints(const std::vector<ConfigNode>& nodes, bool velocities = false);

/// nodes: the array of constraint tables. Throws UsageError with the place for tables that make no sense, DataError
/// with the place for constraints that do not fit the mesh.
LoadedConstraints load_constraints(const std::vector<ConfigNode>& nodes, const LoadedDomain& source,
                                   const ConstraintSpace& space = {});

}  // namespace variform
