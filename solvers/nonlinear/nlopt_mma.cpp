// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nlopt_backend.h"

namespace variform {

NonlinearBackendEntry describe_nlopt_mma() { return nlopt_entry(NloptAlgorithm::mma); }

}  // namespace variform
