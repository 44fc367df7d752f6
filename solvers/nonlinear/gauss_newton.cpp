// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/line_search.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Gauss-Newton on the true regularized energy (methods: smoothed energies, sec. 4.3), whatever beta is.
class GaussNewton final : public LineSearchBackend {
 public:
  explicit GaussNewton(const Parameters& p) : LineSearchBackend("gauss_newton", p) {}

 protected:
  Direction direction(Objective& objective, const Matrix& U, double damping) override {
    return objective.gauss_newton(U, damping);
  }
};

}  // namespace

NonlinearBackendEntry describe_gauss_newton() {
  return {
      .name = "gauss_newton",
      .doc = "minimizes the regularized energy itself: linearized residual, line search, a factorization per iteration",
      .parameters = LineSearchBackend::parameters(),
      .make = [](const Parameters& p) { return std::make_unique<GaussNewton>(p); }};
}

}  // namespace variform
