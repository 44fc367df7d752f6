// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "framework/base/error.h"
#include "solvers/linear/preconditioner.h"

#ifdef VARIFORM_WITH_PETSC
#include "solvers/linear/petsc_session.h"
#endif

namespace variform {

#ifdef VARIFORM_WITH_PETSC

namespace {

class Multigrid final : public Preconditioner {
 public:
  explicit Multigrid(MultigridOptions options)
      : options_(std::move(options)), prefix_(petsc::set_options(options_.options)) {}

  void analyze(const SparseMatrix& A) override {
    pc_.reset();
    matrix_.analyze(A, MatrixKind::spd, options_.block_size);
    vectors_.resize(static_cast<Index>(A.rows()), static_cast<Index>(A.rows()));
    petsc::run("multigrid", [&] {
      PetscCall(PCCreate(petsc::communicator(), pc_.create()));
      PetscCall(PCSetOptionsPrefix(pc_, prefix_.c_str()));
      PetscCall(PCSetOperators(pc_, matrix_.get(), matrix_.get()));
      if (options_.method == "boomeramg") {
        PetscCall(PCSetType(pc_, PCHYPRE));
        PetscCall(PCHYPRESetType(pc_, "boomeramg"));
      } else {
        PetscCall(PCSetType(pc_, PCGAMG));
      }
      return PCSetFromOptions(pc_);
    });
  }

  void factorize(const SparseMatrix& A) override {
    matrix_.update(A);
    petsc::run("multigrid setup", [&] { return PCSetUp(pc_); });
    petsc::check_options_used(prefix_);
    const double levels = petsc::multigrid_bytes(pc_);
    bytes_ = levels < 0.0 ? levels : levels + matrix_.bytes();
  }

  void apply(const Vector& r, Vector& z) override {
    petsc::run("multigrid cycle",
               [&] { return vectors_.with(r.data(), z.data(), [&](Vec b, Vec x) { return PCApply(pc_, b, x); }); });
  }

  double bytes() const override { return bytes_; }

 private:
  MultigridOptions options_;
  std::string prefix_;
  petsc::Matrix matrix_;
  petsc::VectorPair vectors_;
  petsc::PcHandle pc_;
  double bytes_ = -1.0;
};

}  // namespace

std::unique_ptr<Preconditioner> make_multigrid(const MultigridOptions& options) {
  return std::make_unique<Multigrid>(options);
}

#else

std::unique_ptr<Preconditioner> make_multigrid(const MultigridOptions& /*options*/) {
  throw UsageError(
      "preconditioner 'amg' is not compiled in; install libpetsc-real-dev and configure with VARIFORM_PETSC=ON");
}

#endif

}  // namespace variform
