// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "framework/base/types.h"
#include "framework/form/form.h"
#include "framework/form/norm.h"

namespace variform {

/// One summand ||E u - c||^2_W of a problem. The terms of a problem share nodes, unknowns and columns; sites, residuals
/// and norms are their own.
struct Term {
  Form form;
  std::unique_ptr<Norm> norm;
};

/// The normal equations of a sum of terms, H = sum E' W E (lower triangle) and g = sum E' W c.
///
/// E'WE is a sum over pairs of sites that W couples, W_st E_s' T_st E_t: cells with themselves and with their
/// neighbours. The sparsity pattern and the place of every block in it are computed once, from connectivity alone; then
/// refill() writes values in place: parallel over nodes, each owning its columns, so there are no write conflicts, the
/// sums have a fixed order (same bits on any number of threads), and nothing is allocated.
///
///   Assembly assembly(terms);           // once per connectivity
///   assembly.refill(terms);             // whenever E or W changed
///   assembly.refill_targets(terms);     // whenever c (or E or W) changed
///
/// Source: Martinez Esturo 2013, sec. 7.2 (normal equations); the assembly is this project's own.
class Assembly {
 public:
  /// Analyses the pattern. Throws UsageError when the terms do not share their nodes, unknowns and columns, or when
  /// residuals * unknowns exceeds 256.
  explicit Assembly(const std::vector<Term>& terms);

  /// Values of the matrix. The terms must have the connectivity of those given to the constructor.
  void refill(const std::vector<Term>& terms);
  /// Values of the right-hand side.
  void refill_targets(const std::vector<Term>& terms);

  /// H, lower triangle, compressed columns, rows sorted.
  const SparseMatrix& matrix() const { return matrix_; }
  /// g, unknown_count x columns.
  const Matrix& right_hand_side() const { return right_hand_side_; }

 private:
  // The sites that touch each node, for one term: entries [offsets[v], offsets[v+1]) of sites and locals.
  struct Incidence {
    std::vector<Index> offsets;
    std::vector<Index> sites;
    std::vector<int> locals;
    // For each entry, where its ranks start; ranks holds, for the site itself and each linked site in turn, the rank of
    // each of its nodes among the neighbours of v, or -1 above the diagonal.
    std::vector<std::size_t> rank_offsets;
    std::vector<Index> ranks;
    Matrix weighted_targets;  // W c, scratch of refill_targets
    Matrix targets;
  };

  template <int N, int U>
  void refill_nodes(const Term& term, const Incidence& incidence);

  int unknowns_ = 1;
  Index node_count_ = 0;
  std::vector<Incidence> incidences_;
  SparseMatrix matrix_;
  Matrix right_hand_side_;
};

/// The stacked least-squares form of a sum of terms: S E (tall, all entries) and S c with S'S = W, so that
/// sum ||E u - c||^2_W = |S E u - S c|^2. For backends that avoid the normal equations.
struct StackedForm {
  SparseMatrix matrix;
  Eigen::MatrixXd right_hand_side;
};
StackedForm stack(const std::vector<Term>& terms);

}  // namespace variform
