// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/eigen/eigen_backends.h"

#ifdef VARIFORM_WITH_SLEPC
#include <fmt/format.h>
#include <slepceps.h>
#include <unistd.h>

#include <cstdlib>
#include <exception>
#include <utility>

#include "framework/base/error.h"
#include "solvers/linear/petsc_session.h"
#endif

namespace variform {

#ifdef VARIFORM_WITH_SLEPC

namespace {

pid_t initialized_by = 0;

void initialize() {
  petsc::initialize();
  if (initialized_by != 0 || SlepcInitializeCalled == PETSC_TRUE) return;
  petsc::run("SLEPc", [] { return SlepcInitializeNoArguments(); });
  initialized_by = getpid();
  // Registered after PETSc's, so it runs before.
  std::atexit([] {
    if (getpid() == initialized_by && SlepcFinalizeCalled == PETSC_FALSE) SlepcFinalize();
  });
}

class Slepc final : public EigenBackend {
 public:
  Slepc(std::string name, std::unique_ptr<LinearBackend> inner) : EigenBackend(std::move(name), std::move(inner)) {}

 private:
  // What SLEPc calls. Exceptions do not pass through it: they wait in error_.
  template <class Function>
  PetscErrorCode act(Vec in, Vec out, const Function& function) {
    const PetscScalar* x = nullptr;
    PetscScalar* y = nullptr;
    PetscCall(VecGetArrayRead(in, &x));
    PetscCall(VecGetArray(out, &y));
    bool well = true;
    try {
      Eigen::Map<Vector>(y, rows()) = function(Eigen::Map<const Vector>(x, rows()));
    } catch (...) {
      error_ = std::current_exception();
      well = false;
    }
    PetscCall(VecRestoreArray(out, &y));
    PetscCall(VecRestoreArrayRead(in, &x));
    return well ? 0 : PETSC_ERR_LIB;
  }
  static PetscErrorCode multiply_mass(Mat M, Vec in, Vec out) {
    Slepc* self = nullptr;
    PetscCall(MatShellGetContext(M, &self));
    return self->act(in, out, [self](const Eigen::Ref<const Vector>& x) { return self->apply_mass(x); });
  }
  static PetscErrorCode solve_shifted(PC pc, Vec in, Vec out) {
    Slepc* self = nullptr;
    PetscCall(PCShellGetContext(pc, &self));
    return self->act(in, out, [self](const Eigen::Ref<const Vector>& b) { return self->apply_inverse(b); });
  }

  Eigen::MatrixXd iterate(Index count, Index subspace, const Vector& start) override {
    initialize();
    error_ = nullptr;
    const Index n = rows();
    petsc::MatHandle mass;
    petsc::MatHandle stiffness;
    petsc::VecHandle vector;
    petsc::Handle<EPS, EPSDestroy> eps;
    Eigen::MatrixXd X(n, count);
    PetscInt converged = 0;
    PetscInt iterations = 0;
    try {
      petsc::run("SLEPc", [&] {
        const MPI_Comm world = petsc::communicator();
        PetscCall(MatCreateShell(world, n, n, n, n, this, mass.create()));
        PetscCall(MatShellSetOperation(mass, MATOP_MULT, reinterpret_cast<void (*)()>(multiply_mass)));
        PetscCall(MatSetOption(mass, MAT_HERMITIAN, PETSC_TRUE));
        // K is asked for its sizes only: K - shift M is solved with, never multiplied by.
        PetscCall(MatCreateShell(world, n, n, n, n, this, stiffness.create()));
        PetscCall(MatSetOption(stiffness, MAT_HERMITIAN, PETSC_TRUE));
        PetscCall(EPSCreate(world, eps.create()));
        PetscCall(EPSSetOperators(eps, stiffness, mass));
        PetscCall(EPSSetProblemType(eps, EPS_GHEP));
        PetscCall(EPSSetType(eps, EPSKRYLOVSCHUR));
        PetscCall(EPSSetWhichEigenpairs(eps, EPS_TARGET_MAGNITUDE));
        PetscCall(EPSSetTarget(eps, report().shift));
        ST st = nullptr;
        KSP ksp = nullptr;
        PC pc = nullptr;
        PetscCall(EPSGetST(eps, &st));
        PetscCall(STSetType(st, STSINVERT));
        PetscCall(STSetMatMode(st, ST_MATMODE_SHELL));
        PetscCall(STGetKSP(st, &ksp));
        PetscCall(KSPSetType(ksp, KSPPREONLY));
        PetscCall(KSPGetPC(ksp, &pc));
        PetscCall(PCSetType(pc, PCSHELL));
        PetscCall(PCShellSetContext(pc, this));
        PetscCall(PCShellSetApply(pc, solve_shifted));
        PetscCall(EPSSetDimensions(eps, count, subspace, PETSC_DEFAULT));
        PetscCall(EPSSetTolerances(eps, options.tolerance, options.max_iterations));
        PetscCall(VecCreateSeqWithArray(world, 1, n, start.data(), vector.create()));
        Vec first = vector;
        PetscCall(EPSSetInitialSpace(eps, 1, &first));
        PetscCall(EPSSolve(eps));
        PetscCall(EPSGetConverged(eps, &converged));
        PetscCall(EPSGetIterationNumber(eps, &iterations));
        for (PetscInt j = 0; j < std::min<PetscInt>(converged, count); ++j) {
          PetscCall(VecPlaceArray(vector, X.col(j).data()));
          PetscCall(EPSGetEigenvector(eps, j, vector, nullptr));
          PetscCall(VecResetArray(vector));
        }
        return PetscErrorCode(0);
      });
    } catch (const SolverError&) {
      if (error_) std::rethrow_exception(error_);
      throw;
    }
    mutable_report().iterations = static_cast<int>(iterations);
    if (converged < count) {
      fail(fmt::format("{} of {} eigenvalues converged to {:.3g} in {} iterations with {} vectors", converged, count,
                       options.tolerance, iterations, subspace));
    }
    return X;
  }

  std::exception_ptr error_;
};

}  // namespace

#endif

EigenBackendEntry describe_slepc() {
  EigenBackendEntry entry;
  entry.name = "slepc";
  entry.doc = "Krylov-Schur of SLEPc";
  entry.package = "libslepc-real-dev";
  entry.option = "VARIFORM_PETSC";
  // SLEPc and PETSc are BSD-2-Clause; as Debian builds PETSc, it loads UMFPACK, SPQR and FFTW.
  entry.licence = "GPL-2.0-or-later";
#ifdef VARIFORM_WITH_SLEPC
  entry.make = [name = entry.name](std::unique_ptr<LinearBackend> inner) {
    return std::make_unique<Slepc>(name, std::move(inner));
  };
#endif
  return entry;
}

}  // namespace variform
