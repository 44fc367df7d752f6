// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/cholmod_backend.h"

namespace variform {

LinearBackendEntry describe_cholmod_supernodal() {
  LinearBackendEntry entry = describe_cholmod(CholmodMethod::supernodal);
  entry.doc = "CHOLMOD's LL' of dense blocks by BLAS: for large factors and many right-hand sides";
  entry.licence = "GPL-2.0-or-later";
  return entry;
}

}  // namespace variform
