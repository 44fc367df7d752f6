// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "energies/vector_field/vector_field.h"
#include "framework/domain/domain.h"
#include "framework/experiment/config.h"

namespace variform {

/// Material of a shape for the energies of velocity fields, as the [[material]] tables describe it; later ones replace
/// what earlier ones say about a cell:
///
///   [[material]]
///   region = [x0, y0, x1, y1]   # box around centroids of cells at rest; default: all cells
///   phi = 1.57                  # in place of the energy's (type = "phi"), or
///   phi = [0.46, 2.67]          # linear between the smallest and the largest coordinate
///   along = "x"                 # in this direction
///   direction = [1.0, 1.0]      # t: tensor I + (stiffness - 1) t t' / |t|^2, carried along with the shape
///   stiffness = 10.0
struct Material {
  Vector phi = {};      ///< of each cell; empty: the energy's own
  Matrix tensors = {};  ///< cells x p^2 at rest; empty: isotropic
};

/// Throws UsageError for tables that make no sense on any mesh.
void check_materials(const std::vector<ConfigNode>& nodes);
/// Throws UsageError with the place for tables that do not fit the mesh.
Material load_material(const std::vector<ConfigNode>& nodes, const Domain& domain);

}  // namespace variform
