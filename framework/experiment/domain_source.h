// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "framework/base/registry.h"
#include "framework/domain/domain.h"
#include "framework/experiment/config.h"

namespace variform {

/// How a mesh generator is known to configs ([domain] generator = "...") and to `variform list`.
struct GeneratorEntry {
  std::string name = {};
  std::string doc = {};
  std::vector<Parameter> parameters = {};
  std::function<Mesh(const Parameters&)> make = {};
};

/// All generators.
const Registry<GeneratorEntry>& generators();

/// A domain as [domain] describes it:
///
///   [domain]
///   generator = "strip"          # with its parameters beside it
///   # or
///   mesh = "file.obj"            # looked up as find_input does
///   triangulate = false          # split polygons
///   repair = ["orientation", "unreferenced_vertices", "degenerate_cells", "duplicate_cells"]  # default: the first two
///   scale = 1.0                  # multiplies all coordinates
///   [domain.degrade]             # a badly tessellated variant (planar): jitter, flip_fraction, refinements, seed
struct LoadedDomain {
  Domain domain;
  std::vector<std::string> warnings;  ///< what reading and repairing changed
};

/// Throws UsageError for a [domain] that makes no sense whatever is in its mesh file.
void check_domain(const ConfigNode& node);

/// Throws UsageError for configs that make no sense and DataError, with the file's name, for broken meshes.
LoadedDomain load_domain(const ConfigNode& node, const std::filesystem::path& config_folder);

}  // namespace variform
