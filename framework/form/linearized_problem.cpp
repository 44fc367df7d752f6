// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/linearized_problem.h"

#include "framework/base/parallel.h"
#include "framework/base/stopwatch.h"
#include "framework/form/problem.h"

namespace variform {

LinearizedProblem::LinearizedProblem(Problem& problem) : QuadraticModel(problem, "Gauss-Newton") {
  std::vector<Term> terms = problem.declare_terms();
  const Form& form = terms.front().form;
  terms_.push_back({coupled_form(form, form.residuals() * form.columns()), std::move(terms.front().norm)});
  add_linear_terms(std::move(terms));
}

void LinearizedProblem::linearize(const Matrix& U) {
  const Form& form = problem_.terms().front().form;
  Form& linear = terms_.front().form;
  const int size = linear.residuals();
  parallel_for(form.site_count(), [&](Index t) {
    const TargetEnergy::SmallMatrix Y = TargetEnergy::value(form, t, U);
    TargetEnergy::SmallMatrix c = form.target(t);
    TargetEnergy::SmallMatrix D(size, size);
    energy().target_of(problem_.domain(), t, Y, c, &D);
    // The targets of the problem: where undefined, the last ones.
    linear.target(t) = Eigen::Map<const Eigen::VectorXd>(form.target_data(t), size) -
                       Eigen::Map<const Eigen::VectorXd>(Y.data(), size);
    auto J = linear.block(t);
    couple_block(form, t, J);
    J -= (D * J).eval();
  });
  for (std::size_t i = 1; i < terms_.size(); ++i) {
    const Form& own = problem_.terms()[i].form;
    const Matrix R = own.residual(as_unknowns(U, own));
    for (Index s = 0; s < own.site_count(); ++s) terms_[i].form.target(s) = -R.row(s).transpose();
  }
}

Direction LinearizedProblem::direction(const Matrix& U, double damping, LinearBackend& backend) {
  const Stopwatch watch;
  linearize(U);
  const Constraints constraints = constraints_at(U);
  times().declare += watch.seconds();
  refill(constraints);
  assembly_->refill_targets(terms_);
  return minimizer(constraints, assembly_->right_hand_side(), damping, backend);
}

}  // namespace variform
