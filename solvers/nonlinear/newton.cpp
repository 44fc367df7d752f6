// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/line_search.h"
#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Newton's method with the Hessian of every cell made positive semi-definite (Teran et al. 2005; line search that stays
// on this side of the barrier: Smith and Schaefer 2015, sec. 3.3). Quadratic convergence at beta = 0, to minima where
// no cell has a negative curvature; for beta > 0 the variation of the residual has a Gauss-Newton model.
class Newton final : public LineSearchBackend {
 public:
  explicit Newton(const Parameters& p) : LineSearchBackend("newton", p) {}

 protected:
  Direction direction(Objective& objective, const Matrix& U, double damping) override {
    return objective.newton(U, damping);
  }
};

}  // namespace

NonlinearBackendEntry describe_newton() {
  return {.name = "newton",
          .doc =
              "minimizes the regularized energy itself: Hessian made semi-definite cell by cell, line search that "
              "keeps barriers, a factorization per iteration",
          .parameters = LineSearchBackend::parameters(),
          .make = [](const Parameters& p) { return std::make_unique<Newton>(p); }};
}

}  // namespace variform
