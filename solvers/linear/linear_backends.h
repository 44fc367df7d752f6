// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/parameters.h"
#include "framework/base/registry.h"
#include "framework/solver/linear_backend.h"

namespace variform {

/// How a linear backend is known to configs and to `variform list`. solvers/linear/<name>.cpp defines
/// `LinearBackendEntry describe_<name>()`, which linear_backends.cpp lists.
struct LinearBackendEntry {
  std::string name = {};
  std::string doc;  ///< one line
  LinearCapabilities capabilities = {};
  bool available = true;     ///< compiled in; the registry clears it where describe_<name>() leaves make empty
  std::string package = {};  ///< Debian package that brings it, for the message when it is not available
  std::string option = {};   ///< of CMake, that switches it on
  std::string licence = {};  ///< of what it links to, as SPDX writes it
  std::vector<Parameter> parameters = {};
  std::function<std::unique_ptr<LinearBackend>(const Parameters&)> make = {};
};

/// All linear backends, those not compiled in among them.
const Registry<LinearBackendEntry>& linear_backends();

/// Makes a backend by name with default or given parameters.
/// Throws UsageError for unknown names and for backends that are not compiled in (naming the package that brings them).
std::unique_ptr<LinearBackend> make_linear_backend(const std::string& name);
std::unique_ptr<LinearBackend> make_linear_backend(const std::string& name, const Parameters& parameters);

}  // namespace variform
