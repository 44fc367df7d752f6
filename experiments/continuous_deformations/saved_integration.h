// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "framework/experiment/figure.h"
#include "framework/solver/ode_backend.h"

namespace variform {

/// All that an interrupted integration needs to go on: where the integrator was and what was put out so far.
struct SavedIntegration {
  OdeCheckpoint checkpoint = {};
  std::vector<double> times = {};  ///< of the frames so far
  std::vector<Vector> states = {};
  double turned = 0.0;            ///< accumulated angle of the handle
  std::vector<double> axis = {};  ///< of that angle
  double seconds = 0.0;           ///< that the run took before
};

/// Bytes that integration_from turns into the same numbers to the last bit.
std::string to_bytes(const SavedIntegration& saved);
/// Empty for bytes that are none of to_bytes.
std::optional<SavedIntegration> integration_from(const std::string& bytes);

}  // namespace variform
