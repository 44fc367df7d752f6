// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/nonlinear/nlopt_backend.h"

#ifdef VARIFORM_WITH_NLOPT
#include <fmt/format.h>
#include <nlopt.h>

#include <cmath>
#include <exception>
#include <memory>

#include "framework/base/error.h"
#include "solvers/nonlinear/library_backend.h"
#endif

namespace variform {

#ifdef VARIFORM_WITH_NLOPT
namespace {

// NLopt reports no iterations: a row of the history is an evaluation of value and gradient, and tells of the best state
// so far; the iteration limit is one of evaluations.
class NloptBackend final : public LibraryBackend {
 public:
  NloptBackend(std::string name, nlopt_algorithm algorithm, const Parameters& parameters, bool small)
      : LibraryBackend(std::move(name)),
        algorithm_(algorithm),
        memory_(algorithm == NLOPT_LD_LBFGS ? static_cast<unsigned>(parameters.integer("memory")) : 0),
        most_variables_(small ? parameters.integer("most_variables") : 0) {}

 protected:
  std::string optimize(const ScaledObjective& objective) override {
    if (most_variables_ > 0 && objective.size() > most_variables_) {
      throw UsageError(
          fmt::format("nonlinear backend '{}' works with dense matrices: {} variables are more than the {} that its "
                      "parameter most_variables allows; choose another backend, or raise it (memory and time per "
                      "iteration grow with the square and the cube)",
                      report().backend, objective.size(), most_variables_));
    }
    using Handle = std::unique_ptr<nlopt_opt_s, decltype(&nlopt_destroy)>;
    const Handle opt(nlopt_create(algorithm_, static_cast<unsigned>(objective.size())), &nlopt_destroy);
    if (!opt) throw SolverError(fmt::format("nonlinear backend '{}': out of memory", report().backend));
    run_ = {.opt = opt.get(), .objective = &objective, .backend = this};
    Eigen::VectorXd x = objective.start();
    double f = 0.0;
    nlopt_set_min_objective(opt.get(), &NloptBackend::evaluate, this);
    // Some algorithms take 0 for their default, which ends early.
    nlopt_set_ftol_rel(opt.get(), kOff);
    nlopt_set_xtol_rel(opt.get(), kOff);
    if (memory_ > 0) nlopt_set_vector_storage(opt.get(), memory_);
    const nlopt_result result = nlopt_optimize(opt.get(), x.data(), &f);
    if (run_.error) std::rethrow_exception(run_.error);
    const char* text = nlopt_get_errmsg(opt.get());
    return fmt::format("NLopt {}{}{}", nlopt_result_to_string(result), text != nullptr ? ": " : "",
                       text != nullptr ? text : "");
  }

 private:
  static constexpr double kOff = 1e-300;
  // Value beyond a barrier: above that of the start, which is 1, and no more, as L-BFGS interpolates.
  static constexpr double kBeyond = 2.0;

  struct Run {
    nlopt_opt opt = nullptr;
    const ScaledObjective* objective = nullptr;
    NloptBackend* backend = nullptr;
    std::exception_ptr error = {};
    bool begun = false;
    double best = 0.0;
  };

  static double evaluate(unsigned n, const double* x, double* gradient, void* self) {
    return static_cast<NloptBackend*>(self)->evaluate(Eigen::Map<const Eigen::VectorXd>(x, n), gradient);
  }

  double evaluate(const Eigen::VectorXd& x, double* gradient) {
    Eigen::Map<Eigen::VectorXd> derivative(gradient, gradient != nullptr ? x.size() : 0);
    derivative.setZero();
    if (over() || run_.error) return kBeyond;  // L-BFGS ends its line search first
    try {
      const ScaledObjective& scaled = *run_.objective;
      const Matrix U = scaled.state(x);
      const EnergyValue energy = scaled.objective().value(U);
      const double f = scaled.value(energy);
      const bool finite = std::isfinite(f);
      Eigen::VectorXd by_variables;
      if (finite) {
        by_variables = scaled.objective().gradient(U);
        derivative = scaled.gradient(by_variables).head(derivative.size());
      }
      bool go_on = true;
      if (!run_.begun) {  // the start, row 0
        run_.begun = true;
        run_.best = f;
      } else if (finite && f < run_.best) {
        run_.best = f;
        go_on = reached(scaled, x, energy, by_variables);
      } else {
        go_on = stayed();
      }
      if (!go_on) nlopt_force_stop(run_.opt);
      return finite ? f : kBeyond;
    } catch (...) {
      run_.error = std::current_exception();
      nlopt_force_stop(run_.opt);
      return kBeyond;
    }
  }

  nlopt_algorithm algorithm_;
  unsigned memory_;
  std::int64_t most_variables_;
  Run run_;
};

}  // namespace
#endif

NonlinearBackendEntry nlopt_entry(NloptAlgorithm algorithm) {
  NonlinearBackendEntry entry;
  entry.package = "libnlopt-dev";
  entry.option = "VARIFORM_NLOPT";
  entry.licence = "LGPL-2.1-or-later";
  switch (algorithm) {
    case NloptAlgorithm::lbfgs:
      entry.name = "nlopt.lbfgs";
      entry.doc = "limited-memory BFGS of NLopt (Luksan); an iteration is an evaluation";
      entry.parameters = {{.name = "memory",
                           .value = std::int64_t{20},
                           .doc = "pairs of steps and gradients that are kept",
                           .min = 1.0,
                           .max = 1000.0}};
      break;
    case NloptAlgorithm::mma:
      entry.name = "nlopt.mma";
      entry.doc = "method of moving asymptotes of NLopt (Svanberg 2002); an iteration is an evaluation";
      break;
    case NloptAlgorithm::slsqp:
      entry.name = "nlopt.slsqp";
      entry.doc =
          "sequential quadratic programming with a dense BFGS matrix, of NLopt (Kraft 1994): small problems; an "
          "iteration is an evaluation";
      entry.parameters = {{.name = "most_variables",
                           .value = std::int64_t{1000},
                           .doc = "larger problems are refused",
                           .min = 1.0,
                           .max = 1e6}};
      break;
  }
#ifdef VARIFORM_WITH_NLOPT
  const nlopt_algorithm id = algorithm == NloptAlgorithm::lbfgs ? NLOPT_LD_LBFGS
                             : algorithm == NloptAlgorithm::mma ? NLOPT_LD_MMA
                                                                : NLOPT_LD_SLSQP;
  entry.make = [name = entry.name, id](const Parameters& p) {
    return std::make_unique<NloptBackend>(name, id, p, id == NLOPT_LD_SLSQP);
  };
#endif
  return entry;
}

}  // namespace variform
