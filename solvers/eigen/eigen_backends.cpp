// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/eigen/eigen_backends.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <utility>

#include "framework/base/error.h"
#include "solvers/linear/linear_backends.h"

// Every backend, in the order in which users see them. X(name) stands for describe_name() in solvers/eigen/name.cpp.
#define VARIFORM_EIGEN_BACKENDS(X) \
  X(spectra_shift_invert)          \
  X(arpack)                        \
  X(slepc)

namespace variform {

#define VARIFORM_DECLARE(name) EigenBackendEntry describe_##name();
VARIFORM_EIGEN_BACKENDS(VARIFORM_DECLARE)
#undef VARIFORM_DECLARE

namespace {

std::vector<Parameter> parameters_of_all() {
  const EigenOptions defaults;
  const bool supernodal = linear_backends().find("cholmod.supernodal").available;
  return {
      {.name = "inner",
       .value = std::string(supernodal ? "cholmod.supernodal" : "eigen.ldlt"),
       .doc = "linear backend that solves with K - shift M",
       .choices = linear_backends().names()},
      {.name = "tolerance",
       .value = defaults.tolerance,
       .doc = "relative accuracy of 1 / (lambda - shift) to stop at",
       .min = 1e-15,
       .max = 1.0},
      {.name = "max_iterations",
       .value = std::int64_t{defaults.max_iterations},
       .doc = "restarts",
       .min = 1.0,
       .max = 1e9},
      {.name = "subspace",
       .value = std::int64_t{defaults.subspace},
       .doc = "vectors kept; 0: max(2 k + 1, 20)",
       .min = 0.0,
       .max = 1e6},
      {.name = "shift",
       .value = std::numeric_limits<double>::infinity(),
       .doc = "below all eigenvalues; inf: slightly below 0, relative to the scale of K and M"},
  };
}

EigenBackendEntry completed(EigenBackendEntry entry) {
  entry.parameters = parameters_of_all();
  entry.available = static_cast<bool>(entry.make);
  if (!entry.available) {
    entry.make = [name = entry.name, package = entry.package,
                  option = entry.option](std::unique_ptr<LinearBackend>) -> std::unique_ptr<EigenBackend> {
      throw UsageError(fmt::format("eigen backend '{}' is not compiled in; install {} and configure with {}=ON", name,
                                   package, option));
    };
  }
  return entry;
}

}  // namespace

const Registry<EigenBackendEntry>& eigen_backends() {
#define VARIFORM_ENTRY(name) completed(describe_##name()),
  static const Registry<EigenBackendEntry> registry("eigen backend", {VARIFORM_EIGEN_BACKENDS(VARIFORM_ENTRY)});
#undef VARIFORM_ENTRY
  return registry;
}

std::unique_ptr<EigenBackend> make_eigen_backend(const std::string& name) {
  return make_eigen_backend(name, Parameters(eigen_backends().find(name).parameters));
}

std::unique_ptr<EigenBackend> make_eigen_backend(const std::string& name, const Parameters& parameters) {
  return make_eigen_backend(name, parameters, make_linear_backend(parameters.string("inner")));
}

std::unique_ptr<EigenBackend> make_eigen_backend(const std::string& name, const Parameters& parameters,
                                                 std::unique_ptr<LinearBackend> inner) {
  std::unique_ptr<EigenBackend> backend = eigen_backends().find(name).make(std::move(inner));
  backend->options.tolerance = parameters.number("tolerance");
  backend->options.max_iterations = static_cast<int>(parameters.integer("max_iterations"));
  backend->options.subspace = static_cast<Index>(parameters.integer("subspace"));
  if (const double shift = parameters.number("shift"); std::isfinite(shift)) backend->options.shift = shift;
  return backend;
}

}  // namespace variform
