// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/free_variables.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include "framework/base/error.h"

namespace variform {
namespace {

// The elimination of vertices does not depend on what couples them.
SparseMatrix uncoupled(Index size) {
  SparseMatrix H(size, size);
  H.setIdentity();
  return H;
}

// The constraints that Reduction eliminates.
Constraints without_equalities(const Constraints& constraints) {
  Constraints rest(constraints.vertex_count(), constraints.dimension());
  for (const auto& fixed : constraints.fixed()) rest.fix(fixed.vertex, fixed.value, fixed.components);
  for (const auto& pair : constraints.identified()) rest.identify(pair.first, pair.second);
  return rest;
}

}  // namespace

FreeVariables::FreeVariables(const Constraints& constraints)
    : constraints_(constraints),
      reduction_(uncoupled(constraints.vertex_count()), without_equalities(constraints), 1),
      Z_(reduction_.elimination()) {
  // The first vertex of each group stands for it.
  std::vector<Index> first(Z_.cols());
  for (Index j = 0; j < Z_.cols(); ++j) first[j] = static_cast<Index>(SparseMatrix::InnerIterator(Z_, j).row());

  std::vector<bool> determined(Z_.cols(), false);
  if (const auto& equalities = constraints.equalities(); !equalities.empty()) {
    std::vector<Eigen::Triplet<double, Index>> triplets;
    for (std::size_t e = 0; e < equalities.size(); ++e) {
      for (std::size_t i = 0; i < equalities[e].vertices.size(); ++i) {
        triplets.emplace_back(static_cast<Index>(e), equalities[e].vertices[i], equalities[e].weights[i]);
      }
    }
    equalities_.resize(static_cast<Index>(equalities.size()), constraints.vertex_count());
    equalities_.setFromTriplets(triplets.begin(), triplets.end());
    // C y = right-hand side on the few y that it sees, solved for as many of them as its rank says.
    const SparseMatrix C = equalities_ * Z_;
    std::vector<Index> seen;
    for (Index j = 0; j < C.cols(); ++j) {
      if (C.col(j).nonZeros() > 0) seen.push_back(j);
    }
    Eigen::MatrixXd dense(C.rows(), static_cast<Eigen::Index>(seen.size()));
    for (std::size_t j = 0; j < seen.size(); ++j) dense.col(static_cast<Eigen::Index>(j)) = C.col(seen[j]);
    Eigen::Index rank = 0;
    if (dense.cols() > 0) {  // else all that the equalities see is fixed
      const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(dense);
      rank = qr.rank();
      for (Eigen::Index j = 0; j < rank; ++j) {
        basic_.push_back(seen[qr.colsPermutation().indices()[j]]);
        determined[basic_.back()] = true;
      }
    }
    Eigen::MatrixXd basic(dense.rows(), rank);
    for (Eigen::Index j = 0; j < rank; ++j) basic.col(j) = C.col(basic_[j]);
    inverse_ = Eigen::MatrixXd::Zero(rank, dense.rows());
    if (rank > 0) inverse_ = basic.completeOrthogonalDecomposition().pseudoInverse();
    const Eigen::MatrixXd follows = -inverse_ * dense;

    std::vector<Index> column(Z_.cols(), -1);
    Index free = 0;
    for (Index j = 0; j < Z_.cols(); ++j) {
      if (!determined[j]) column[j] = free++;
    }
    triplets.clear();
    for (Index j = 0; j < Z_.cols(); ++j) {
      if (!determined[j]) triplets.emplace_back(j, column[j], 1.0);
    }
    for (std::size_t j = 0; j < seen.size(); ++j) {
      if (determined[seen[j]]) continue;
      for (Eigen::Index i = 0; i < rank; ++i) {
        triplets.emplace_back(basic_[i], column[seen[j]], follows(i, static_cast<Eigen::Index>(j)));
      }
    }
    SparseMatrix rest(Z_.cols(), free);
    rest.setFromTriplets(triplets.begin(), triplets.end());
    Z_ = (Z_ * rest).eval();
  }
  for (std::size_t j = 0; j < determined.size(); ++j) {
    if (!determined[j]) vertices_.push_back(first[j]);
  }

  const int d = constraints.dimension();
  std::vector<Eigen::Triplet<double, Index>> triplets;
  triplets.reserve(static_cast<std::size_t>(Z_.nonZeros()) * d);
  for (Index j = 0; j < Z_.cols(); ++j) {
    for (SparseMatrix::InnerIterator it(Z_, j); it; ++it) {
      for (int k = 0; k < d; ++k) triplets.emplace_back(static_cast<Index>(it.row()) * d + k, j * d + k, it.value());
    }
  }
  Z_of_all_coordinates_.resize(Z_.rows() * d, Z_.cols() * d);
  Z_of_all_coordinates_.setFromTriplets(triplets.begin(), triplets.end());

  // Equalities that contradict each other leave a defect.
  if (equalities_.rows() > 0) {
    const Matrix U = offset();
    Eigen::MatrixXd defect = equalities_ * U;
    for (Index e = 0; e < equalities_.rows(); ++e) defect.row(e) -= constraints.equalities()[e].value;
    Eigen::Index worst = 0;
    const double left = defect.rowwise().norm().maxCoeff(&worst);
    if (!(left <= 1e-9 * (1.0 + U.cwiseAbs().maxCoeff()))) {
      throw DataError(fmt::format("constraint: linear equality {} contradicts other hard constraints: {:.3g} is left",
                                  worst, left));
    }
  }
}

Matrix FreeVariables::offset() const {
  Matrix U = reduction_.fixed_part(constraints_, constraints_.dimension());
  if (basic_.empty()) return U;
  Eigen::MatrixXd right_hand_side = -(equalities_ * U);
  for (Index e = 0; e < equalities_.rows(); ++e) right_hand_side.row(e) += constraints_.equalities()[e].value;
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(reduction_.free_count(), constraints_.dimension());
  y(basic_, Eigen::all) = inverse_ * right_hand_side;
  return reduction_.expand(y, constraints_, constraints_.dimension());
}

Eigen::VectorXd FreeVariables::of(const Matrix& U, double slack) const {
  const int d = constraints_.dimension();
  Eigen::VectorXd y(count());
  for (std::size_t i = 0; i < vertices_.size(); ++i) {
    y.segment(static_cast<Eigen::Index>(i) * d, d) = U.row(vertices_[i]).transpose();
  }
  const Matrix error = state(y) - U;
  Eigen::Index vertex = 0;
  if (error.rows() > 0 && !(error.rowwise().norm().maxCoeff(&vertex) <= slack)) {
    throw UsageError(
        fmt::format("nonlinear backends that minimize over the free vertices start from a state that satisfies the "
                    "hard constraints; vertex {} is {:.3g} away from its own",
                    vertex, error.row(vertex).norm()));
  }
  return y;
}

Matrix FreeVariables::state(const Eigen::VectorXd& y) const {
  return offset() + Z_ * Eigen::Map<const Matrix>(y.data(), Z_.cols(), constraints_.dimension());
}

Eigen::VectorXd FreeVariables::restricted(const Matrix& G) const {
  const Matrix Y = Z_.transpose() * G;
  return Eigen::Map<const Eigen::VectorXd>(Y.data(), Y.size());
}

SparseMatrix FreeVariables::restricted(const SparseMatrix& A) const { return A * Z_of_all_coordinates_; }

}  // namespace variform
