// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/linear_backends.h"

#ifdef VARIFORM_WITH_PETSC
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "solvers/linear/iterative.h"
#include "solvers/linear/petsc_session.h"
#endif

namespace variform {

namespace {

constexpr LinearCapabilities kCapabilities{.spd = true, .symmetric_indefinite = true, .general = true, .direct = false};

#ifdef VARIFORM_WITH_PETSC

struct KrylovOptions {
  std::string ksp;
  std::string pc;
  double tolerance;
  Index max_iterations;
  Index block_size;
  std::string options;
};

class PetscBackend final : public LinearBackend {
 public:
  PetscBackend(std::string name, KrylovOptions options)
      : LinearBackend(std::move(name)), options_(std::move(options)), prefix_(petsc::set_options(options_.options)) {}

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void do_analyze() override {
    ksp_.reset();
    matrix_.analyze(matrix(), kind(), options_.block_size);
    vectors_.resize(report().rows, report().columns);
    checked_ = false;
    const bool definite = kind() == MatrixKind::spd;
    const std::string ksp = !options_.ksp.empty() ? options_.ksp : definite ? KSPCG : KSPGMRES;
    const std::string inverse = !options_.pc.empty() ? options_.pc : definite ? PCGAMG : PCLU;
    petsc::run("PETSc setup", [&] {
      PetscCall(KSPCreate(petsc::communicator(), ksp_.create()));
      PetscCall(KSPSetOptionsPrefix(ksp_, prefix_.c_str()));
      PetscCall(KSPSetOperators(ksp_, matrix_.get(), matrix_.get()));
      PetscCall(KSPSetType(ksp_, ksp.c_str()));
      PC preconditioner = nullptr;
      PetscCall(KSPGetPC(ksp_, &preconditioner));
      PetscCall(PCSetType(preconditioner, inverse.c_str()));
      // PETSc's own factorizations do not pivot.
      if (inverse == PCLU && !definite) PetscCall(PCFactorSetMatSolverType(preconditioner, MATSOLVERSUPERLU));
      const Index limit = options_.max_iterations > 0 ? options_.max_iterations : std::max(2 * report().columns, 2);
      PetscCall(KSPSetTolerances(ksp_, options_.tolerance, PETSC_DEFAULT, PETSC_DEFAULT, limit));
      // The tolerance is one of the residual itself, where the method can tell it.
      if (ksp == KSPCG) PetscCall(KSPSetNormType(ksp_, KSP_NORM_UNPRECONDITIONED));
      if (ksp == KSPGMRES || ksp == KSPFGMRES) PetscCall(KSPSetPCSide(ksp_, PC_RIGHT));
      PetscCall(KSPSetResidualHistory(ksp_, nullptr, PETSC_DECIDE, PETSC_TRUE));
      return KSPSetFromOptions(ksp_);
    });
    KSPType chosen = nullptr;
    PCType preconditioner = nullptr;
    petsc::run("PETSc setup", [&] {
      PetscCall(KSPGetType(ksp_, &chosen));
      PetscCall(PCGetType(pc(), &preconditioner));
      return PetscErrorCode(0);
    });
    method_ = fmt::format("{} with {}", chosen, preconditioner);
  }

  PC pc() const {
    PC pc = nullptr;
    KSPGetPC(ksp_, &pc);
    return pc;
  }

