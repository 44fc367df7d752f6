// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/linearized_problem.h"

#include <fmt/format.h>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/base/stopwatch.h"
#include "framework/form/problem.h"

namespace variform {
namespace {

// (I (x) E_s) with the columns of u coupled: rows are vec(r_s), columns the d values of one node after the other.
void couple_block(const Form& form, Index s, Eigen::Ref<Eigen::MatrixXd> block) {
  const auto E = form.block(s);
  const int n = form.residuals();
  const int unknowns = form.unknowns();
  const int columns = form.columns();
  block.setZero();
  for (int i = 0; i < form.site_size(s); ++i) {
    for (int k = 0; k < unknowns; ++k) {
      for (int j = 0; j < columns; ++j) {
        block.block(j * n, (i * unknowns + k) * columns + j, n, 1) = E.col(i * unknowns + k);
      }
    }
  }
}

Form coupled_form(const Form& form) {
  const int size = form.site_count() > 0 ? form.site_size(0) : 0;
  IndexMatrix nodes(form.site_count(), size);
  for (Index s = 0; s < form.site_count(); ++s) {
    if (form.site_size(s) != size) throw UsageError("Gauss-Newton: all sites of a term must have the same size");
    for (int i = 0; i < size; ++i) nodes(s, i) = form.node(s, i);
  }
  return {form.node_count(), nodes, form.residuals() * form.columns(), form.unknowns() * form.columns(), 1};
}

}  // namespace

LinearizedProblem::LinearizedProblem(Problem& problem) : problem_(problem) {
  if (dynamic_cast<const ProjectedEnergy*>(&problem.energy()) == nullptr) {
    throw UsageError("Gauss-Newton needs an energy whose targets are projections; this one is linear or has others");
  }
  for (Term& term : problem.declare_terms()) terms_.push_back({coupled_form(term.form), std::move(term.norm)});
  // Terms that do not depend on the state keep their operator.
  for (std::size_t i = 1; i < terms_.size(); ++i) {
    for (Index s = 0; s < terms_[i].form.site_count(); ++s) {
      couple_block(problem.terms()[i].form, s, terms_[i].form.block(s));
    }
  }
}

LinearizedProblem::~LinearizedProblem() = default;

void LinearizedProblem::linearize(const Matrix& U) {
  const auto& energy = dynamic_cast<const ProjectedEnergy&>(problem_.energy());
  const Form& form = problem_.terms().front().form;
  Form& linear = terms_.front().form;
  const int size = linear.residuals();
  parallel_for(form.site_count(), [&](Index t) {
    const ProjectedEnergy::SmallMatrix Y = ProjectedEnergy::value(form, t, U);
    ProjectedEnergy::SmallMatrix c = form.target(t);
    ProjectedEnergy::SmallMatrix D(size, size);
    energy.closest_target(problem_.domain(), t, Y, c, &D);
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
  const auto& energy = dynamic_cast<const ProjectedEnergy&>(problem_.energy());
  Matrix G;
  for (const Term& term : problem_.terms()) {
    const Form& form = term.form;
    const int n = form.residuals();
    const int u = form.unknowns();
    Matrix weighted = term.norm->apply(form.residual(as_unknowns(U, form)));
    if (G.size() == 0) {
      // r = Y - c(Y): by Y first.
      parallel_for(form.site_count(), [&](Index t) {
        const ProjectedEnergy::SmallMatrix Y = ProjectedEnergy::value(form, t, U);
        ProjectedEnergy::SmallMatrix c = form.target(t);
        ProjectedEnergy::SmallMatrix D(weighted.cols(), weighted.cols());
        energy.closest_target(problem_.domain(), t, Y, c, &D);
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

Constraints LinearizedProblem::constraints_at(const Matrix& U) {
  const Constraints& constraints = problem_.constraints();
  const double slack = 1e-9 * problem_.domain().diameter();
  Constraints at(constraints.vertex_count(), constraints.dimension());
  const Eigen::RowVectorXd zero = Eigen::RowVectorXd::Zero(constraints.dimension());
  const auto require = [&](const Eigen::RowVectorXd& error, Index vertex) {
    if (error.size() > 0 && error.cwiseAbs().maxCoeff() > slack) {
      throw UsageError(
          fmt::format("Gauss-Newton starts from a state that satisfies the hard constraints; vertex {} is "
                      "{:.3g} away from its own",
                      vertex, error.norm()));
    }
  };
  for (const auto& fixed : constraints.fixed()) {
    require(U.row(fixed.vertex) - fixed.value, fixed.vertex);
    at.fix(fixed.vertex, zero);
  }
  for (const auto& pair : constraints.identified()) {
    require(U.row(pair.first) - U.row(pair.second), pair.first);
    at.identify(pair.first, pair.second);
  }
  for (const auto& equality : constraints.equalities()) {
    Eigen::RowVectorXd error = -equality.value;
    for (std::size_t i = 0; i < equality.vertices.size(); ++i) {
      error += equality.weights[i] * U.row(equality.vertices[i]);
    }
    require(error, equality.vertices.front());
    at.combine(equality.vertices, equality.weights, zero);
  }
  if (!constraints.soft().empty()) problem_.reduced_matrix();  // fills in the default weight
  for (const auto& soft : constraints.soft()) {
    at.attract(soft.vertex, soft.value - U.row(soft.vertex),
               soft.weight > 0.0 ? soft.weight : problem_.default_soft_weight());
  }
  return at;
}

Direction LinearizedProblem::direction(const Matrix& U, double damping, LinearBackend& backend) {
  ProblemTimes& times = problem_.times_;
  Stopwatch watch;
  linearize(U);
  const Constraints constraints = constraints_at(U);
  times.declare += watch.restart();
  const int d = terms_.front().form.unknowns();
  if (!assembly_) {
    assembly_ = std::make_unique<Assembly>(terms_);
    reduction_ = std::make_unique<Reduction>(assembly_->matrix(), constraints, d);
    times.pattern += watch.restart();
  }
  assembly_->refill(terms_);
  assembly_->refill_targets(terms_);
  reduction_->refill(assembly_->matrix(), constraints);
  const Index free = reduction_->free_count();
  SparseMatrix K = reduction_->matrix();
  const double shift = free > 0 ? damping * Vector(K.diagonal()).head(free).mean() : 0.0;
  for (Index i = 0; i < free; ++i) K.coeffRef(i, i) += shift;
  times.refill += watch.restart();
  // A general LU solves definite systems too.
  const bool definite = !reduction_->indefinite() && backend.capabilities().spd;
  const int analyses = backend.report().analyses;
  backend.factorize(K, definite ? MatrixKind::spd : MatrixKind::symmetric_indefinite);
  if (backend.report().analyses != analyses) times.analyze += backend.report().analyze_seconds;
  times.factorize += backend.report().factorize_seconds;
  watch.restart();
  const Eigen::MatrixXd b = reduction_->right_hand_side(assembly_->matrix(), assembly_->right_hand_side(), constraints);
  const Eigen::MatrixXd y = backend.solve(b);
  Direction direction;
  direction.slope = -2.0 * b.col(0).head(free).dot(y.col(0).head(free));
  direction.step = as_vertex_values(reduction_->expand(y, constraints, 1), terms_.front().form);
  times.solve += watch.restart();
  return direction;
}

}  // namespace variform
