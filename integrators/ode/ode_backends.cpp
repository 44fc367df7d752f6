// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/ode_backends.h"

#include <fmt/format.h>

#include "framework/base/error.h"

// One line per backend; integrators/ode/<name>.cpp defines OdeBackendEntry describe_<name>().
#define VARIFORM_ODE_BACKENDS(X) \
  X(euler)                       \
  X(rk4)                         \
  X(abm3)                        \
  X(odeint_dopri5)               \
  X(cvode_adams)                 \
  X(cvode_bdf)                   \
  X(arkode_erk)

namespace variform {

#define VARIFORM_DECLARE(name) OdeBackendEntry describe_##name();
VARIFORM_ODE_BACKENDS(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

namespace {

/// A backend without a factory is one that was not compiled in; its factory says which package brings it.
OdeBackendEntry completed(OdeBackendEntry entry) {
  entry.available = static_cast<bool>(entry.make);
  if (!entry.available) {
    entry.make = [name = entry.name, package = entry.package,
                  option = entry.option](const Parameters&) -> std::unique_ptr<OdeBackend> {
      throw UsageError(fmt::format("ODE backend '{}' is not compiled in; install {} and configure with {}=ON", name,
                                   package, option));
    };
  }
  return entry;
}

}  // namespace

const Registry<OdeBackendEntry>& ode_backends() {
#define VARIFORM_CALL(name) completed(describe_##name()),
  static const Registry<OdeBackendEntry> registry("ODE backend", {VARIFORM_ODE_BACKENDS(VARIFORM_CALL)});
#undef VARIFORM_CALL
  return registry;
}

std::unique_ptr<OdeBackend> make_ode_backend(const std::string& name) {
  const OdeBackendEntry& entry = ode_backends().find(name);
  return entry.make(Parameters(entry.parameters));
}

std::unique_ptr<OdeBackend> make_ode_backend(const std::string& name, const Parameters& parameters) {
  return ode_backends().find(name).make(parameters);
}

}  // namespace variform
