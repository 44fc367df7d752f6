// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/iteration_callback.h>

#include <exception>

namespace variform {

/// What Ceres asks after each of its iterations whether to go on. Nothing is thrown through Ceres: what goes_on()
/// throws ends it and is thrown again by rethrow().
class CeresCallback : public ceres::IterationCallback {
 protected:
  virtual bool goes_on(const ceres::IterationSummary& summary) = 0;

  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

  std::exception_ptr error_;  ///< of other code called by Ceres, too

 private:
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) final {
    if (error_) return ceres::SOLVER_ABORT;
    if (summary.iteration == 0) return ceres::SOLVER_CONTINUE;
    try {
      return goes_on(summary) ? ceres::SOLVER_CONTINUE : ceres::SOLVER_TERMINATE_SUCCESSFULLY;
    } catch (...) {
      error_ = std::current_exception();
      return ceres::SOLVER_ABORT;
    }
  }
};

}  // namespace variform
