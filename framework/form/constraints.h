// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/domain.h"

namespace variform {

/// Constraints on vertex values U (|V| x d), whatever the energy. Adding one checks it; all throw DataError naming the
/// vertex for indices out of range, values that are not finite or have another dimension, and contradictions.
class Constraints {
 public:
  struct Value {
    Index vertex;
    Eigen::RowVectorXd value;
    double weight = 0.0;             ///< soft only; 0: the default weight
    std::vector<bool> components{};  ///< fixed only: which are held; empty: all

    bool holds(int component) const { return components.empty() || components[component]; }
  };
  struct Equality {
    std::vector<Index> vertices;
    std::vector<double> weights;
    Eigen::RowVectorXd value;
  };
  struct Identification {
    Index first;
    Index second;
  };

  Constraints(Index vertex_count, int dimension) : vertex_count_(vertex_count), dimension_(dimension) {}

  /// Hard: u_vertex = value exactly (eliminated). The same value twice is no error; another value is.
  void fix(Index vertex, const Eigen::RowVectorXd& value);
  /// Hard: holds only the components that are marked, one flag per component, at least one of them set; the others stay
  /// free (a roller), and the entries of value there are of no meaning, but finite. A vertex that is fixed already must
  /// have the same marks and values. For energies that solve for all coordinates of a vertex together.
  void fix(Index vertex, const Eigen::RowVectorXd& value, const std::vector<bool>& components);
  /// Soft: adds weight |u_vertex - value|^2. Weight 0 asks for the default of Problem, 1e3 times the mean diagonal
  /// entry of the matrix. Throws DataError for negative weights.
  void attract(Index vertex, const Eigen::RowVectorXd& value, double weight = 0.0);
  /// Hard: u_first = u_second (a seam); eliminated, so that the system stays definite.
  void identify(Index first, Index second);
  /// Hard: sum_i weights_i u_{vertices_i} = value, for example a point on a cell by barycentric weights. Enforced by
  /// Lagrange multipliers: the system becomes indefinite.
  void combine(const std::vector<Index>& vertices, const std::vector<double>& weights, const Eigen::RowVectorXd& value);

  Index vertex_count() const { return vertex_count_; }
  int dimension() const { return dimension_; }
  const std::vector<Value>& fixed() const { return fixed_; }
  const std::vector<Value>& soft() const { return soft_; }
  const std::vector<Identification>& identified() const { return identified_; }
  const std::vector<Equality>& equalities() const { return equalities_; }

  /// Whether some vertex is held in single components.
  bool has_components() const { return has_components_; }

  /// New values for the hard constraints, in the order of fixed(); the set of vertices and components stays.
  void set_fixed_values(const Matrix& values);
  /// New values for the soft constraints, in the order of soft().
  void set_soft_values(const Matrix& values);
  /// New values for the linear equalities, in the order of equalities(); vertices and weights stay.
  void set_equality_values(const Matrix& values);

 private:
  void check_vertex(Index vertex) const;
  void check_value(Index vertex, const Eigen::Ref<const Eigen::RowVectorXd>& value) const;

  Index vertex_count_;
  int dimension_;
  std::vector<Value> fixed_;
  std::vector<Index> fixed_index_;  // vertex -> position in fixed_, -1
  bool has_components_ = false;
  std::vector<Value> soft_;
  std::vector<Identification> identified_;
  std::vector<Equality> equalities_;
};

/// The state closest to U (|V| x d) that satisfies the hard constraints: fixed values put in, and the smallest change
/// for identifications and linear equalities. Where nonlinear backends start. Throws SolverError when these contradict
/// each other.
Matrix closest_feasible(const Constraints& constraints, const Matrix& U);

/// Elimination of the hard constraints from H (lower triangle): x = Z y + x_fixed with one y per group of identified
/// unknowns, K = Z'HZ, and one multiplier row per linear equality. Where the entries of H go, in K or to the right-hand
/// side, is computed once per pattern: refill() only moves values, most of them in long runs, in parallel (same bits on
/// any number of threads) and without allocation.
class Reduction {
 public:
  /// unknowns per vertex (1 or d): whether the columns of U are solved for together. Throws DataError when identified
  /// vertices are fixed at different values (so do the functions that use the values, which may have changed),
  /// UsageError for vertices held in single components where the columns are not solved for together.
  Reduction(const SparseMatrix& H, const Constraints& constraints, int unknowns);

