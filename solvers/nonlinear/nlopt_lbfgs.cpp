// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nlopt_backend.h"

namespace variform {

NonlinearBackendEntry describe_nlopt_lbfgs() { return nlopt_entry(NloptAlgorithm::lbfgs); }

}  // namespace variform
