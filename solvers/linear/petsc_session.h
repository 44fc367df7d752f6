// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// Private to the backends that use PETSc; only for builds with it.

#include <petscksp.h>

#include <string>
#include <utility>
#include <vector>

#include "framework/solver/linear_backend.h"
#include "solvers/linear/full_matrix.h"

namespace variform::petsc {

/// Initializes PETSc (and MPI as a process on its own) on first use, and finalizes it at exit; does nothing where the
/// program initialized PETSc itself. Signals and ~/.petscrc are left alone. PETSc is not thread-safe: one thread at a
/// time may use it. A process that was forked off afterwards may go on using it.
void initialize();

/// That all objects live on. Everything is sequential; a distributed version starts here.
inline MPI_Comm communicator() { return PETSC_COMM_SELF; }

/// Takes the messages of PETSc's errors while it lives, so that nothing is printed and nothing aborts.
class ErrorScope {
 public:
  ErrorScope();
  ~ErrorScope();
  ErrorScope(const ErrorScope&) = delete;
  ErrorScope& operator=(const ErrorScope&) = delete;

  /// Throws SolverError with PETSc's message, unless code is 0.
  void check(PetscErrorCode code, const std::string& what) const;

 private:
  std::string message_;
};

/// Runs a function that returns PETSc's error code (PetscCall can be used inside). Throws SolverError when it fails:
/// "what: message".
template <class Function>
void run(const std::string& what, const Function& function) {
  initialize();
  const ErrorScope scope;
  scope.check(function(), what);
}

/// Owns one PETSc object.
template <class Object, PetscErrorCode (*Destroy)(Object*)>
class Handle {
 public:
  Handle() = default;
  ~Handle() { reset(); }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;

  void reset() {
    if (object_ != nullptr && PetscFinalizeCalled == PETSC_FALSE) Destroy(&object_);
    object_ = nullptr;
  }
  /// For functions that create: destroys what was there.
  Object* create() {
    reset();
    return &object_;
  }
  operator Object() const { return object_; }

 private:
  Object object_ = nullptr;
};

using MatHandle = Handle<Mat, MatDestroy>;
using VecHandle = Handle<Vec, VecDestroy>;
using KspHandle = Handle<KSP, KSPDestroy>;
using PcHandle = Handle<PC, PCDestroy>;

/// A matrix as PETSc sees it, by rows; its values stay here.
class Matrix {
 public:
  /// Throws UsageError unless block_size divides the size.
  void analyze(const SparseMatrix& A, MatrixKind kind, Index block_size);
  void update(const SparseMatrix& A);
  Mat get() const { return mat_; }
  double bytes() const;

 private:
  using Rows = Eigen::SparseMatrix<double, Eigen::RowMajor, Index>;
  bool symmetric_ = false;
  FullMatrix full_;  // symmetric: columns are rows
  Rows rows_;        // general
  MatHandle mat_;
};

/// Two vectors of one size whose values are those of the caller.
class VectorPair {
 public:
  void resize(Index rows, Index columns);
  /// Calls function(Vec b, Vec x) for the memory given.
  template <class Function>
  PetscErrorCode with(const double* b, double* x, const Function& function) const {
    PetscCall(VecPlaceArray(b_, b));
    PetscCall(VecPlaceArray(x_, x));
    const PetscErrorCode code = function(static_cast<Vec>(b_), static_cast<Vec>(x_));
    PetscCall(VecResetArray(x_));
    PetscCall(VecResetArray(b_));
    return code;
  }

 private:
  VecHandle b_;
  VecHandle x_;
};

/// Makes options ("-pc_type gamg -ksp_max_it 10") known to PETSc under a prefix, which is returned, that is the same
/// for the same text only. Throws UsageError when the text is not a list of options.
std::string set_options(const std::string& options);

/// Throws UsageError naming the options under this prefix that nothing asked for so far.
void check_options_used(const std::string& prefix);

/// Bytes of the operators of a multigrid preconditioner (PCMG, PCGAMG), coarse levels only; -1 for other kinds.
double multigrid_bytes(PC pc);

}  // namespace variform::petsc
