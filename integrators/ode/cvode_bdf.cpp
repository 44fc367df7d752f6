// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/cvode_backend.h"

namespace variform {

OdeBackendEntry describe_cvode_bdf() { return cvode_entry(CvodeMethod::bdf); }

}  // namespace variform
