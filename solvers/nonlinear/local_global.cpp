// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>

#include <algorithm>
#include <cstdint>
#include <deque>

#include "solvers/nonlinear/nonlinear_backends.h"

namespace variform {
namespace {

// Alternation of targets and a global solve, as published (Martinez Esturo 2013, sec. 7.4.2). For beta = 0 the energy
// decreases in every iteration. For beta > 0 it need not: the local step minimizes in the unregularized norm, the
// global one in W_n, and the fixed point is close to, but not at, the minimizer of the regularized energy. The stopping
// rule is therefore on the step, never on the energy.
//
// Anderson acceleration (Peng et al. 2018, Anderson acceleration for geometry optimization and physics simulation, sec.
// 3): with the map G of the alternation and f = G(U) - U, the next state is the affine combination of the last images
// G(U_k) whose combined f is smallest. It is taken only where it leads forward: to no higher energy where plain steps
// never raise it (beta = 0), to no larger |f| elsewhere, for which one solve is spent, that of the next iteration. Else
// the plain step is taken and the window emptied. The stopping rule asks for a small f, too.
class LocalGlobal final : public NonlinearBackend {
 public:
  explicit LocalGlobal(int window) : NonlinearBackend("local_global"), window_(window) {}

 protected:
  void start() override {
    images_.clear();
    changes_.clear();
    ahead_.resize(0, 0);
  }

  Matrix step(Objective& objective, const Matrix& U) override {
    if (window_ == 0) return objective.local_global_step(U);
    Matrix image = ahead_.size() > 0 ? std::move(ahead_) : objective.local_global_step(U);
    ahead_.resize(0, 0);
    if (!image.allFinite()) return image;  // run() says so
    const Matrix change = image - U;
    part_of(change.cwiseAbs().maxCoeff());
    images_.push_front(image);
    changes_.push_front(change);
    if (static_cast<int>(images_.size()) > window_ + 1) {
      images_.pop_back();
      changes_.pop_back();
    }
    if (images_.size() < 2) return image;
    Matrix next = combined();
    if (next.allFinite() && improves(objective, next, change)) return next;
    images_.resize(1);
    changes_.resize(1);
    return image;
  }

 private:
  // G_0 - sum_j theta_j (G_j-1 - G_j) with theta that minimizes the same of f; 0 is the latest.
  Matrix combined() const {
    const auto size = changes_.front().size();
    const auto flat = [size](const Matrix& M) { return Eigen::Map<const Eigen::VectorXd>(M.data(), size); };
    const auto count = static_cast<Eigen::Index>(changes_.size()) - 1;
    Eigen::MatrixXd differences(size, count);
    for (Eigen::Index j = 0; j < count; ++j) differences.col(j) = flat(changes_[j]) - flat(changes_[j + 1]);
    const Eigen::VectorXd theta = differences.colPivHouseholderQr().solve(flat(changes_.front()));
    Matrix next = images_.front();
    for (Eigen::Index j = 0; j < count; ++j) next -= theta[j] * (images_[j] - images_[j + 1]);
    return next;
  }

  bool improves(Objective& objective, const Matrix& next, const Matrix& change) {
    if (objective.alternation_descends()) return objective.value(next).objective() <= last().energy.objective();
    Matrix image = objective.local_global_step(next);
    if (!((image - next).norm() <= change.norm())) return false;
    ahead_ = std::move(image);
    return true;
  }

  int window_;
  std::deque<Matrix> images_;   // G(U_k), the latest first
  std::deque<Matrix> changes_;  // G(U_k) - U_k
  Matrix ahead_;                // G of the state that the last step returned, where it is known
};

}  // namespace

NonlinearBackendEntry describe_local_global() {
  return {.name = "local_global",
          .doc = "alternates closest targets and a global solve, one factorization (Martinez Esturo 2013, sec. 7.4.2)",
          .parameters = {{.name = "anderson",
                          .value = std::int64_t{0},
                          .doc = "window of the Anderson acceleration (Peng et al. 2018), about 5; 0: none",
                          .min = 0.0,
                          .max = 50.0}},
          .make = [](const Parameters& p) {
            return std::make_unique<LocalGlobal>(static_cast<int>(p.integer("anderson")));
          }};
}

}  // namespace variform
