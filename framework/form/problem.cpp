// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/base/stopwatch.h"

namespace variform {

Problem::Problem(const Domain& domain, const Energy& energy, const NormOptions& norm, Constraints constraints)
    : domain_(domain),
      energy_(energy),
      norm_(norm),
      traits_(energy.traits(domain)),
      constraints_(std::move(constraints)) {
  const Stopwatch watch;
  if (constraints_.vertex_count() != domain.vertex_count() || constraints_.dimension() != traits_.dimension()) {
    throw UsageError(
        fmt::format("problem: constraints on {} vertices in dimension {}, the energy has {} vertices in {}",
                    constraints_.vertex_count(), constraints_.dimension(), domain.vertex_count(), traits_.dimension()));
  }
  if (traits_.unknowns == 1 && constraints_.has_components()) {
    throw UsageError(
        "problem: the energy solves for each coordinate separately, with one matrix; vertices cannot be held in single "
        "components there");
  }
  terms_ = declare_terms();
  check_norm();
  times_.declare += watch.seconds();
}

void Problem::check_norm() const {
  EnergyTraits seen = traits_;
  seen.kernel = kernel();
  check_constraint_rank(domain_, constraints_, kernel_basis(seen, domain_), traits_.unknowns);
}

Kernel Problem::kernel() const {
  if (norm_.beta == 0.0 || terms_.size() == 1) return traits_.kernel;
  // Tikhonov regularization sees everything but constants.
  return tikhonov() ? Kernel::constants : blended_kernel(traits_, norm_.beta);
}

std::vector<Term> Problem::declare_terms() const {
  if (!(norm_.beta >= 0.0 && norm_.beta <= 1.0)) {
    throw UsageError(fmt::format("norm: beta = {}: expected a value in [0, 1)", norm_.beta));
  }
  std::vector<Term> terms;
  std::optional<Term> second = second_term();
  if (norm_.beta == 1.0 && (tikhonov() || !second)) {
    throw UsageError(
        "norm: beta = 1: expected a value in [0, 1); 1 is for energies that bring a regularizer of their own");
  }
  terms.push_back({energy_.declare(domain_), residual_norm(second.has_value())});
  if (second) terms.push_back(std::move(*second));
  return terms;
}

void Problem::set_beta(double beta) {
  if (beta == norm_.beta) return;
  const double before = norm_.beta;
  const Stopwatch watch;
  norm_.beta = beta;
  try {
    const bool own = terms_.size() > 1 && !tikhonov();
    if (!(beta >= 0.0 && (beta < 1.0 || (own && beta == 1.0)))) {
      throw UsageError(fmt::format("norm: beta = {}: expected a value in [0, 1{}", beta, own ? "]" : ")"));
    }
    check_norm();
  } catch (...) {
    norm_.beta = before;
    throw;
  }
  terms_.front().norm = residual_norm(terms_.size() > 1);
  if (terms_.size() > 1) terms_[1].norm = std::move(second_term()->norm);
  if ((beta == 0.0) != (before == 0.0)) {
    assembly_.reset();
    reduction_.reset();
  }
  matrix_stale_ = targets_stale_ = true;
  times_.declare += watch.seconds();
}

namespace {

// W_n where the energy has its residuals, transports included.
std::unique_ptr<Norm> norm_of(const Domain& domain, const Energy& energy, const EnergyTraits& traits,
                              const NormOptions& options) {
  if (traits.support == Support::vertices) return vertex_norm(domain, options);
  return cell_norm(domain, options, traits.gauge == Gauge::cell_frame ? energy.frames(domain) : Matrix());
}

}  // namespace

std::unique_ptr<Norm> Problem::residual_norm(bool blended) const {
  NormOptions options = norm_;
  if (blended) options.beta = 0.0;
  std::unique_ptr<Norm> norm = norm_of(domain_, energy_, traits_, options);
  return blended ? scaled_norm(std::move(norm), 1.0 - norm_.beta) : std::move(norm);
}

std::unique_ptr<Norm> Problem::variation_norm() const {
  const bool turned = traits_.gauge == Gauge::cell_frame;
  return variform::variation_norm(domain_, norm_, turned ? energy_.frames(domain_) : Matrix());
}

namespace {

// The gradient of the solution for one cell, vec F_t = H_t u_t.
void tikhonov_form(const Domain& domain, Form& form) {
  parallel_for(domain.cell_count(), [&](Index t) { vectorised_gradient(domain, t, form.unknowns(), form.block(t)); });
}

}  // namespace

std::optional<Term> Problem::second_term() const {
  const auto blended = [&](Term term) {
    term.norm = scaled_norm(std::move(term.norm), norm_.beta);
    return term;
  };
  if (!tikhonov()) {
    std::optional<Term> own = energy_.regularizer(domain_, norm_);
    if (!own) return std::nullopt;
    return blended(std::move(*own));
  }
  // Tikhonov: the gradient of the solution itself, int |grad u|^2.
  const int p = domain_.ambient_dimension();
  const int d = traits_.unknowns;
  Form form(domain_.vertex_count(), domain_.cells(), p * d, d, traits_.columns);
  tikhonov_form(domain_, form);
  return blended({std::move(form), cell_norm(domain_, {.beta = 0.0})});
}

void Problem::refresh_operator() {
  const Stopwatch watch;
  energy_.refresh_operator(domain_, terms_.front().form);
  if (traits_.gauge == Gauge::cell_frame) {
    terms_.front().norm = residual_norm(terms_.size() > 1);  // frames move with the cells, and the transports with them
  } else {
    terms_.front().norm->refresh(domain_);
  }
  if (terms_.size() > 1) {
    Term& second = terms_[1];
    if (tikhonov()) {
      tikhonov_form(domain_, second.form);
    } else {
      energy_.refresh_regularizer(domain_, second.form);
    }
    second.norm->refresh(domain_);
  }
  matrix_stale_ = targets_stale_ = true;
  target_state_.resize(0, 0);
  half_norm_.reset();
  times_.declare += watch.seconds();
}

Index Problem::refresh_target(const Matrix& U) {
  if (traits_.state == StateDependence::none) return 0;
  const Stopwatch watch;
  if (target_state_.size() != U.size() || target_state_ != U) {
    undefined_targets_ = energy_.refresh_target(domain_, U, terms_.front().form);
    target_state_ = U;
    targets_stale_ = true;
  }
  times_.declare += watch.seconds();
  return undefined_targets_;
}

void Problem::ensure_pattern() {
  if (assembly_) return;
  const Stopwatch watch;
  assembly_ = std::make_unique<Assembly>(terms_);
  reduction_ = std::make_unique<Reduction>(assembly_->matrix(), constraints_, traits_.unknowns);
  thinned_ = {};
  times_.pattern += watch.seconds();
}

void Problem::ensure_matrix() {
  ensure_pattern();
  if (!matrix_stale_) return;
  const Stopwatch watch;
  assembly_->refill(terms_);
  default_soft_weight_ = reduction_->refill(assembly_->matrix(), constraints_);
  matrix_stale_ = false;
  if (stacked_operator_.cols() > 0) stacked_operator_.resize(0, 0);
  factorized_in_ = 0;
  times_.refill += watch.seconds();
}

const SparseMatrix& Problem::normal_matrix() {
  ensure_matrix();
  return assembly_->matrix();
}

const Matrix& Problem::normal_right_hand_side() {
  ensure_matrix();
  if (targets_stale_) assembly_->refill_targets(terms_);
  targets_stale_ = false;
  return assembly_->right_hand_side();
}

const SparseMatrix& Problem::reduced_matrix() {
  ensure_matrix();
  return reduction_->matrix();
}

void Problem::hold(Index vertex, const Eigen::RowVectorXd& value) {
  if (vertex < 0 || vertex >= domain_.vertex_count() || value.size() != traits_.dimension() || !value.allFinite()) {
    throw UsageError(fmt::format("problem: hold vertex {} of {} at {} values: expected {} finite ones", vertex,
                                 domain_.vertex_count(), value.size(), traits_.dimension()));
  }
  ensure_pattern();
  const auto& identified = constraints_.identified();
  const bool seam = std::any_of(
      identified.begin(), identified.end(),
      [vertex](const Constraints::Identification& pair) { return pair.first == vertex || pair.second == vertex; });
  bool constrained = seam;
  for (int c = 0; c < traits_.unknowns; ++c) constrained = constrained || reduction_->row_of(vertex, c) < 0;
  if (constrained) {
    throw UsageError(fmt::format("problem: vertex {} cannot be held, a constraint fixes or identifies it", vertex));
  }
  held_[vertex] = value;
}

void Problem::release(Index vertex) {
  if (held_.erase(vertex) == 0) throw UsageError(fmt::format("problem: vertex {} is not held", vertex));
}

// Brings the factorization to the held vertices; a fresh one holds none.
void Problem::hold_in(LinearBackend& backend, bool fresh) {
  if (fresh) held_rows_.clear();
  std::set<Index> wanted;
  for (const auto& [vertex, value] : held_) {
    for (int c = 0; c < traits_.unknowns; ++c) wanted.insert(reduction_->row_of(vertex, c));
  }
  std::vector<Index> come;
  std::vector<Index> go;
  std::set_difference(wanted.begin(), wanted.end(), held_rows_.begin(), held_rows_.end(), std::back_inserter(come));
  std::set_difference(held_rows_.begin(), held_rows_.end(), wanted.begin(), wanted.end(), std::back_inserter(go));
  if (!come.empty()) backend.hold(come);
  held_rows_.insert(come.begin(), come.end());
  if (!go.empty()) backend.release(go);
  held_rows_ = std::move(wanted);
}

// What couples to held unknowns goes to the right-hand side, where they have their values themselves.
void Problem::move_held_to_right(const SparseMatrix& K, Eigen::MatrixXd& right_hand_side) const {
  const Eigen::Index columns = right_hand_side.cols();
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(K.rows(), columns);
  for (const auto& [vertex, value] : held_) {
    for (int c = 0; c < traits_.unknowns; ++c) {
      values.row(reduction_->row_of(vertex, c)) = value.segment(c * columns, columns);
    }
  }
  right_hand_side -= K.selfadjointView<Eigen::Lower>() * values;
  for (const Index row : held_rows_) right_hand_side.row(row) = values.row(row);
}

Matrix Problem::solve(LinearBackend& backend) {
  Matrix U;
  solve(backend, U);
  return U;
}

void Problem::solve(LinearBackend& backend, Matrix& U) {
  ensure_matrix();
  const bool least_squares = backend.capabilities().least_squares && !backend.capabilities().spd;
  if (least_squares && reduction_->indefinite()) {
    throw UsageError("linear equality constraints need a backend for indefinite systems, not a least-squares one");
  }
  // A backend that failed last, changing its factorization perhaps, starts anew.
  const bool factorize =
      factorized_in_ != backend.id() || factorization_ != backend.report().factorizations || !backend.report().ok;
  const auto advised = [&](const auto& phase) {
    try {
      phase();
    } catch (const SolverError& error) {
      if (norm_.beta > 0.0 || terms_.size() == 1 || tikhonov()) throw;
      throw SolverError(fmt::format(
          "{}; beta = 0 leaves out the energy's own regularizer, which holds motions that the constraints may leave "
          "free: take beta > 0",
          error.what()));
    }
  };
  const Eigen::Index columns = traits_.columns;
  Eigen::MatrixXd& right_hand_side = right_hand_side_;
  std::optional<SparseMatrix> stacked;
  if (least_squares) {
    // min |S E (Z y + x_fixed) - S c|, soft constraints as further rows.
    const Stopwatch watch;
    if (stacked_operator_.rows() == 0) stacked_operator_ = stacked_operator(terms_);
    const auto rows = static_cast<Index>(stacked_operator_.rows());
    const Index soft_rows = reduction_->soft_row_count(constraints_);
    right_hand_side = Eigen::MatrixXd::Zero(rows + soft_rows, columns);
    right_hand_side.topRows(rows) =
        stacked_targets(terms_) - stacked_operator_ * Eigen::MatrixXd(reduction_->fixed_part(constraints_, columns));
    std::vector<Eigen::Triplet<double, Index>> triplets;
    reduction_->append_soft_rows(constraints_, triplets, right_hand_side, rows);
    if (factorize) {
      const SparseMatrix reduced = stacked_operator_ * reduction_->elimination();
      triplets.reserve(triplets.size() + static_cast<std::size_t>(reduced.nonZeros()));
      for (Index j = 0; j < reduced.outerSize(); ++j) {
        for (SparseMatrix::InnerIterator it(reduced, j); it; ++it) {
          triplets.emplace_back(static_cast<Index>(it.row()), j, it.value());
        }
      }
      stacked.emplace(rows + soft_rows, reduced.cols());
      stacked->setFromTriplets(triplets.begin(), triplets.end());
    }
    times_.refill += watch.seconds();
  }
  if (factorize) {
    const int analyses = backend.report().analyses;
    if (least_squares) {
      advised([&] { backend.factorize(*stacked, MatrixKind::least_squares); });
    } else {
      // A general LU solves definite systems too.
      const bool definite = !reduction_->indefinite() && backend.capabilities().spd;
      const Stopwatch watch;
      const SparseMatrix& K = thinned_.refill(reduction_->matrix());
      times_.refill += watch.seconds();
      advised([&] { backend.factorize(K, definite ? MatrixKind::spd : MatrixKind::symmetric_indefinite); });
    }
    if (backend.report().analyses != analyses) times_.analyze += backend.report().analyze_seconds;
    times_.factorize += backend.report().factorize_seconds;
    factorized_in_ = backend.id();
    factorization_ = backend.report().factorizations;
  }
  const Stopwatch watch;
  if (!held_.empty() || !held_rows_.empty()) hold_in(backend, factorize);
  if (!least_squares) {
    reduction_->right_hand_side(assembly_->matrix(), normal_right_hand_side(), constraints_, right_hand_side);
  }
  if (!held_.empty()) move_held_to_right(reduction_->matrix(), right_hand_side);
  advised([&] { backend.solve(right_hand_side, solution_); });
  U.resize(domain_.vertex_count() * traits_.unknowns, columns);  // no new memory if it has vertex values already
  reduction_->expand(solution_, constraints_, U);
  U.resize(domain_.vertex_count(), traits_.dimension());  // the same memory: rows of vertices
  times_.solve += watch.seconds();
}

Matrix Problem::residual(const Matrix& U) const {
  const Form& form = terms_.front().form;
  return form.residual(as_unknowns(U, form));
}

const Norm& Problem::half_norm() const {
  if (!half_norm_) {
    NormOptions options = norm_;
    options.beta = 0.5;
    half_norm_ = norm_of(domain_, energy_, traits_, options);
  }
  return *half_norm_;
}

namespace {

// as_unknowns without a copy.
Eigen::Map<const Matrix> unknowns_of(const Matrix& U, const Form& form) {
  if (U.size() != static_cast<Eigen::Index>(form.unknown_count()) * form.columns()) {
    throw UsageError(fmt::format("problem: {} x {} vertex values do not fit {} unknowns in {} columns", U.rows(),
                                 U.cols(), form.unknown_count(), form.columns()));
  }
  return {U.data(), form.unknown_count(), form.columns()};
}

}  // namespace

EnergyValue Problem::value(const Matrix& U, bool variation) const {
  EnergyValue value;
  if (traits_.barrier && undefined_targets_ > 0) {
    value.total = value.plain = std::numeric_limits<double>::infinity();
    return value;
  }
  const Term& term = terms_.front();
  Matrix& R = residual_;
  if (const Vector* weights = term.norm->plain_weights();
      weights != nullptr && norm_.beta == 0.0 && !variation && terms_.size() == 1) {
    value.total = value.plain = term.form.squared_residual(unknowns_of(U, term.form), *weights);
    value.variation = std::nan("");
    add_penalty(U, value);
    return value;
  }
  term.form.residual(unknowns_of(U, term.form), R);
  value.plain = term.norm->plain_squared(R);
  if (terms_.size() > 1) {
    const Term& own = terms_[1];
    value.total = term.norm->squared(R);
    own.form.residual(unknowns_of(U, own.form), R);
    value.variation = own.norm->plain_squared(R);
    value.total += own.norm->squared(R);
  } else if (traits_.support == Support::cells && traits_.gauge == Gauge::world) {
    value.variation = residual_variation(domain_, norm_.facet_weight, R);
    value.total = (1.0 - norm_.beta) * value.plain + norm_.beta * value.variation;
  } else if (norm_.beta > 1e-3) {  // below, the difference is rounding
    value.total = term.norm->squared(R);
    value.variation = (value.total - (1.0 - norm_.beta) * value.plain) / norm_.beta;
  } else {
    value.total = term.norm->squared(R);
    value.variation = 2.0 * half_norm().squared(R) - value.plain;
  }
  add_penalty(U, value);
  return value;
}

void Problem::add_penalty(const Matrix& U, EnergyValue& value) const {
  for (const auto& soft : constraints_.soft()) {
    const double weight = soft.weight > 0.0 ? soft.weight : default_soft_weight_;
    value.penalty += weight * (U.row(soft.vertex) - soft.value).squaredNorm();
  }
}

Index Problem::couple_targets(const Matrix& U) {
  const auto* energy = dynamic_cast<const ProjectedEnergy*>(&energy_);
  if (energy == nullptr)
    throw UsageError(
        "coupled targets need an energy whose targets are projections: take newton or gauss_newton for others");
  Form& form = terms_.front().form;
  const Norm& norm = *terms_.front().norm;
  const int n = form.residuals();
  const int columns = form.columns();
  if (target_state_.size() == 0) refresh_target(U);  // there are none yet
  Matrix R = residual(U);
  std::vector<std::vector<Index>> links(norm.site_count());
  for (Index l = 0; l < norm.link_count(); ++l) {
    for (int side = 0; side < 2; ++side) links[norm.links()(l, side)].push_back(2 * l + side);
  }
  Index undefined = 0;
  // Terms of E that see c_t: W_tt |c_t - Y|^2 with Y = F_t + sum_s W_ts T_ts r_s / W_tt.
  for (Index t = 0; t < norm.site_count(); ++t) {
    Eigen::RowVectorXd pull = Eigen::RowVectorXd::Zero(R.cols());
    for (const Index entry : links[t]) {
      const Index l = entry / 2;
      const bool first = entry % 2 == 0;
      const Eigen::RowVectorXd r = R.row(norm.links()(l, first ? 1 : 0));
      if (norm.transports().size() == 0) {
        pull += norm.link_weights()[l] * r;
        continue;
      }
      const double c = norm.transports()(l, 0);
      const double s = first ? norm.transports()(l, 1) : -norm.transports()(l, 1);
      for (Eigen::Index i = 0; i + 1 < r.size(); i += 2) {
        pull[i] += norm.link_weights()[l] * (c * r[i] - s * r[i + 1]);
        pull[i + 1] += norm.link_weights()[l] * (s * r[i] + c * r[i + 1]);
      }
    }
    const TargetEnergy::SmallMatrix F = TargetEnergy::value(form, t, U);
    const Eigen::MatrixXd Y = F + Eigen::Map<const Eigen::MatrixXd>(pull.data(), n, columns) / norm.diagonal()[t];
    if (!energy->target_of(domain_, t, Y, form.target(t), nullptr)) ++undefined;
    Eigen::Map<Eigen::MatrixXd>(R.row(t).data(), n, columns) = F - form.target(t);
  }
  target_state_ = Matrix::Constant(1, 1, 0.0);  // of no state
  targets_stale_ = true;
  return undefined;
}

}  // namespace variform
