// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "integrators/ode/ode_backends.h"

namespace variform {

enum class CvodeMethod { adams, bdf };

/// A method of CVODE.
OdeBackendEntry cvode_entry(CvodeMethod method);

}  // namespace variform
