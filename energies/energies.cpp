// SPDX-License-Identifier: BSD-3-Clause
#include "energies/energies.h"

// One line per energy; energies/<family>/<name>.cpp defines EnergyEntry describe_<name>().
#define VARIFORM_ENERGIES(X)             \
  X(asap)                                \
  X(larap)                               \
  X(arap)                                \
  X(symmetric_dirichlet)                 \
  X(lscm)                                \
  X(arap_parametrization)                \
  X(symmetric_dirichlet_parametrization) \
  X(akvf)                                \
  X(metr)                                \
  X(conf)                                \
  X(auth)                                \
  X(phi)                                 \
  X(near_isometric)                      \
  X(edge_lengths)                        \
  X(laplacian)                           \
  X(bilaplacian)                         \
  X(poisson)                             \
  X(gradient_editing)

namespace variform {

#define VARIFORM_DECLARE(name) EnergyEntry describe_##name();
VARIFORM_ENERGIES(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

const Registry<EnergyEntry>& energies() {
#define VARIFORM_CALL(name) describe_##name(),
  static const Registry<EnergyEntry> registry("energy", {VARIFORM_ENERGIES(VARIFORM_CALL)});
#undef VARIFORM_CALL
  return registry;
}

}  // namespace variform
