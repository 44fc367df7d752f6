// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "framework/form/assembly.h"
#include "framework/form/constraints.h"
#include "framework/form/energy.h"
#include "framework/form/norm.h"
#include "framework/form/thinned_matrix.h"
#include "framework/solver/linear_backend.h"
#include "framework/solver/nonlinear_backend.h"

namespace variform {

/// Seconds spent in each phase of a problem, summed over all calls.
struct ProblemTimes {
  double pattern = 0.0;    ///< connectivity: pattern and places of all blocks, elimination map
  double declare = 0.0;    ///< values of E, c and W
  double refill = 0.0;     ///< values of H and of the eliminated matrix
  double analyze = 0.0;    ///< symbolic analysis
  double factorize = 0.0;  ///< numeric factorization
  double solve = 0.0;      ///< right-hand sides and solves
};

/// A form, a norm and constraints: min over u of ||E u - c||^2_W subject to the constraints.
///
///   Problem problem(domain, *energy, {.beta = 0.3}, constraints);
///   auto backend = make_linear_backend("auto");
///   Matrix U = problem.solve(*backend);   // for the current (E, c)
///
/// A linear energy is done then. One whose targets depend on u is minimized by a nonlinear backend through
/// ProblemObjective. Numeric factorization happens only when E, W or the set of constraints changed.
class Problem {
 public:
  /// The domain and energy must outlive the problem. Throws UsageError for energies that do not fit the domain, beta
  /// out of range and vertices held in single components where the coordinates are solved for separately, DataError
  /// when the constraints leave part of the energy's kernel free.
  Problem(const Domain& domain, const Energy& energy, const NormOptions& norm, Constraints constraints);

  const EnergyTraits& traits() const { return traits_; }
  /// The motions that the regularized energy does not see, for the current beta; what the constraints must hold.
  Kernel kernel() const;
  const Domain& domain() const { return domain_; }
  const Constraints& constraints() const { return constraints_; }
  /// New values for the hard constraints, same vertices, and for linear equalities, same weights, as the functions of
  /// Constraints; no new factorization.
  void set_fixed_values(const Matrix& values) { constraints_.set_fixed_values(values); }
  void set_soft_values(const Matrix& values) { constraints_.set_soft_values(values); }
  void set_equality_values(const Matrix& values) { constraints_.set_equality_values(values); }

  /// Holds a vertex at a value, or lets it go again: a handle that comes, moves or goes without a new factorization,
  /// for solve() with a backend that can update its own (LinearCapabilities::update). The vertex must be free in the
  /// constraints; a second call moves it. Everything but solve(), nonlinear backends that linearize among it, goes on
  /// with the constraints alone. Throws UsageError for a vertex that is not there or not free, values that do not fit,
  /// and a vertex to be released that is not held.
  void hold(Index vertex, const Eigen::RowVectorXd& value);
  void release(Index vertex);

  /// The energy's term first, then its own regularizer if it has one.
  const std::vector<Term>& terms() const { return terms_; }
  /// The same declared anew.
  std::vector<Term> declare_terms() const;
  const Energy& energy() const { return energy_; }

  /// Another weight of the regularization. The pattern and what was analyzed on it are kept, unless beta changes from
  /// or to 0, where the facets' couplings come or go. Throws as the constructor.
  void set_beta(double beta);
  double beta() const { return norm_.beta; }

  /// Re-declares E, W and the regularizers after the positions of the domain changed, in place.
  void refresh_operator();
  /// Re-declares c for the state U; returns how many sites kept their target because it is undefined there. Does
  /// nothing when c is of this state already.
  Index refresh_target(const Matrix& U);

  /// One sweep over the cells that gives each target the value that minimizes ||E U - c||^2_W with all others held
  /// (methods: coupled local step, sec. 4.4). Returns how many kept theirs because it is undefined. Throws UsageError
  /// unless the energy is a ProjectedEnergy.
  Index couple_targets(const Matrix& U);

