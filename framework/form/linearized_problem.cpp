// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/linearized_problem.h"

#include "framework/base/parallel.h"
#include "framework/base/stopwatch.h"
#include "framework/form/problem.h"

namespace variform {

LinearizedProblem::LinearizedProblem(Problem& problem) : QuadraticModel(problem, "Gauss-Newton") {}

void LinearizedProblem::declare() {
  std::vector<Term> terms = problem_.declare_terms();
  const Form& form = terms.front().form;
  terms_.push_back({coupled_form(form, form.residuals() * form.columns()), std::move(terms.front().norm)});
  add_linear_terms(std::move(terms));
}

void LinearizedProblem::linearize(const Matrix& U) {
  if (terms_.empty()) declare();  // the gradient alone goes without these blocks
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

Matrix LinearizedProblem::gradient(const Matrix& U) const {
  Matrix G;
  for (const Term& term : problem_.terms()) {
    const Form& form = term.form;
    const int n = form.residuals();
    const int u = form.unknowns();
    Matrix weighted = term.norm->apply(form.residual(as_unknowns(U, form)));
    if (G.size() == 0) {
      // r = Y - c(Y): by Y first.
      parallel_for(form.site_count(), [&](Index t) {
        const TargetEnergy::SmallMatrix Y = TargetEnergy::value(form, t, U);
        TargetEnergy::SmallMatrix c = form.target(t);
        TargetEnergy::SmallMatrix D(weighted.cols(), weighted.cols());
        energy().target_of(problem_.domain(), t, Y, c, &D);
        weighted.row(t) -= (weighted.row(t) * D).eval();
      });
      G = Matrix::Zero(form.unknown_count(), form.columns());
    }
    for (Index s = 0; s < form.site_count(); ++s) {
      const Eigen::Map<const Eigen::MatrixXd> r(weighted.row(s).data(), n, form.columns());
      const auto E = form.block(s);
      for (int i = 0; i < form.site_size(s); ++i) {
        G.middleRows(form.node(s, i) * u, u).noalias() += 2.0 * E.middleCols(i * u, u).transpose() * r;
      }
    }
  }
  return as_vertex_values(G, problem_.terms().front().form);
}

LeastSquares LinearizedProblem::least_squares(const Matrix& U) {
  linearize(U);
  return {.jacobian = stacked_operator(terms_), .residual = -stacked_targets(terms_)};
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
