// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "framework/domain/domain.h"
#include "framework/form/constraints.h"
#include "framework/solver/linear_backend.h"

namespace variform {

/// How the first tangent vector of a frame is chosen.
enum class FrameChoice {
  minimal_rotation,  ///< the frame that the smallest rotation of the cell's plane to the (x, y) plane takes to the
                     ///< axes; half a turn about the x axis where the normal is -z (Martinez Esturo 2013, ch. 7:
                     ///< parametrization)
  edge_aligned,      ///< along the first edge of the cell
  random,            ///< by a seed
};

/// Orthonormal tangent vectors (t1, t2) of every triangle of a planar or surface domain, counter-clockwise about the
/// normal: cells x 2p, in the layout of Energy::frames. Nothing should depend on the choice; tests use several.
/// Throws UsageError for tetrahedra.
Matrix tangent_frames(const Domain& domain, FrameChoice choice = FrameChoice::minimal_rotation, std::uint64_t seed = 1);

/// Pins of a free-boundary least-squares conformal map: the two boundary vertices at the largest distance (in space, of
/// all pairs), at (0, 0) and at that distance on the x axis. Throws DataError when the domain is no disk.
Constraints default_pins(const Domain& domain);

/// The convex shape that a Tutte map puts the boundary on, of the surface's area, about the origin.
enum class TutteBoundary {
  circle,  ///< by arc length
  square,  ///< the four boundary vertices nearest to the quarters of the arc length at the corners, arc length in
           ///< between; from the first boundary vertex at the lower left corner
};

enum class TutteWeights {
  uniform,     ///< every neighbour alike (Tutte 1963): needs a backend for definite systems
  mean_value,  ///< Floater 2003, closer to isometry: needs a backend for general systems
};

/// Bijective map of a disk to a convex shape, |V| x 2, all triangles positively oriented: the start of nonlinear
/// parametrizations. Interior vertices are convex combinations of their neighbours.
/// Throws DataError when the domain is no disk (closed, several boundaries, handles, several components: cut it first)
/// or cells collapse on the square, since an inner edge joins two vertices of one side; SolverError when a triangle is
/// smaller than double precision resolves.
Matrix tutte_map(const Domain& domain, TutteBoundary boundary, TutteWeights weights, LinearBackend& backend);

}  // namespace variform