  /// Minimizer for the current (E, c): |V| x d. Factorizes when needed; a least-squares backend gets the stacked form.
  /// Throws SolverError as LinearBackend does.
  Matrix solve(LinearBackend& backend);
  /// The same into a matrix of the caller. With refresh_operator, set_fixed_values and set_equality_values it allocates
  /// nothing from the second call on, but in the library behind the backend: a field evaluation on a shape that moves
  /// is free of it. (Not so for least-squares backends, handles held by hold(), residuals on vertices and in cell
  /// frames.)
  void solve(LinearBackend& backend, Matrix& U);

  /// E, E_P, E_R and the penalty of soft constraints at U with the current targets. Without `variation`, E_R is NaN
  /// where beta = 0 leaves it out of E: it costs more than all else. E and E_P are infinite when the targets are of a
  /// state beyond a barrier.
  EnergyValue value(const Matrix& U, bool variation = true) const;
  /// r(U) with the current targets, sites x (n columns).
  Matrix residual(const Matrix& U) const;

  /// H (lower triangle) and g of the unconstrained normal equations, filled for the current (E, c).
  const SparseMatrix& normal_matrix();
  const Matrix& normal_right_hand_side();
  /// H with the constraints eliminated: the matrix that is factorized, but for entries that cancel (ThinnedMatrix).
  const SparseMatrix& reduced_matrix();
  /// The soft-constraint weight used where none was given; 0 before the matrix was filled.
  double default_soft_weight() const { return default_soft_weight_; }

  const ProblemTimes& times() const { return times_; }

 private:
  friend class QuadraticModel;  // its phases count, too
  friend class NewtonModel;
  // The norm of the energy's term: W_n, or (1-beta) times the plain one when another term is blended in.
  std::unique_ptr<Norm> residual_norm(bool blended) const;
  // The second term: the energy's own regularizer, or Tikhonov's, its norm times beta.
  std::optional<Term> second_term() const;
  bool tikhonov() const { return norm_.regularizer == Regularizer::tikhonov; }
  // The part of W_n that beta weighs.
  std::unique_ptr<Norm> variation_norm() const;
  void check_norm() const;
  const Norm& half_norm() const;  // tells E_R where beta = 0 leaves it out
  void add_penalty(const Matrix& U, EnergyValue& value) const;
  void ensure_pattern();
  void ensure_matrix();
  void hold_in(LinearBackend& backend, bool fresh);
  void move_held_to_right(const SparseMatrix& K, Eigen::MatrixXd& right_hand_side) const;

  const Domain& domain_;
  const Energy& energy_;
  NormOptions norm_;
  EnergyTraits traits_;
  Constraints constraints_;
  std::vector<Term> terms_;
  std::unique_ptr<Assembly> assembly_;
  std::unique_ptr<Reduction> reduction_;
  ThinnedMatrix thinned_;
  bool matrix_stale_ = true;
  SparseMatrix stacked_operator_;  // for least-squares backends; empty: stale or never asked for
  bool targets_stale_ = true;
  Matrix target_state_;  // that c is declared for; empty: none
  Index undefined_targets_ = 0;
  std::uint64_t factorized_in_ = 0;  // id of the backend; 0: none
  int factorization_ = -1;           // of that backend: another user may have factorized something else since
  double default_soft_weight_ = 0.0;
  std::map<Index, Eigen::RowVectorXd> held_;  // vertices and their values
  std::set<Index> held_rows_;                 // of K, in factorized_in_
  Eigen::MatrixXd right_hand_side_;           // scratch of solve()
  Eigen::MatrixXd solution_;
  mutable Matrix residual_;                  // scratch of value()
  mutable std::unique_ptr<Norm> half_norm_;  // W_n at beta = 1/2, see half_norm()
  ProblemTimes times_;
};

}  // namespace variform
