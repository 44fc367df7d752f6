// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nonlinear_backends.h"

#include <fmt/format.h>

#include "framework/base/error.h"

// One line per backend; solvers/nonlinear/<name>.cpp defines NonlinearBackendEntry describe_<name>().
#define VARIFORM_NONLINEAR_BACKENDS(X) \
  X(local_global)                      \
  X(gauss_newton)                      \
  X(newton)                            \
  X(coupled)                           \
  X(ceres_trust_region)                \
  X(ceres_line_search)                 \
  X(nlopt_lbfgs)                       \
  X(nlopt_mma)                         \
  X(nlopt_slsqp)

namespace variform {

#define VARIFORM_DECLARE(name) NonlinearBackendEntry describe_##name();
VARIFORM_NONLINEAR_BACKENDS(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

namespace {

/// A backend without a factory is one that was not compiled in; its factory says which package brings it.
NonlinearBackendEntry completed(NonlinearBackendEntry entry) {
  entry.available = static_cast<bool>(entry.make);
  if (!entry.available) {
    entry.make = [name = entry.name, package = entry.package,
                  option = entry.option](const Parameters&) -> std::unique_ptr<NonlinearBackend> {
      throw UsageError(fmt::format("nonlinear backend '{}' is not compiled in; install {} and configure with {}=ON",
                                   name, package, option));
    };
  }
  return entry;
}

}  // namespace

const Registry<NonlinearBackendEntry>& nonlinear_backends() {
#define VARIFORM_CALL(name) completed(describe_##name()),
  static const Registry<NonlinearBackendEntry> registry("nonlinear backend",
                                                        {VARIFORM_NONLINEAR_BACKENDS(VARIFORM_CALL)});
#undef VARIFORM_CALL
  return registry;
}

std::unique_ptr<NonlinearBackend> make_nonlinear_backend(const std::string& name) {
  const NonlinearBackendEntry& entry = nonlinear_backends().find(name);
  return entry.make(Parameters(entry.parameters));
}

std::unique_ptr<NonlinearBackend> make_nonlinear_backend(const std::string& name, const Parameters& parameters) {
  return nonlinear_backends().find(name).make(parameters);
}

}  // namespace variform