  void do_factorize() override {
    if (kind() == MatrixKind::spd) {
      if (const std::string wrong = wrong_diagonal(matrix()); !wrong.empty()) fail(wrong);
    }
    matrix_.update(matrix());
    petsc::run(fmt::format("PETSc: setup of {} for the {} x {} matrix, which may be singular", method_, matrix().rows(),
                           matrix().cols()),
               [&] {
                 PetscCall(KSPSetUp(ksp_));
                 return KSPSetUpOnBlocks(ksp_);
               });
    PCFailedReason failed = PC_NOERROR;
    petsc::run("PETSc setup", [&] { return PCGetFailedReason(pc(), &failed); });
    if (failed != PC_NOERROR) {
      fail(fmt::format("setup of {} for the {} x {} matrix failed ({}): it is singular, or the method needs another",
                       method_, matrix().rows(), matrix().cols(), PCFailedReasons[failed]));
    }
    const double levels = petsc::multigrid_bytes(pc());
    if (levels >= 0.0) mutable_report().peak_memory = levels + matrix_.bytes();
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    X.setZero();
    LinearReport& report = mutable_report();
    for (Eigen::Index j = 0; j < B.cols(); ++j) {
      PetscInt iterations = 0;
      KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
      std::vector<double> history;
      petsc::run(fmt::format("PETSc: {}", method_), [&] {
        PetscCall(vectors_.with(B.col(j).data(), X.col(j).data(), [&](Vec b, Vec x) { return KSPSolve(ksp_, b, x); }));
        PetscCall(KSPGetIterationNumber(ksp_, &iterations));
        PetscCall(KSPGetConvergedReason(ksp_, &reason));
        const PetscReal* norms = nullptr;
        PetscInt count = 0;
        PetscCall(KSPGetResidualHistory(ksp_, &norms, &count));
        history.assign(norms, norms + count);
        return PetscErrorCode(0);
      });
      if (!history.empty() && history.front() > 0.0) {
        const double first = history.front();
        for (double& norm : history) norm /= first;
      }
      if (j == 0 || iterations > report.iterations) report.residual_history = history;
      report.iterations = std::max<int>(report.iterations, iterations);
      report.reason = fmt::format("{}: {}", method_, KSPConvergedReasons[reason]);
      if (reason < 0) {
        fail(
            fmt::format("no convergence for column {} of {} after {} iterations of {} ({}): relative residual {:.3g}, "
                        "tolerance {:.3g}",
                        j, B.cols(), iterations, method_, KSPConvergedReasons[reason],
                        history.empty() ? 1.0 : history.back(), options_.tolerance));
      }
    }
    if (!checked_) petsc::check_options_used(prefix_);
    checked_ = true;
  }

  KrylovOptions options_;
  std::string prefix_;
  std::string method_;
  bool checked_ = false;
  petsc::Matrix matrix_;
  petsc::VectorPair vectors_;
  petsc::KspHandle ksp_;
};

#endif

}  // namespace

LinearBackendEntry describe_petsc() {
  LinearBackendEntry entry;
  entry.name = "petsc";
  entry.doc = "any Krylov method of PETSc with any of its preconditioners, multigrid among them";
  entry.capabilities = kCapabilities;
  entry.package = "libpetsc-real-dev";
  entry.option = "VARIFORM_PETSC";
  // PETSc itself is BSD-2-Clause; as Debian builds it, it loads UMFPACK, SPQR and FFTW.
  entry.licence = "GPL-2.0-or-later";
  entry.parameters = {
      {.name = "ksp",
       .value = std::string(),
       .doc = "Krylov method as PETSc names it (cg, minres, gmres, preonly, ...); empty: cg for positive definite "
              "systems, gmres for others"},
      {.name = "pc",
       .value = std::string(),
       .doc = "preconditioner (gamg, hypre, icc, ilu, jacobi, cholesky, lu, none, ...); empty: gamg for positive "
              "definite systems, lu for others"},
      tolerance_parameter(),
      limit_parameter(),
      {.name = "block_size",
       .value = std::int64_t{1},
       .doc = "unknowns per vertex, d for coupled energies",
       .min = 1.0,
       .max = 64.0},
      {.name = "options",
       .value = std::string(),
       .doc = "further options of PETSc, as \"-pc_gamg_threshold 0.02 -mg_levels_ksp_max_it 3\"; they come last"},
  };
#ifdef VARIFORM_WITH_PETSC
  entry.make = [name = entry.name](const Parameters& parameters) {
    return std::make_unique<PetscBackend>(
        name, KrylovOptions{parameters.string("ksp"), parameters.string("pc"), parameters.number("tolerance"),
                            static_cast<Index>(parameters.integer("max_iterations")),
                            static_cast<Index>(parameters.integer("block_size")), parameters.string("options")});
  };
#endif
  return entry;
}

}  // namespace variform
