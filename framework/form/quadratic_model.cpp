// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/quadratic_model.h"

#include <fmt/format.h>

#include <algorithm>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"
#include "framework/form/problem.h"

namespace variform {

QuadraticModel::QuadraticModel(Problem& problem, const char* name)
    : problem_(problem), name_(name), energy_(dynamic_cast<const TargetEnergy*>(&problem.energy())) {
  if (energy_ == nullptr) {
    throw UsageError(fmt::format(
        "{} needs an energy whose targets are a function of the cells' values; this one is linear or has others",
        name));
  }
}

QuadraticModel::~QuadraticModel() = default;

ProblemTimes& QuadraticModel::times() const { return problem_.times_; }

void QuadraticModel::add_linear_terms(std::vector<Term> declared) {
  for (std::size_t i = 1; i < declared.size(); ++i) {
    const Form& form = declared[i].form;
    terms_.push_back({coupled_form(form, form.residuals() * form.columns()), std::move(declared[i].norm)});
    for (Index s = 0; s < form.site_count(); ++s) couple_block(form, s, terms_.back().form.block(s));
  }
}

Form QuadraticModel::coupled_form(const Form& form, int residuals) {
  const int size = form.site_count() > 0 ? form.site_size(0) : 0;
  IndexMatrix nodes(form.site_count(), size);
  for (Index s = 0; s < form.site_count(); ++s) {
    if (form.site_size(s) != size) throw UsageError("a quadratic model: all sites of a term must have the same size");
    for (int i = 0; i < size; ++i) nodes(s, i) = form.node(s, i);
  }
  return {form.node_count(), nodes, residuals, form.unknowns() * form.columns(), 1};
}

void QuadraticModel::couple_block(const Form& form, Index s, Eigen::Ref<Eigen::MatrixXd> block) {
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

Constraints QuadraticModel::constraints_at(const Matrix& U) {
  const Constraints& constraints = problem_.constraints();
  const double slack = 1e-9 * problem_.domain().diameter();
  Constraints at(constraints.vertex_count(), constraints.dimension());
  const Eigen::RowVectorXd zero = Eigen::RowVectorXd::Zero(constraints.dimension());
  const auto require = [&](const Eigen::RowVectorXd& error, Index vertex) {
    if (error.size() > 0 && error.cwiseAbs().maxCoeff() > slack) {
      throw UsageError(fmt::format(
          "{} starts from a state that satisfies the hard constraints; vertex {} is {:.3g} away from its own", name_,
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

void QuadraticModel::refill(const Constraints& constraints) {
  Stopwatch watch;
  if (!assembly_) {
    assembly_ = std::make_unique<Assembly>(terms_);
    reduction_ = std::make_unique<Reduction>(assembly_->matrix(), constraints, terms_.front().form.unknowns());
    times().pattern += watch.restart();
  }
  assembly_->refill(terms_);
  reduction_->refill(assembly_->matrix(), constraints);
  times().refill += watch.restart();
}

Direction QuadraticModel::minimizer(const Constraints& constraints, const Matrix& b, double damping,
                                    LinearBackend& backend) {
  Stopwatch watch;
  const SparseMatrix& K = reduction_->matrix();
  if (damped_.nonZeros() != K.nonZeros()) damped_ = K;
  std::copy_n(K.valuePtr(), K.nonZeros(), damped_.valuePtr());
  const Index free = reduction_->free_count();
  double trace = 0.0;
  // The diagonal entry of a column comes first.
  for (Index i = 0; i < free; ++i) trace += K.valuePtr()[K.outerIndexPtr()[i]];
  const double shift = free > 0 ? damping * trace / free : 0.0;
  for (Index i = 0; i < free; ++i) damped_.valuePtr()[damped_.outerIndexPtr()[i]] += shift;
  times().refill += watch.restart();
  // A general LU solves definite systems too.
  const bool definite = !reduction_->indefinite() && backend.capabilities().spd;
  const int analyses = backend.report().analyses;
  backend.factorize(damped_, definite ? MatrixKind::spd : MatrixKind::symmetric_indefinite);
  if (backend.report().analyses != analyses) times().analyze += backend.report().analyze_seconds;
  times().factorize += backend.report().factorize_seconds;
  watch.restart();
  const Eigen::MatrixXd right = reduction_->right_hand_side(assembly_->matrix(), b, constraints);
  const Eigen::MatrixXd y = backend.solve(right);
  Direction direction;
  direction.slope = -2.0 * right.col(0).head(free).dot(y.col(0).head(free));
  direction.step = as_vertex_values(reduction_->expand(y, constraints, 1), terms_.front().form);
  times().solve += watch.restart();
  return direction;
}

}  // namespace variform
