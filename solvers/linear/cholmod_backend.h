// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "solvers/linear/linear_backends.h"

namespace variform {

enum class CholmodMethod {
  simplicial,  ///< LDL', column by column
  supernodal,  ///< LL' of dense blocks, by BLAS
};

/// What the CHOLMOD backends have in common: one of them, named "cholmod.<method>".
LinearBackendEntry describe_cholmod(CholmodMethod method);

}  // namespace variform
