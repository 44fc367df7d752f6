// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
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
/// Column v of E'WE is the sum over sites s of E_s' Y_s, with Y_s = sum_t W_st T_st E_t over the sites t at node v that
/// W couples to s: for cells, s runs over the cells around v and their neighbours. Which sites these are, and where
/// each block goes in the sparsity pattern, is computed once, from connectivity alone; then refill() writes values in
/// place: parallel over nodes, each owning its columns, so there are no write conflicts, the sums have a fixed order
/// (same bits on any number of threads), and nothing is allocated.
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
  // How one term reaches each node, in terms of slots: slot k is entry k of form.nodes(), one node of one site, and has
  // the k-th n x unknowns block of E.
  struct Part {
    Index slot;  // of the node, in a site t
    Index link;  // that couples t to s, as in the adjacency of the norm (2 * link + side of s); -1: t is s
  };
  struct Place {
    Index slot;  // of a node w >= v, in site s
    Index rank;  // of w among the block rows of v
  };
  // A site s that W couples to a node v, with as many of the parts and places of v, next in order.
  struct Coupling {
    Index site;
    Index parts;
    Index places;
  };
  struct Stencil {
    // Of node v: entries [offsets[v], offsets[v+1]), for the sites that touch it.
    std::vector<Index> offsets;
    std::vector<Index> slots;
    std::vector<Index> sites;
    // Of node v, likewise: all that its columns of the matrix are made of.
    std::vector<std::size_t> coupling_offsets;
    std::vector<std::size_t> part_offsets;
    std::vector<std::size_t> place_offsets;
    std::vector<Coupling> couplings;
    std::vector<Part> parts;
    std::vector<Place> places;
    Matrix weighted_targets;  // W c, scratch of refill_targets
  };

  void find_slots(const Form& form, Stencil& stencil) const;
  void find_pattern(const std::vector<Term>& terms);
  template <int N, int U>
  void refill_nodes(const Term& term, const Stencil& stencil, bool first);

  int unknowns_ = 1;
  Index node_count_ = 0;
  std::vector<Stencil> stencils_;
  SparseMatrix matrix_;
  Matrix right_hand_side_;
};

/// The stacked least-squares form of a sum of terms: S E (tall, all entries) and S c with S'S = W, so that
/// sum ||E u - c||^2_W = |S E u - S c|^2. For backends that avoid the normal equations.
SparseMatrix stacked_operator(const std::vector<Term>& terms);
Eigen::MatrixXd stacked_targets(const std::vector<Term>& terms);

}  // namespace variform
