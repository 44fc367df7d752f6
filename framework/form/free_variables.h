// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "framework/form/constraints.h"

namespace variform {

/// Coordinates of the states that satisfy the hard constraints: U = Z Y + U_0, with one row of Y (m x d) for each free
/// vertex, first of its group of identified vertices, and one row less per linear equality. The variables y are the
/// rows of Y one after the other, values at vertices themselves, so y is as U in units and meaning. For minimization
/// by libraries that know no constraints.
class FreeVariables {
 public:
  /// The constraints must outlive this and keep their vertices; fixed values may change. Throws DataError when linear
  /// equalities contradict each other or what is fixed.
  explicit FreeVariables(const Constraints& constraints);

  /// m d.
  Index count() const { return static_cast<Index>(vertices_.size()) * constraints_.dimension(); }

  /// The variables of a state (|V| x d). Throws UsageError, naming a vertex, when it is farther than slack (a length)
  /// from satisfying the constraints.
  Eigen::VectorXd of(const Matrix& U, double slack) const;
  /// The state of variables: |V| x d.
  Matrix state(const Eigen::VectorXd& y) const;

  /// The derivative by y of a function with derivative G by U (|V| x d).
  Eigen::VectorXd restricted(const Matrix& G) const;
  /// The derivative by y of functions with derivatives A by U, rows x (|V| d), coordinates vertex by vertex.
  SparseMatrix restricted(const SparseMatrix& A) const;

 private:
  Matrix offset() const;  // U_0

  const Constraints& constraints_;
  Reduction reduction_;                // fixed values and identifications
  std::vector<Index> vertices_;        // whose value is a row of Y
  SparseMatrix Z_;                     // |V| x m
  SparseMatrix Z_of_all_coordinates_;  // Z (x) I_d
  // Y of the vertices that linear equalities determine, for equal zero free ones: basic_ = inverse_ * right-hand side.
  SparseMatrix equalities_;   // equalities x |V|
  std::vector<Index> basic_;  // rows of the reduction's y
  Eigen::MatrixXd inverse_;
};

}  // namespace variform
