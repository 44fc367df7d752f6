// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "framework/base/types.h"

namespace variform {

/// The pair (E, c) at one state: the affine residual r(u) = E u - c with n components at every site (Martinez Esturo
/// 2013, ch. 7.2). A site is a cell, a vertex, or whatever else carries a residual.
///
/// Every site s touches a few nodes (usually the vertices of its cell); every node carries `unknowns` consecutive
/// unknowns. The form keeps one dense block per site,
///
///   r_s = E_s u_s - c_s,   E_s: n x (unknowns * nodes of s),   c_s: n x columns,
///
/// in flat arrays, and never a Kronecker product. With several columns the same operator acts on each column of u: a
/// decoupled energy of R^d has unknowns = 1 and columns = d, a coupled one unknowns = d and columns = 1.
///
/// The vector of unknowns X is (unknowns * node_count) x columns, row-major. Vertex values U (|V| x d, row-major) have
/// exactly this memory layout in both cases: see as_unknowns.
class Form {
 public:
  Form() = default;

  /// Sites that all touch the same number of nodes: site_nodes is sites x (nodes per site). All values are zero.
  Form(Index node_count, const IndexMatrix& site_nodes, int residuals, int unknowns, int columns);

  /// A form that is not local to cells (frames and positions, seams, spectral maps): any sparse E, rows grouped by
  /// site (row s*residuals + i is component i of site s), one unknown per node, c with the rows of E and any number of
  /// columns. A site touches the union of the columns of its rows.
  /// Throws UsageError when the rows are no multiple of residuals or c does not fit.
  static Form from_sparse(const SparseMatrix& E, const Eigen::MatrixXd& c, int residuals);

  Index site_count() const { return static_cast<Index>(offsets_.size()) - 1; }
  Index node_count() const { return node_count_; }
  int residuals() const { return residuals_; }
  int unknowns() const { return unknowns_; }
  int columns() const { return columns_; }
  Index unknown_count() const { return node_count_ * unknowns_; }

  /// Nodes of site s: nodes()[offset(s)] to nodes()[offset(s + 1) - 1].
  Index offset(Index s) const { return offsets_[s]; }
  int site_size(Index s) const { return offsets_[s + 1] - offsets_[s]; }
  Index node(Index s, int i) const { return nodes_[offsets_[s] + i]; }
  const std::vector<Index>& nodes() const { return nodes_; }

  /// E_s, n x (unknowns * site_size(s)), columns node by node.
  Eigen::Map<Eigen::MatrixXd> block(Index s) { return {block_data(s), residuals_, unknowns_ * site_size(s)}; }
  Eigen::Map<const Eigen::MatrixXd> block(Index s) const {
    return {block_data(s), residuals_, unknowns_ * site_size(s)};
  }
  /// c_s, n x columns.
  Eigen::Map<Eigen::MatrixXd> target(Index s) { return {target_data(s), residuals_, columns_}; }
  Eigen::Map<const Eigen::MatrixXd> target(Index s) const { return {target_data(s), residuals_, columns_}; }

  const double* block_data(Index s) const { return E_.data() + block_offset(s); }
  double* block_data(Index s) { return E_.data() + block_offset(s); }
  const double* target_data(Index s) const { return c_.data() + target_offset(s); }
  double* target_data(Index s) { return c_.data() + target_offset(s); }

  /// E as one sparse matrix, (n * sites) x unknown_count, rows site by site. For tests and least-squares backends.
  SparseMatrix sparse_operator() const;
  /// c as one matrix, (n * sites) x columns.
  Eigen::MatrixXd stacked_targets() const;

  /// r(X) for unknowns X (unknown_count x columns): sites x (n * columns), row s is vec(r_s) column by column.
  Matrix residual(const Matrix& X) const;
  void residual(const Eigen::Ref<const Matrix>& X, Matrix& R) const;
  /// Sum of weights[s] |r_s(X)|^2, without storing r.
  double squared_residual(const Eigen::Ref<const Matrix>& X, const Vector& weights) const;

 private:
  // N and Columns: residuals_ and columns_ if they are known to the compiler, else 0.
  template <int N, int Columns>
  void residual_of_site(Index s, const Eigen::Ref<const Matrix>& X, double* r) const;
  void check_unknowns(const Eigen::Ref<const Matrix>& X) const;

  std::size_t block_offset(Index s) const {
    return static_cast<std::size_t>(offsets_[s]) * static_cast<std::size_t>(residuals_ * unknowns_);
  }
  std::size_t target_offset(Index s) const {
    return static_cast<std::size_t>(s) * static_cast<std::size_t>(residuals_ * columns_);
  }

  Index node_count_ = 0;
  int residuals_ = 0;
  int unknowns_ = 1;
  int columns_ = 1;
  std::vector<Index> offsets_ = {0};
  std::vector<Index> nodes_;
  std::vector<double> E_;
  std::vector<double> c_;
};

/// Vertex values U (|V| x d) as unknowns of a form: |V| x d if the form has columns = d, (d |V|) x 1 if it is coupled.
/// And back.
Matrix as_unknowns(const Matrix& U, const Form& form);
Matrix as_vertex_values(const Matrix& X, const Form& form);

}  // namespace variform
