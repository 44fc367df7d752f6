// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/parameters.h"
#include "framework/base/registry.h"
#include "framework/solver/ode_backend.h"

namespace variform {

/// How an ODE backend is known to configs and to `variform list`.
struct OdeBackendEntry {
  std::string name = {};
  std::string doc = {};      ///< one line
  bool available = true;     ///< compiled in; the registry clears it where describe_<name>() leaves make empty
  std::string package = {};  ///< Debian package that brings it, for the message when it is not available
  std::string option = {};   ///< CMake option that compiles it in
  std::string licence = {};  ///< in effect for what it links to, as SPDX writes it; empty: that of variform
  std::vector<Parameter> parameters = {};
  std::function<std::unique_ptr<OdeBackend>(const Parameters&)> make = {};
};

/// All ODE backends, those not compiled in among them.
const Registry<OdeBackendEntry>& ode_backends();

/// Makes a backend by name with default parameters. Throws UsageError for unknown names and for backends that are not
/// compiled in (naming the package that brings them).
std::unique_ptr<OdeBackend> make_ode_backend(const std::string& name);
/// With the parameters that its entry declares.
std::unique_ptr<OdeBackend> make_ode_backend(const std::string& name, const Parameters& parameters);

}  // namespace variform
