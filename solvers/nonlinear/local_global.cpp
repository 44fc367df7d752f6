// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Alternation of targets and a global solve, as published (Martinez Esturo 2013, sec. 7.4.2). For beta = 0 the energy
// decreases in every iteration. For beta > 0 it need not: the local step minimizes in the unregularized norm, the
// global one in W_n, and the fixed point is close to, but not at, the minimizer of the regularized energy. The stopping
// rule is therefore on the step, never on the energy.
class LocalGlobal final : public NonlinearBackend {
 public:
  LocalGlobal() : NonlinearBackend("local_global") {}

 protected:
  Matrix step(Objective& objective, const Matrix& U) override { return objective.local_global_step(U); }
};

}  // namespace

NonlinearBackendEntry describe_local_global() {
  return {.name = "local_global",
          .doc = "alternates closest targets and a global solve, one factorization (Martinez Esturo 2013, sec. 7.4.2)",
          .make = [](const Parameters&) { return std::make_unique<LocalGlobal>(); }};
}

}  // namespace variform
