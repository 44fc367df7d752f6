// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/base/parameters.h"
#include "framework/solver/nonlinear_backend.h"

namespace variform {

/// Descent along the directions of a quadratic model, with backtracking on the true objective (Armijo's rule) and no
/// step across a barrier: the objective decreases in every iteration. One numeric factorization per iteration on a
/// fixed pattern. The damping keeps directions apart that the model does not see; it grows after a failed line search
/// and shrinks again.
class LineSearchBackend : public NonlinearBackend {
 public:
  /// Parameters of such a backend.
  static std::vector<Parameter> parameters();

 protected:
  LineSearchBackend(std::string name, const Parameters& p);

  /// Minimizer of the damped model at U.
  virtual Direction direction(Objective& objective, const Matrix& U, double damping) = 0;

  void start() override { damping_ = least_; }
  bool minimizes_objective() const override { return true; }
  Matrix step(Objective& objective, const Matrix& U) override;

 private:
  double least_;
  double rate_;
  double damping_ = 0.0;
};

}  // namespace variform
