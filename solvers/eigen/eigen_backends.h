// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "framework/base/parameters.h"
#include "framework/base/registry.h"
#include "framework/solver/eigen_backend.h"

namespace variform {

/// How an eigen backend is known to configs and to `variform list`. solvers/eigen/<name>.cpp defines
/// `EigenBackendEntry describe_<name>()`, which eigen_backends.cpp lists. All take the parameters of EigenOptions and
/// the name of the inner linear backend.
struct EigenBackendEntry {
  std::string name = {};
  std::string doc;           ///< one line
  bool available = true;     ///< compiled in; the registry clears it where describe_<name>() leaves make empty
  std::string package = {};  ///< Debian package that brings it, for the message when it is not available
  std::string option = {};   ///< of CMake, that switches it on
  std::string licence = {};  ///< of what it links to, as SPDX writes it
  std::vector<Parameter> parameters = {};
  std::function<std::unique_ptr<EigenBackend>(std::unique_ptr<LinearBackend> inner)> make = {};
};

/// All eigen backends, those not compiled in among them.
const Registry<EigenBackendEntry>& eigen_backends();

/// Makes a backend by name with default or given parameters, or with an inner solver of one's own.
/// Throws UsageError for unknown names and for backends that are not compiled in (naming the package that brings them).
std::unique_ptr<EigenBackend> make_eigen_backend(const std::string& name);
std::unique_ptr<EigenBackend> make_eigen_backend(const std::string& name, const Parameters& parameters);
std::unique_ptr<EigenBackend> make_eigen_backend(const std::string& name, const Parameters& parameters,
                                                 std::unique_ptr<LinearBackend> inner);

}  // namespace variform
