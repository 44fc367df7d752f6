// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/form.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {

Form::Form(Index node_count, const IndexMatrix& site_nodes, int residuals, int unknowns, int columns)
    : node_count_(node_count), residuals_(residuals), unknowns_(unknowns), columns_(columns) {
  const auto sites = static_cast<Index>(site_nodes.rows());
  const auto size = static_cast<Index>(site_nodes.cols());
  offsets_.resize(sites + 1);
  for (Index s = 0; s <= sites; ++s) offsets_[s] = s * size;
  nodes_.assign(site_nodes.data(), site_nodes.data() + site_nodes.size());
  E_.assign(block_offset(sites), 0.0);
  c_.assign(target_offset(sites), 0.0);
}

Form Form::from_sparse(const SparseMatrix& E, const Eigen::MatrixXd& c, int residuals) {
  if (residuals < 1 || E.rows() % residuals != 0) {
    throw UsageError(fmt::format("form: {} rows are no multiple of {} residuals per site", E.rows(), residuals));
  }
  if (c.rows() != E.rows() || c.cols() < 1) {
    throw UsageError(fmt::format("form: E has {} rows, c is {} x {}", E.rows(), c.rows(), c.cols()));
  }
  const Eigen::SparseMatrix<double, Eigen::RowMajor, Index> rows = E;
  Form form;
  form.node_count_ = static_cast<Index>(E.cols());
  form.residuals_ = residuals;
  form.columns_ = static_cast<int>(c.cols());
  const auto sites = static_cast<Index>(E.rows() / residuals);
  form.c_.resize(form.target_offset(sites));
  for (Index s = 0; s < sites; ++s) {
    std::vector<Index> touched;
    for (int i = 0; i < residuals; ++i) {
      for (Eigen::SparseMatrix<double, Eigen::RowMajor, Index>::InnerIterator it(rows, s * residuals + i); it; ++it) {
        touched.push_back(static_cast<Index>(it.col()));
      }
    }
    std::sort(touched.begin(), touched.end());
    touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
    form.nodes_.insert(form.nodes_.end(), touched.begin(), touched.end());
    form.offsets_.push_back(static_cast<Index>(form.nodes_.size()));
    form.E_.resize(form.block_offset(s + 1), 0.0);
    Eigen::Map<Eigen::MatrixXd> block = form.block(s);
    for (int i = 0; i < residuals; ++i) {
      for (Eigen::SparseMatrix<double, Eigen::RowMajor, Index>::InnerIterator it(rows, s * residuals + i); it; ++it) {
        const auto at = std::lower_bound(touched.begin(), touched.end(), static_cast<Index>(it.col()));
        block(i, at - touched.begin()) += it.value();
      }
    }
    form.target(s) = c.middleRows(s * residuals, residuals);
  }
  return form;
}

SparseMatrix Form::sparse_operator() const {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  triplets.reserve(E_.size());
  for (Index s = 0; s < site_count(); ++s) {
    const auto E = block(s);
    for (int k = 0; k < E.cols(); ++k) {
      const Index column = node(s, k / unknowns_) * unknowns_ + k % unknowns_;
      for (int i = 0; i < residuals_; ++i) triplets.emplace_back(s * residuals_ + i, column, E(i, k));
    }
  }
  SparseMatrix result(site_count() * residuals_, unknown_count());
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

Eigen::MatrixXd Form::stacked_targets() const {
  Eigen::MatrixXd result(static_cast<Index>(site_count() * residuals_), columns_);
  for (Index s = 0; s < site_count(); ++s) result.middleRows(s * residuals_, residuals_) = target(s);
  return result;
}

Matrix Form::residual(const Matrix& X) const {
  Matrix R;
  residual(X, R);
  return R;
}

namespace {

// Calls with<N, Columns>() for the sizes of the common nonlinear energies, which the compiler then knows, else with
// zeros.
template <class With>
auto with_sizes(int residuals, int columns, const With& with) {
  const std::pair<int, int> sizes = {residuals, columns};
  if (sizes == std::pair(2, 2)) return with.template operator()<2, 2>();
  if (sizes == std::pair(3, 2)) return with.template operator()<3, 2>();
  if (sizes == std::pair(3, 3)) return with.template operator()<3, 3>();
  return with.template operator()<0, 0>();
}

}  // namespace

template <int N, int Columns>
void Form::residual_of_site(Index s, const Eigen::Ref<const Matrix>& X, double* r) const {
  const int n = N > 0 ? N : residuals_;
  const int columns = Columns > 0 ? Columns : columns_;
  const double* E = block_data(s);
  const double* c = target_data(s);
  for (int j = 0; j < n * columns; ++j) r[j] = -c[j];
  for (int i = 0; i < site_size(s); ++i) {
    for (int k = 0; k < unknowns_; ++k, E += n) {
      const double* x = X.data() + (static_cast<std::ptrdiff_t>(node(s, i)) * unknowns_ + k) * X.outerStride();
      for (int column = 0; column < columns; ++column) {
        for (int l = 0; l < n; ++l) r[column * n + l] += E[l] * x[column];
      }
    }
  }
}

void Form::check_unknowns(const Eigen::Ref<const Matrix>& X) const {
  if (X.rows() != unknown_count() || X.cols() != columns_) {
    throw UsageError(
        fmt::format("form: expected {} x {} unknowns, got {} x {}", unknown_count(), columns_, X.rows(), X.cols()));
  }
}

void Form::residual(const Eigen::Ref<const Matrix>& X, Matrix& R) const {
  check_unknowns(X);
  R.resize(site_count(), residuals_ * columns_);
  with_sizes(residuals_, columns_, [&]<int N, int Columns>() {
    parallel_for(site_count(), [&](Index s) { residual_of_site<N, Columns>(s, X, R.data() + s * R.cols()); });
  });
}

double Form::squared_residual(const Eigen::Ref<const Matrix>& X, const Vector& weights) const {
  check_unknowns(X);
  const Eigen::Index size = residuals_ * columns_;
  return with_sizes(residuals_, columns_, [&]<int N, int Columns>() {
    return parallel_sum(site_count(), [&](Index s) {
      constexpr int kSize = N > 0 ? N * Columns : Eigen::Dynamic;
      Eigen::Matrix<double, kSize, 1> r(size);
      residual_of_site<N, Columns>(s, X, r.data());
      return weights[s] * r.squaredNorm();
    });
  });
}

Matrix as_unknowns(const Matrix& U, const Form& form) {
  if (U.size() != static_cast<Eigen::Index>(form.unknown_count()) * form.columns()) {
    throw UsageError(fmt::format("form: {} x {} vertex values do not fit {} x {} unknowns", U.rows(), U.cols(),
                                 form.unknown_count(), form.columns()));
  }
  return Eigen::Map<const Matrix>(U.data(), form.unknown_count(), form.columns());
}

Matrix as_vertex_values(const Matrix& X, const Form& form) {
  return Eigen::Map<const Matrix>(X.data(), form.node_count(), form.unknowns() * form.columns());
}

}  // namespace variform
