// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/cholmod_backend.h"

namespace variform {

LinearBackendEntry describe_cholmod_simplicial() {
  LinearBackendEntry entry = describe_cholmod(CholmodMethod::simplicial);
  entry.doc = "CHOLMOD's LDL', column by column";
  entry.licence = "LGPL-2.1-or-later";
  return entry;
}

}  // namespace variform
