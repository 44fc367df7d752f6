// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>

#include <exception>
#include <limits>
#include <memory>
#include <string>

#include "framework/solver/ode_backend.h"

namespace variform {

/// Frees a SUNDIALS object by its function.
template <auto Free>
struct SundialsDeleter {
  template <class T>
  void operator()(T* object) const {
    Free(object);
  }
};
/// cvode_mem, arkode_mem: void pointers whose functions take their address.
template <auto Free>
struct SundialsMemoryDeleter {
  void operator()(void* memory) const { Free(&memory); }
};
inline void free_sundials_context(SUNContext context) { SUNContext_Free(&context); }

using SundialsContext = std::unique_ptr<_SUNContext, SundialsDeleter<free_sundials_context>>;
using SundialsVector = std::unique_ptr<_generic_N_Vector, SundialsDeleter<N_VDestroy>>;

/// Backends of SUNDIALS (Hindmarsh et al. 2005) that step by step go on to a stop time. Errors are measured at points
/// as all others do: the weighted root-mean-square norm of the vectors is replaced by the largest length of a point.
/// What the field throws is carried over the library, StepRefused as a failure that it answers with shorter steps; when
/// it gives up, the common loop halves the step. The memory of the library cannot be saved: it is made anew at every
/// start.
class SundialsBackend : public OdeBackend {
 protected:
  explicit SundialsBackend(std::string name);

  bool keeps_history() const final { return false; }
  void prepare() final;
  void start(Point& at) final;
  Attempt attempt(const Point& from, Point& to) final;
  void interpolate(double t, const Point& from, const Point& to, Vector& y) final;

  /// What a return code says of a step.
  enum class End { done, too_small, broken };

  // Thin wraps of the calls of a library.
  /// Makes the memory for an integration from y at t by right_hand_side() with this backend as user data.
  virtual void create(double t, N_Vector y) = 0;
  virtual int set_stop_time(double t) = 0;
  /// Size to try first after create(); by default the library estimates it, up to the stop time.
  virtual int set_first_step(double /*size*/) { return 0; }
  virtual int one_step(double stop, N_Vector y, double* t) = 0;
  virtual int derivative(double t, N_Vector y) = 0;  ///< of order 0: the state at t, within the last step
  virtual int local_errors(N_Vector errors) = 0;
  virtual int error_test_failures(long* count) = 0;
  virtual End meaning(int flag) const = 0;
  virtual std::string name_of(int flag) const = 0;

  SUNContext context() const { return context_.get(); }
  /// Error that a step may have at a point, as a length: the absolute tolerance; there is no relative one.
  double absolute_tolerance() const { return tolerance() * length_scale(); }
  /// For pieces that are shorter than the smallest step: none.
  double least_step(double t) const { return limit() - t > smallest_step() ? smallest_step() : 0.0; }
  /// Throws SolverError for negative return codes.
  void check(int flag, const char* call) const;

  static int right_hand_side(double t, N_Vector y, N_Vector dy, void* self);
  /// Messages are in the return codes.
  static void ignore_message(int, const char*, const char*, char*, void*) {}

 private:
  SundialsContext context_;
  SundialsVector state_, work_;
  Vector y_, dy_;
  std::exception_ptr error_;
  bool first_ = true;  // attempt since create()
  int refusals_ = 0;   // in this attempt
  double refused_time_ = 0.0;
  std::string refusal_;
  long failures_ = 0;  // of the error test, since the last start
};

}  // namespace variform
