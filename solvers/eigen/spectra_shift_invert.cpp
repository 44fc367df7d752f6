// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/eigen/eigen_backends.h"

#ifdef VARIFORM_WITH_SPECTRA
#include <Spectra/SymGEigsShiftSolver.h>
#include <fmt/format.h>

#include <utility>
#endif

namespace variform {

#ifdef VARIFORM_WITH_SPECTRA

namespace {

/// A function as Spectra's operations want it.
template <class Function>
class Operation {
 public:
  using Scalar = double;
  Operation(Eigen::Index rows, Function function) : rows_(rows), function_(std::move(function)) {}
  Eigen::Index rows() const { return rows_; }
  Eigen::Index cols() const { return rows_; }
  void set_shift(double /*shift*/) {}  // the matrix is shifted already
  void perform_op(const double* x, double* y) const {
    Eigen::Map<Vector>(y, rows_) = function_(Eigen::Map<const Vector>(x, rows_));
  }

 private:
  Eigen::Index rows_;
  Function function_;
};

class SpectraShiftInvert final : public EigenBackend {
 public:
  SpectraShiftInvert(std::string name, std::unique_ptr<LinearBackend> inner)
      : EigenBackend(std::move(name), std::move(inner)) {}

 private:
  Eigen::MatrixXd iterate(Index count, Index subspace, const Vector& start) override {
    Operation inverse(rows(), [this](const Eigen::Ref<const Vector>& b) { return apply_inverse(b); });
    Operation mass(rows(), [this](const Eigen::Ref<const Vector>& x) { return apply_mass(x); });
    Spectra::SymGEigsShiftSolver<decltype(inverse), decltype(mass), Spectra::GEigsMode::ShiftInvert> solver(
        inverse, mass, count, subspace, report().shift);
    solver.init(start.data());
    const auto converged = solver.compute(Spectra::SortRule::LargestMagn, options.max_iterations, options.tolerance,
                                          Spectra::SortRule::SmallestAlge);
    mutable_report().iterations = static_cast<int>(solver.num_iterations());
    if (solver.info() != Spectra::CompInfo::Successful) {
      fail(fmt::format("{} of {} eigenvalues converged to {:.3g} in {} iterations with {} vectors", converged, count,
                       options.tolerance, options.max_iterations, subspace));
    }
    return solver.eigenvectors();
  }
};

}  // namespace

#endif

EigenBackendEntry describe_spectra_shift_invert() {
  EigenBackendEntry entry;
  entry.name = "spectra.shift_invert";
  entry.doc = "implicitly restarted Lanczos of Spectra";
  entry.package = "libspectra-dev";
  entry.option = "VARIFORM_SPECTRA";
  entry.licence = "MPL-2.0";
#ifdef VARIFORM_WITH_SPECTRA
  entry.make = [name = entry.name](std::unique_ptr<LinearBackend> inner) {
    return std::make_unique<SpectraShiftInvert>(name, std::move(inner));
  };
#endif
  return entry;
}

}  // namespace variform
