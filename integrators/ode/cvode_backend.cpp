// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/cvode_backend.h"

#ifdef VARIFORM_WITH_SUNDIALS
#include <cvode/cvode.h>
#include <cvode/cvode_ls.h>
#include <sunlinsol/sunlinsol_spgmr.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <cstdlib>

#include "framework/base/error.h"
#include "integrators/ode/sundials_backend.h"
#endif

namespace variform {

namespace {

constexpr int kOrderAdams = 12;
constexpr int kOrderBdf = 5;

#ifdef VARIFORM_WITH_SUNDIALS
class Cvode final : public SundialsBackend {
 public:
  Cvode(CvodeMethod method, const Parameters& parameters)
      : SundialsBackend(method == CvodeMethod::adams ? "cvode.adams" : "cvode.bdf"),
        method_(method == CvodeMethod::adams ? CV_ADAMS : CV_BDF),
        max_order_(static_cast<int>(parameters.integer("max_order"))),
        newton_(parameters.string("nonlinear") == "newton_krylov"),
        krylov_(static_cast<int>(parameters.integer("krylov"))) {}
  ~Cvode() override { release(); }
  Cvode(const Cvode&) = delete;
  Cvode& operator=(const Cvode&) = delete;

  int order() const override { return max_order_; }

 protected:
  void create(double t, N_Vector y) override {
    release();
    memory_.reset(CVodeCreate(method_, context()));
    if (memory_ == nullptr) throw SolverError("CVODE: no memory");
    void* memory = memory_.get();
    check(CVodeInit(memory, right_hand_side, t, y), "CVodeInit");
    check(CVodeSetErrHandlerFn(memory, ignore_message, nullptr), "CVodeSetErrHandlerFn");
    check(CVodeSetUserData(memory, static_cast<SundialsBackend*>(this)), "CVodeSetUserData");
    check(CVodeSStolerances(memory, 0.0, absolute_tolerance()), "CVodeSStolerances");
    check(CVodeSetMaxOrd(memory, max_order_), "CVodeSetMaxOrd");
    check(CVodeSetMinStep(memory, least_step(t)), "CVodeSetMinStep");
    check(CVodeSetMaxErrTestFails(memory, kManyFailures), "CVodeSetMaxErrTestFails");
    check(CVodeSetMaxConvFails(memory, kManyFailures), "CVodeSetMaxConvFails");
    if (newton_) {
      linear_.reset(SUNLinSol_SPGMR(y, SUN_PREC_NONE, krylov_, context()));
      check(CVodeSetLinearSolver(memory, linear_.get(), nullptr), "CVodeSetLinearSolver");
      // From the norm of points to the 2-norm of the Krylov space: that is never smaller.
      check(CVodeSetLSNormFactor(memory, 1.0), "CVodeSetLSNormFactor");
    } else {
      fixed_point_.reset(SUNNonlinSol_FixedPoint(y, 0, context()));
      check(CVodeSetNonlinearSolver(memory, fixed_point_.get()), "CVodeSetNonlinearSolver");
    }
  }

  int set_stop_time(double t) override { return CVodeSetStopTime(memory_.get(), t); }
  int one_step(double stop, N_Vector y, double* t) override { return CVode(memory_.get(), stop, y, t, CV_ONE_STEP); }
  int derivative(double t, N_Vector y) override { return CVodeGetDky(memory_.get(), t, 0, y); }
  int local_errors(N_Vector errors) override { return CVodeGetEstLocalErrors(memory_.get(), errors); }
  int error_test_failures(long* count) override { return CVodeGetNumErrTestFails(memory_.get(), count); }

  End meaning(int flag) const override {
    switch (flag) {
      case CV_ERR_FAILURE:
      case CV_CONV_FAILURE:
      case CV_TOO_MUCH_ACC:
      case CV_TOO_CLOSE: return End::too_small;
      default: return flag < 0 ? End::broken : End::done;
    }
  }
  std::string name_of(int flag) const override {
    const std::unique_ptr<char, SundialsDeleter<std::free>> name(CVodeGetReturnFlagName(flag));
    return name.get();
  }

 private:
  static constexpr int kManyFailures = 100;  // the smallest step ends them

  // The memory refers to the solvers.
  void release() {
    memory_.reset();
    linear_.reset();
    fixed_point_.reset();
  }

  int method_;
  int max_order_;
  bool newton_;
  int krylov_;
  std::unique_ptr<_generic_SUNLinearSolver, SundialsDeleter<SUNLinSolFree>> linear_;
  std::unique_ptr<_generic_SUNNonlinearSolver, SundialsDeleter<SUNNonlinSolFree>> fixed_point_;
  std::unique_ptr<void, SundialsMemoryDeleter<CVodeFree>> memory_;
};
#endif

}  // namespace

OdeBackendEntry cvode_entry(CvodeMethod method) {
  const bool adams = method == CvodeMethod::adams;
  const int order = adams ? kOrderAdams : kOrderBdf;
  OdeBackendEntry entry;
  entry.name = adams ? "cvode.adams" : "cvode.bdf";
  entry.doc = adams ? "Adams-Moulton methods of variable order and step, of SUNDIALS, for fields that are not stiff"
                    : "backward differentiation formulas of variable order and step, of SUNDIALS, for stiff fields";
  entry.package = "libsundials-dev";
  entry.option = "VARIFORM_SUNDIALS";
  entry.parameters = {
      {.name = "max_order",
       .value = std::int64_t{order},
       .doc = "largest order",
       .min = 1.0,
       .max = static_cast<double>(order)},
      {.name = "nonlinear",
       .value = std::string(adams ? "fixed_point" : "newton_krylov"),
       .doc = "how the implicit formula is solved; newton_krylov: with differences along Krylov directions",
       .choices = {"fixed_point", "newton_krylov"}},
      {.name = "krylov",
       .value = std::int64_t{10},
       .doc = "newton_krylov: directions of GMRES at most",
       .min = 1.0,
       .max = 1000.0}};
#ifdef VARIFORM_WITH_SUNDIALS
  entry.make = [method](const Parameters& p) { return std::make_unique<Cvode>(method, p); };
#endif
  return entry;
}

}  // namespace variform