  /// Unknowns left to solve for, without multipliers.
  Index free_count() const { return free_count_; }
  /// True when there are multiplier rows: K is symmetric indefinite, else positive definite.
  bool indefinite() const { return multiplier_count_ > 0; }

  /// Row of K for component c (below unknowns per vertex) of a vertex; -1: fixed.
  Index row_of(Index vertex, int c) const { return target_[vertex * unknowns_ + c]; }

  /// Values of K from those of H, soft constraints added; returns the default soft weight that was used.
  double refill(const SparseMatrix& H, const Constraints& constraints);
  /// K, lower triangle.
  const SparseMatrix& matrix() const { return matrix_; }

  /// Right-hand side for g (unknown_count x columns) and the current values of the constraints.
  Eigen::MatrixXd right_hand_side(const SparseMatrix& H, const Matrix& g, const Constraints& constraints) const;
  /// The same in place; allocates nothing when called again with the same sizes.
  void right_hand_side(const SparseMatrix& H, const Matrix& g, const Constraints& constraints,
                       Eigen::MatrixXd& result) const;
  /// Unknowns X (unknown_count x columns) from the solution of K Y = rhs.
  Matrix expand(const Eigen::MatrixXd& Y, const Constraints& constraints, Eigen::Index columns) const;
  /// The same in place: X has its size.
  void expand(const Eigen::MatrixXd& Y, const Constraints& constraints, Matrix& X) const;

  /// Z as a sparse matrix (unknown_count x free_count): for least-squares backends.
  SparseMatrix elimination() const;
  /// The values of fixed unknowns, 0 elsewhere: unknown_count x columns.
  Matrix fixed_part(const Constraints& constraints, Eigen::Index columns) const;
  /// Soft constraints as rows of a least-squares problem: sqrt(w) (selection of y, value).
  void append_soft_rows(const Constraints& constraints, std::vector<Eigen::Triplet<double, Index>>& triplets,
                        Eigen::MatrixXd& right_hand_side, Index first_row) const;
  Index soft_row_count(const Constraints& constraints) const;

 private:
  void check_fixed_pairs(const Constraints& constraints) const;
  void set_fixed_part(const Constraints& constraints, Matrix& X) const;  // other rows stay
  double soft_weight(const Constraints::Value& soft) const { return soft.weight > 0.0 ? soft.weight : default_weight_; }

  // Consecutive entries of H that become consecutive entries of K.
  struct Run {
    Index source;
    Index target;
    Index count;
  };
  // An entry of H that adds to one of K: unknowns are identified.
  struct Addition {
    Index source;
    Index target;
  };
  // An entry of H between a free and a fixed unknown.
  struct Coupling {
    Index entry;
    Index row;  // of K
    Index fixed;
  };

  // An unknown and the constraint that fixes it; component: of the value, -1 for all (one unknown per vertex).
  struct FixedUnknown {
    Index unknown;
    Index constraint;
    int component;
  };
  // Constraints that fix the same unknown of identified vertices.
  struct FixedPair {
    Index first;
    Index second;
    int component;
  };

  int unknowns_;
  Index unknown_count_;
  Index free_count_ = 0;
  Index multiplier_count_ = 0;
  double default_weight_ = 0.0;
  IndexVector target_;  // unknown -> y, or -1 when fixed
  std::vector<FixedUnknown> fixed_unknowns_;
  std::vector<FixedPair> fixed_pairs_;
  mutable Matrix fixed_values_;  // scratch of right_hand_side: unknown_count x columns
  std::vector<Run> runs_;
  std::vector<Addition> additions_;
  std::vector<Coupling> couplings_;
  IndexVector diagonal_entry_;  // y -> entry of its diagonal in K
  SparseMatrix matrix_;
  std::vector<std::pair<Index, double>> multiplier_entries_;  // constant entries of the equality rows
};

/// Checks that the constraints hold every motion that an energy does not see: each facet-connected component of the
/// domain may move by its own combination of the kernel's fields, vertices shared by components and identified vertices
/// move alike, linear equalities hold one combination. Throws DataError naming the first component that could still
/// move, with the rank found there and the rank needed. kernel: (unknowns |V|) x dim, a basis; no columns: nothing to
/// check.
void check_constraint_rank(const Domain& domain, const Constraints& constraints, const Eigen::MatrixXd& kernel,
                           int unknowns);

}  // namespace variform
