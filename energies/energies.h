// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/form/energy.h"

namespace variform {

/// All energies of the library, by the names that configs use.
const Registry<EnergyEntry>& energies();

}  // namespace variform
