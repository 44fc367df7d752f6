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

/// Throws UsageError at `type`, the energy's name in the config, for energies that have no material.
void check_has_material(const ConfigNode& type, const Energy& energy);

/// Puts a material and, if `gradient`, chapter 3's smoothness into an energy of velocity fields. Returns what carries
/// its tensors along with the shape, to be called with the positions (|V| x p) before the energy is declared on them;
/// empty without tensors. Throws UsageError naming the place for energies that have no material.
std::function<void(const Matrix&)> apply_material(const ConfigNode& node, const Material& material,
                                                  const Domain& domain, bool gradient, std::unique_ptr<Energy>& energy);

/// beta of an energy with chapter 3's smoothness for alpha in the scaling (sin phi, cos phi) of its weights: their
/// ratio is what matters to the energy itself, but alpha weighs their square.
double smoothing_beta(const Energy& energy, const Domain& domain, double alpha);

}  // namespace variform
