// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/experiment/config.h"
#include "framework/experiment/domain_source.h"
#include "integrators/shape/handles.h"

namespace variform {

/// Handles as the [[handle]] tables describe them:
///
///   [[handle]]
///   name = "tip"                         # for messages; optional
///   select = { box = [...] }             # or vertices = [...]; as in [[constraint]]
///   relative = false                     # coordinates in units of the bounding box, as in [[constraint]]
///   time = [0.0, 1.0]                    # when it moves; default: all the time that is integrated
///   held = ["x", "y", "z"]               # components that are held; default: all
///   weight = [[0.0, 0.0], [1.0, 2.0]]    # [time, weight >= 0]: speed, linear in between; see weighted()
///   # and one of
///   fixed = true
///   path = { spline = [[x, y], ...], orient = false }       # or line = [p, q], parabola = [p, q, r],
///                                        # polynomial = [a0, a1, ...], circle = { degrees, centre, axis, from }
///   velocity = [vx, vy]
///   rotate = { degrees = 135, axis = [x, y, z], about = [x, y, z] }       # degrees over `time`
///   bend = { degrees = 90, from = [x, y], to = [x, y], axis = [x, y, z] } # the end of a rod of constant length
///   linear = { A = [[a, b], [c, d]], b = [x, y], about = [x, y] }         # v = A (x - about) + b; lists of A, b are
///                                        # coefficients of the powers of (t - start)
///   segments = [{ time = [0.0, 0.5], path = ... }, { time = [0.5, 1.0], back = true }]
///                                        # one after the other; back: takes the one before back
///
/// Curves start where they say; the region keeps its distance from them. `from` of a circle, `about` of a rotation and
/// `to` of a bend are the mean of the region's vertices where they are not given; `about` of a linear field is the
/// origin.

/// Throws UsageError, with the place and the handle's name, for tables that make no sense on any mesh.
void check_handle_tables(const std::vector<ConfigNode>& nodes);

/// nodes: the array of handle tables. time: the interval that is integrated. Throws UsageError with place and name for
/// tables that make no sense, DataError with place and name for handles that do not fit the mesh or each other.
std::vector<Handle> load_handles(const std::vector<ConfigNode>& nodes, const LoadedDomain& source,
                                 const TimeInterval& time = {});

}  // namespace variform
