// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/newton_model.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <limits>

#include "framework/base/parallel.h"
#include "framework/base/stopwatch.h"
#include "framework/form/problem.h"

namespace variform {
namespace {

constexpr int kMaxValues = 9;  // components of Y, as TargetEnergy::SmallMatrix

// Calls body.operator()<N, Size, Columns, Rank>() with the sizes of a form of one unknown per node: residuals, nodes of
// a site, columns, rows of the curvature's root; those of the common energies, so that the compiler can unroll, else
// all Eigen::Dynamic.
template <class Body>
void with_sizes(const Form& form, int rank, const Body& body) {
  using Sizes = std::array<int, 4>;
  const int size = form.site_count() > 0 ? form.site_size(0) : 0;
  const Sizes sizes = {form.residuals(), size, form.columns(), form.unknowns() == 1 ? rank : -1};
  constexpr int X = Eigen::Dynamic;
  if (sizes == Sizes{2, 3, 2, 4}) return body.template operator()<2, 3, 2, 4>();
  if (sizes == Sizes{3, 3, 2, 4}) return body.template operator()<3, 3, 2, 4>();
  if (sizes == Sizes{3, 3, 3, 6}) return body.template operator()<3, 3, 3, 6>();
  if (sizes == Sizes{3, 4, 3, 9}) return body.template operator()<3, 4, 3, 9>();
  return body.template operator()<X, X, X, X>();
}

// Y = E u of a site with fixed sizes.
template <int N, int Size, int Columns>
Eigen::Matrix<double, N, Columns> value_of(const Form& form, Index t, const Matrix& U) {
  const Eigen::Map<const Eigen::Matrix<double, N, Size>> E(form.block_data(t));
  const Index* nodes = form.nodes().data() + std::ptrdiff_t{Size} * t;
  Eigen::Matrix<double, N, Columns> Y = Eigen::Matrix<double, N, Columns>::Zero();
  for (int i = 0; i < Size; ++i) {
    const double* u = U.data() + std::ptrdiff_t{Columns} * nodes[i];
    for (int j = 0; j < Columns; ++j) Y.col(j) += u[j] * E.col(i);
  }
  return Y;
}

}  // namespace

NewtonModel::NewtonModel(Problem& problem) : QuadraticModel(problem, "Newton") {
  const double beta = problem.norm_.beta;
  const Form& form = problem.terms().front().form;
  terms_.push_back({coupled_form(form, energy().curvature_rank(problem.domain())),
                    diagonal_norm((1.0 - beta) * problem.domain().cell_measures())});
  if (beta == 0.0) return;
  regularized_ = problem.terms().size() == 1;
  if (regularized_) {
    terms_.push_back({coupled_form(form, form.residuals() * form.columns()), problem.variation_norm()});
  } else {
    add_linear_terms(problem.declare_terms());
  }
}

void NewtonModel::refresh_curvature(const Matrix& U) {
  const Domain& domain = problem_.domain();
  const Form& form = problem_.terms().front().form;
  Form& roots = terms_.front().form;
  const int rank = roots.residuals();
  with_sizes(form, rank, [&]<int N, int Size, int Columns, int Rank>() {
    parallel_for(form.site_count(), [&](Index t) {
      if constexpr (N != Eigen::Dynamic) {
        const Eigen::Matrix<double, N, Columns> Y = value_of<N, Size, Columns>(form, t, U);
        Eigen::Matrix<double, Rank, N * Columns> R;
        energy().curvature_root(domain, t, Y, R);
        const Eigen::Map<const Eigen::Matrix<double, N, Size>> E(form.block_data(t));
        Eigen::Map<Eigen::Matrix<double, Rank, Size * Columns>> block(roots.block_data(t));
        for (int i = 0; i < Size; ++i) {
          for (int j = 0; j < Columns; ++j) {
            block.col(i * Columns + j) = R.template middleCols<N>(j * N).lazyProduct(E.col(i));
          }
        }
      } else {
        const TargetEnergy::SmallMatrix Y = TargetEnergy::value(form, t, U);
        TargetEnergy::SmallMatrix R(rank, Y.size());
        energy().curvature_root(domain, t, Y, R);
        Eigen::MatrixXd coupled(Y.size(), roots.block(t).cols());
        couple_block(form, t, coupled);
        roots.block(t).noalias() = R * coupled;
      }
    });
  });
  if (!regularized_) return;
  Form& jacobian = terms_[1].form;
  const int size = jacobian.residuals();
  parallel_for(form.site_count(), [&](Index t) {
    const TargetEnergy::SmallMatrix Y = TargetEnergy::value(form, t, U);
    TargetEnergy::SmallMatrix c = Y;
    TargetEnergy::SmallMatrix D(size, size);
    energy().target_of(domain, t, Y, c, &D);
    auto J = jacobian.block(t);
    couple_block(form, t, J);
    J -= (D * J).eval();
  });
}

Matrix NewtonModel::half_gradient(const Matrix& U) {
  const Domain& domain = problem_.domain();
  const Form& form = problem_.terms().front().form;
  const int columns = form.columns();
  const int values = form.residuals() * columns;
  const int d = form.unknowns() * columns;
  const int width = d * (form.site_count() > 0 ? form.site_size(0) : 0);
  problem_.terms().front().norm->apply(problem_.residual(U), weighted_);
  forces_.resize(form.site_count(), width);
  const auto force = [&](const auto& Y, Index t, auto& s) {
    TargetEnergy::SmallMatrix D(values, values);
    Eigen::Matrix<double, kMaxValues, 1> unused;
    energy().target_of(domain, t, Y, Eigen::Map<Eigen::MatrixXd>(unused.data(), Y.rows(), Y.cols()), &D);
    const Eigen::Map<const Eigen::VectorXd> w(weighted_.row(t).data(), values);
    s = w;
    s.noalias() -= D.transpose().lazyProduct(w);
  };
  with_sizes(form, terms_.front().form.residuals(), [&]<int N, int Size, int Columns, int Rank>() {
    parallel_for(form.site_count(), [&](Index t) {
      double* out = forces_.row(t).data();
      if constexpr (N != Eigen::Dynamic) {
        const Eigen::Matrix<double, N, Columns> Y = value_of<N, Size, Columns>(form, t, U);
        Eigen::Matrix<double, N * Columns, 1> s;
        force(Y, t, s);
        const Eigen::Map<const Eigen::Matrix<double, N, Size>> E(form.block_data(t));
        for (int i = 0; i < Size; ++i) {
          for (int j = 0; j < Columns; ++j) out[i * Columns + j] = E.col(i).dot(s.template segment<N>(j * N));
        }
      } else {
        Eigen::VectorXd s;
        force(TargetEnergy::value(form, t, U), t, s);
        Eigen::MatrixXd coupled(values, width);
        couple_block(form, t, coupled);
        Eigen::Map<Eigen::VectorXd>(out, width).noalias() = coupled.transpose() * s;
      }
    });
  });
  Matrix gradient = Matrix::Zero(U.rows(), U.cols());
  for (Index t = 0; t < form.site_count(); ++t) {
    const double* out = forces_.row(t).data();
    for (Index slot = form.offset(t); slot < form.offset(t + 1); ++slot) {
      double* g = gradient.data() + std::ptrdiff_t{d} * form.nodes()[slot];
      for (int j = 0; j < d; ++j) g[j] += *out++;
    }
  }
  for (std::size_t i = 1; i < problem_.terms().size(); ++i) {
    const Term& term = problem_.terms()[i];
    const Form& own = term.form;
    const Matrix weighted = term.norm->apply(own.residual(as_unknowns(U, own)));
    Matrix sum = Matrix::Zero(own.unknown_count(), own.columns());
    for (Index s = 0; s < own.site_count(); ++s) {
      const Eigen::Map<const Eigen::MatrixXd> w(weighted.row(s).data(), own.residuals(), own.columns());
      const Eigen::MatrixXd on_nodes = own.block(s).transpose() * w;
      for (int k = 0; k < on_nodes.rows(); ++k) {
        sum.row(own.node(s, k / own.unknowns()) * own.unknowns() + k % own.unknowns()) += on_nodes.row(k);
      }
    }
    gradient += as_vertex_values(sum, own);
  }
  return gradient;
}

Matrix NewtonModel::gradient(const Matrix& U) {
  Matrix gradient = 2.0 * half_gradient(U);
  const Constraints at = constraints_at(U);
  for (const auto& soft : at.soft()) gradient.row(soft.vertex) -= 2.0 * soft.weight * soft.value;
  return gradient;
}

const SparseMatrix& NewtonModel::matrix(const Matrix& U) {
  const Stopwatch watch;
  refresh_curvature(U);
  times().declare += watch.seconds();
  refill(constraints_at(U));
  return reduction_->matrix();
}

Direction NewtonModel::direction(const Matrix& U, double damping, LinearBackend& backend) {
  Stopwatch watch;
  refresh_curvature(U);
  const Constraints constraints = constraints_at(U);
  Matrix b = -half_gradient(U);
  b.resize(b.size(), 1);  // the same memory: the unknowns of one system
  times().declare += watch.restart();
  refill(constraints);
  return minimizer(constraints, b, damping, backend);
}

double longest_step(const Problem& problem, const Matrix& U, const Matrix& step) {
  const double infinity = std::numeric_limits<double>::infinity();
  if (!problem.traits().barrier) return infinity;
  const auto& energy = dynamic_cast<const TargetEnergy&>(problem.energy());
  const Form& form = problem.terms().front().form;
  double longest = infinity;
  with_sizes(form, energy.curvature_rank(problem.domain()), [&]<int N, int Size, int Columns, int Rank>() {
    longest = tbb::parallel_reduce(
        tbb::blocked_range<Index>(0, form.site_count(), 1024), infinity,
        [&](const tbb::blocked_range<Index>& range, double least) {
          for (Index t = range.begin(); t != range.end(); ++t) {
            if constexpr (N != Eigen::Dynamic) {
              const auto Y = value_of<N, Size, Columns>(form, t, U);
              const auto dY = value_of<N, Size, Columns>(form, t, step);
              least = std::min(least, energy.longest_step(problem.domain(), t, Y, dY));
            } else {
              least = std::min(least, energy.longest_step(problem.domain(), t, TargetEnergy::value(form, t, U),
                                                          TargetEnergy::value(form, t, step)));
            }
          }
          return least;
        },
        [](double a, double b) { return std::min(a, b); });
  });
  return longest;
}

}  // namespace variform
