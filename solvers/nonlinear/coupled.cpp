// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Local/global alternation whose local step minimizes in W_n as well, cell after cell (methods: smoothed energies, sec.
// 4.4). E(U, c) decreases in every half step for every beta, exactly: a check of the norm. A diagnostic: slow, and its
// local minima can be poor. The energies of its history are E(U, c) at the targets that the alternation carries.
class Coupled final : public NonlinearBackend {
 public:
  Coupled() : NonlinearBackend("coupled") {}

 protected:
  void start() override { begun_ = false; }
  Matrix step(Objective& objective, const Matrix& U) override { return objective.coupled_step(U); }
  EnergyValue value(Objective& objective, const Matrix& U) override {
    if (!begun_) return begun_ = true, objective.value(U);
    return objective.value_at_targets(U);
  }

 private:
  bool begun_ = false;
};

}  // namespace

NonlinearBackendEntry describe_coupled() {
  return {.name = "coupled",
          .doc = "alternation that is monotone in the regularized energy of states and targets; a diagnostic",
          .make = [](const Parameters&) { return std::make_unique<Coupled>(); }};
}

}  // namespace variform
