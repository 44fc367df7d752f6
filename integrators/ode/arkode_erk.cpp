// SPDX-License-Identifier: BSD-3-Clause
#include "integrators/ode/ode_backends.h"

#ifdef VARIFORM_WITH_SUNDIALS
#include <arkode/arkode_erkstep.h>

#include <array>
#include <cstdlib>
#include <string_view>

#include "framework/base/error.h"
#include "integrators/ode/sundials_backend.h"
#endif

namespace variform {

#ifdef VARIFORM_WITH_SUNDIALS
namespace {

struct Table {
  std::string_view name;
  ARKODE_ERKTableID id;
  int order;
};
constexpr std::array<Table, 8> kTables = {{{"heun_euler", ARKODE_HEUN_EULER_2_1_2, 2},
                                           {"bogacki_shampine", ARKODE_BOGACKI_SHAMPINE_4_2_3, 3},
                                           {"zonneveld", ARKODE_ZONNEVELD_5_3_4, 4},
                                           {"cash_karp", ARKODE_CASH_KARP_6_4_5, 5},
                                           {"fehlberg", ARKODE_FEHLBERG_6_4_5, 5},
                                           {"dormand_prince", ARKODE_DORMAND_PRINCE_7_4_5, 5},
                                           {"verner", ARKODE_VERNER_8_5_6, 6},
                                           {"fehlberg_8", ARKODE_FEHLBERG_13_7_8, 8}}};

class ArkodeErk final : public SundialsBackend {
 public:
  explicit ArkodeErk(const Parameters& parameters)
      : SundialsBackend("arkode.erk"), table_(table_of(parameters.string("table"))) {}

  int order() const override { return table_.order; }

 protected:
  void create(double t, N_Vector y) override {
    memory_.reset();
    memory_.reset(ERKStepCreate(right_hand_side, t, y, context()));
    if (memory_ == nullptr) throw SolverError("ARKODE: no memory");
    void* memory = memory_.get();
    check(ERKStepSetErrHandlerFn(memory, ignore_message, nullptr), "ERKStepSetErrHandlerFn");
    check(ERKStepSetUserData(memory, static_cast<SundialsBackend*>(this)), "ERKStepSetUserData");
    check(ERKStepSetTableNum(memory, table_.id), "ERKStepSetTableNum");
    // Cubic: needs no evaluations besides those of the steps.
    check(ERKStepSetInterpolantDegree(memory, 3), "ERKStepSetInterpolantDegree");
    check(ERKStepSStolerances(memory, 0.0, absolute_tolerance()), "ERKStepSStolerances");
    check(ERKStepSetMinStep(memory, least_step(t)), "ERKStepSetMinStep");
    check(ERKStepSetMaxErrTestFails(memory, kManyFailures), "ERKStepSetMaxErrTestFails");
  }

  int set_stop_time(double t) override { return ERKStepSetStopTime(memory_.get(), t); }
  int set_first_step(double size) override { return ERKStepSetInitStep(memory_.get(), size); }
  int one_step(double stop, N_Vector y, double* t) override {
    return ERKStepEvolve(memory_.get(), stop, y, t, ARK_ONE_STEP);
  }
  int derivative(double t, N_Vector y) override { return ERKStepGetDky(memory_.get(), t, 0, y); }
  int local_errors(N_Vector errors) override { return ERKStepGetEstLocalErrors(memory_.get(), errors); }
  int error_test_failures(long* count) override { return ERKStepGetNumErrTestFails(memory_.get(), count); }

  End meaning(int flag) const override {
    switch (flag) {
      case ARK_ERR_FAILURE:
      case ARK_CONV_FAILURE:
      case ARK_TOO_MUCH_ACC:
      case ARK_TOO_CLOSE: return End::too_small;
      default: return flag < 0 ? End::broken : End::done;
    }
  }
  std::string name_of(int flag) const override {
    const std::unique_ptr<char, SundialsDeleter<std::free>> name(ERKStepGetReturnFlagName(flag));
    return name.get();
  }

 private:
  static constexpr int kManyFailures = 100;  // the smallest step ends them

  static const Table& table_of(std::string_view name) {
    for (const Table& table : kTables) {
      if (table.name == name) return table;
    }
    throw UsageError("ARKODE: unknown table '" + std::string(name) + "'");
  }

  const Table& table_;
  std::unique_ptr<void, SundialsMemoryDeleter<ERKStepFree>> memory_;
};

}  // namespace
#endif

OdeBackendEntry describe_arkode_erk() {
  OdeBackendEntry entry;
  entry.name = "arkode.erk";
  entry.doc = "embedded explicit Runge-Kutta methods with step control, of SUNDIALS";
  entry.package = "libsundials-dev";
  entry.option = "VARIFORM_SUNDIALS";
  entry.parameters = {{.name = "table",
                       .value = std::string("dormand_prince"),
                       .doc = "method, of order 2, 3, 4, 5, 5, 5, 6, 8",
                       .choices = {"heun_euler", "bogacki_shampine", "zonneveld", "cash_karp", "fehlberg",
                                   "dormand_prince", "verner", "fehlberg_8"}}};
#ifdef VARIFORM_WITH_SUNDIALS
  entry.make = [](const Parameters& p) { return std::make_unique<ArkodeErk>(p); };
#endif
  return entry;
}

}  // namespace variform
