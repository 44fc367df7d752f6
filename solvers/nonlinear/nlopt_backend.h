// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {

enum class NloptAlgorithm { lbfgs, mma, slsqp };

/// What the entries of all algorithms share: package, licence, and how they are made where NLopt is compiled in.
NonlinearBackendEntry nlopt_entry(NloptAlgorithm algorithm);

}  // namespace variform
