// SPDX-License-Identifier: BSD-3-Clause
#include <limits>

#include "solvers/linear/linear_backends.h"

namespace variform {

namespace {

#ifdef VARIFORM_WITH_SUITESPARSE
constexpr bool kWithSuiteSparse = true;
#else
constexpr bool kWithSuiteSparse = false;
#endif

constexpr LinearCapabilities kCapabilities{
    .spd = true, .symmetric_indefinite = true, .general = true, .least_squares = kWithSuiteSparse};

class AutoBackend final : public LinearBackend {
 public:
  AutoBackend(std::string name, double threshold) : LinearBackend(std::move(name)), threshold_(threshold) {}

  LinearCapabilities capabilities() const override { return kCapabilities; }

 private:
  void do_analyze() override {
    switch (kind()) {
      case MatrixKind::spd: choose_cholesky(); break;
      case MatrixKind::symmetric_indefinite:
      case MatrixKind::general: choose(kWithSuiteSparse ? "umfpack" : "eigen.lu"); break;
      case MatrixKind::least_squares: choose("spqr"); break;
    }
    adopt_report();
  }

  /// Dense blocks pay when the columns of the factor are long: flops per non-zero of L is their weighted mean length.
  /// The analysis is the one of cholmod.supernodal, so that nothing is analysed twice where it is chosen.
  void choose_cholesky() {
    if (kWithSuiteSparse) {
      choose("cholmod.supernodal");
      const LinearReport& report = chosen_->report();
      if (report.flops >= threshold_ * static_cast<double>(report.nnz_factor)) return;
    }
    choose("eigen.ldlt");
  }

  void choose(const std::string& name) {
    chosen_ = make_linear_backend(name);
    chosen_->residual_limit = std::numeric_limits<double>::infinity();  // this backend checks its own
    chosen_->analyze(matrix(), kind());
  }

  void do_factorize() override {
    chosen_->factorize(matrix(), kind());
    adopt_report();
  }

  void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) override {
    chosen_->solve(B, X);
    adopt_report();
  }

  void adopt_report() {
    const LinearReport& from = chosen_->report();
    LinearReport& to = mutable_report();
    to.backend = from.backend;
    to.ordering = from.ordering;
    to.nnz_factor = from.nnz_factor;
    to.flops = from.flops;
    to.peak_memory = from.peak_memory;
    to.iterations = from.iterations;
  }

  double threshold_;
  std::unique_ptr<LinearBackend> chosen_;
};

}  // namespace

LinearBackendEntry describe_auto() {
  LinearBackendEntry entry;
  entry.name = "auto";
  entry.doc = "chooses a direct backend by the kind of the matrix and the size of its factor";
  entry.capabilities = kCapabilities;
  entry.licence = kWithSuiteSparse ? "GPL-2.0-or-later" : "MPL-2.0";
  entry.parameters = {{.name = "threshold",
                       .value = 90.0,
                       .doc = "flops per non-zero of the factor from which on positive definite systems go to "
                              "cholmod.supernodal instead of eigen.ldlt",
                       .min = 0.0}};
  entry.make = [name = entry.name](const Parameters& parameters) {
    return std::make_unique<AutoBackend>(name, parameters.number("threshold"));
  };
  return entry;
}

}  // namespace variform
