// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/linear_backends.h"

#include <fmt/format.h>

#include <utility>

#include "framework/base/error.h"

// Every backend, in the order in which users see them. X(name) stands for describe_name() in solvers/linear/name.cpp.
#define VARIFORM_LINEAR_BACKENDS(X) \
  X(auto)                           \
  X(eigen_ldlt)                     \
  X(eigen_llt)                      \
  X(eigen_cg)                       \
  X(eigen_lu)                       \
  X(eigen_qr)                       \
  X(cholmod_simplicial)             \
  X(cholmod_supernodal)             \
  X(umfpack)                        \
  X(spqr)                           \
  X(petsc)

namespace variform {

#define VARIFORM_DECLARE(name) LinearBackendEntry describe_##name();
VARIFORM_LINEAR_BACKENDS(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

namespace {

/// A backend without a factory is one that was not compiled in; its factory says which package brings it.
LinearBackendEntry completed(LinearBackendEntry entry) {
  entry.available = static_cast<bool>(entry.make);
  if (!entry.available) {
    entry.make = [name = entry.name, package = entry.package,
                  option = entry.option](const Parameters&) -> std::unique_ptr<LinearBackend> {
      throw UsageError(fmt::format("linear backend '{}' is not compiled in; install {} and configure with {}=ON", name,
                                   package, option));
    };
  }
  return entry;
}

}  // namespace

const Registry<LinearBackendEntry>& linear_backends() {
#define VARIFORM_ENTRY(name) completed(describe_##name()),
  static const Registry<LinearBackendEntry> registry("linear backend", {VARIFORM_LINEAR_BACKENDS(VARIFORM_ENTRY)});
#undef VARIFORM_ENTRY
  return registry;
}

std::unique_ptr<LinearBackend> make_linear_backend(const std::string& name) {
  return make_linear_backend(name, Parameters(linear_backends().find(name).parameters));
}

std::unique_ptr<LinearBackend> make_linear_backend(const std::string& name, const Parameters& parameters) {
  return linear_backends().find(name).make(parameters);
}

}  // namespace variform
