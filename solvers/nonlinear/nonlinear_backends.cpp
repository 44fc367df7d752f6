// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nonlinear_backends.h"

// One line per backend; solvers/nonlinear/<name>.cpp defines NonlinearBackendEntry describe_<name>().
#define VARIFORM_NONLINEAR_BACKENDS(X) \
  X(local_global)                      \
  X(gauss_newton)                      \
  X(newton)                            \
  X(coupled)

namespace variform {

#define VARIFORM_DECLARE(name) NonlinearBackendEntry describe_##name();
VARIFORM_NONLINEAR_BACKENDS(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

const Registry<NonlinearBackendEntry>& nonlinear_backends() {
#define VARIFORM_CALL(name) describe_##name(),
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
