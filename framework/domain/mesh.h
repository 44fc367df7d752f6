// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/base/types.h"

namespace variform {

/// A simplicial mesh as a file or a generator gives it: flat arrays, nothing derived, nothing checked.
/// See Domain for the checked mesh that energies work on.
struct Mesh {
  Matrix positions;   ///< vertices x p, p = 2 (planar) or 3
  IndexMatrix cells;  ///< cells x 3 (triangles) or cells x 4 (tetrahedra), indices into the rows of positions

  Index vertex_count() const { return static_cast<Index>(positions.rows()); }
  Index cell_count() const { return static_cast<Index>(cells.rows()); }
};

/// The axis (0, 1, 2) along which a triangle mesh in space is constant, up to 1e-12 of its extent; -1 if there is none,
/// or positions have two columns already.
int flat_axis(const Mesh& mesh);

/// A mesh with a flat axis without that coordinate: (x, y), (x, z) or (y, z), positions vertices x 2. Any other mesh as
/// it is.
Mesh flattened(const Mesh& mesh);

}  // namespace variform
