// SPDX-License-Identifier: BSD-3-Clause
#include "framework/solver/eigen_backend.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <utility>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"

namespace variform {

namespace {

// The same numbers on every platform: the raw output of the generator is standardized, distributions are not.
Vector fixed_vector(Index rows, unsigned seed) {
  std::mt19937 generator(seed);
  return Vector::NullaryExpr(rows, [&] { return (static_cast<double>(generator()) - 2147483647.5) / 2147483648.0; });
}

// Columns M-orthonormal; fewer where they are linearly dependent up to rounding.
Eigen::MatrixXd orthonormalized(Eigen::MatrixXd X, const std::function<Vector(const Vector&)>& mass) {
  Eigen::Index kept = 0;
  Eigen::MatrixXd MX(X.rows(), X.cols());
  for (Eigen::Index j = 0; j < X.cols(); ++j) {
    Vector x = X.col(j);
    const double before = std::sqrt(x.dot(mass(x)));
    for (int pass = 0; pass < 2; ++pass) x -= X.leftCols(kept) * (MX.leftCols(kept).transpose() * x);
    Vector Mx = mass(x);
    const double size = std::sqrt(std::max(0.0, x.dot(Mx)));
    if (!(size > 1e-12 * before)) continue;
    X.col(kept) = x / size;
    MX.col(kept) = Mx / size;
    ++kept;
  }
  return X.leftCols(kept);
}

}  // namespace

EigenBackend::EigenBackend(std::string name, std::unique_ptr<LinearBackend> inner) : inner_(std::move(inner)) {
  report_.backend = std::move(name);
  report_.inner = inner_->report().backend;
  // What counts is the residual of the eigenpairs, which is checked; close to a singular K the one of a solve is
  // large without harm.
  inner_->residual_limit = std::max(inner_->residual_limit, 1e-3);
}

void EigenBackend::fail(const std::string& what) const {
  throw SolverError(fmt::format("eigen backend '{}': {}", report_.backend, what));
}

void EigenBackend::check(const SparseMatrix& K, const SparseMatrix& M, Index count) const {
  const auto refuse = [&](const std::string& what) {
    throw UsageError(fmt::format("eigen backend '{}': {}", report_.backend, what));
  };
  if (K.rows() != K.cols() || !K.isCompressed() || !M.isCompressed()) {
    refuse(fmt::format("expected compressed square matrices, got K of {} x {}", K.rows(), K.cols()));
  }
  if (M.size() > 0 && (M.rows() != K.rows() || M.cols() != K.cols())) {
    refuse(fmt::format("M is {} x {}, K is {} x {}", M.rows(), M.cols(), K.rows(), K.cols()));
  }
  if (count < 1 || count >= K.rows()) {
    refuse(fmt::format("{} eigenpairs asked for: expected 1 to {} for {} unknowns", count,
                       std::max<Eigen::Index>(K.rows() - 1, 0), K.rows()));
  }
  for (const SparseMatrix* A : {&K, &M}) {
    for (Index j = 0; j < A->cols(); ++j) {
      for (SparseMatrix::InnerIterator entry(*A, j); entry; ++entry) {
        if (entry.row() < j) {
          refuse(fmt::format("matrices must be given by their lower triangle, got entry ({}, {})", entry.row(), j));
        }
        if (!std::isfinite(entry.value())) fail("a matrix holds values that are not finite");
      }
    }
  }
}

// Inner solvers for indefinite matrices factorize with a shift among the eigenvalues, too; what is found then are those
// next to it.
void EigenBackend::refuse_shift() const {
  fail(fmt::format("there are eigenvalues below the shift {:.6g}: it must be below all eigenvalues", report_.shift));
}

Vector EigenBackend::apply_inverse(const Eigen::Ref<const Vector>& b) {
  Vector x = inner_->solve(b);
  ++report_.operations;
  report_.solve_seconds += inner_->report().solve_seconds;
  return x;
}

Vector EigenBackend::apply_mass(const Eigen::Ref<const Vector>& x) const {
  if (mass_.size() == 0) return x;
  return mass_.selfadjointView<Eigen::Lower>() * x;
}

Eigen::MatrixXd EigenBackend::apply_mass_all(const Eigen::MatrixXd& X) const {
  if (mass_.size() == 0) return X;
  return mass_.selfadjointView<Eigen::Lower>() * X;
}

void EigenBackend::factorize() {
  SparseMatrix identity;
  if (mass_.size() == 0) {
    identity.resize(stiffness_.rows(), stiffness_.cols());
    identity.setIdentity();
  }
  const SparseMatrix& M = mass_.size() == 0 ? identity : mass_;
  const double mean_mass = M.diagonal().cwiseAbs().mean();
  if (!(mean_mass > 0.0)) fail("the diagonal of M is zero");
  report_.shift = options.shift ? *options.shift : -1e-8 * stiffness_.diagonal().cwiseAbs().mean() / mean_mass;
  // Of a K that is zero everything is as good.
  if (!options.shift && report_.shift == 0.0) report_.shift = -1.0;
  SparseMatrix A = stiffness_ - report_.shift * M;
  A.makeCompressed();

  const LinearCapabilities takes = inner_->capabilities();
  const Stopwatch watch;
  try {
    if (takes.spd) {
      inner_->factorize(A, MatrixKind::spd);
    } else if (takes.symmetric_indefinite) {
      inner_->factorize(A, MatrixKind::symmetric_indefinite);
    } else {
      SparseMatrix all = A.selfadjointView<Eigen::Lower>();
      all.makeCompressed();
      inner_->factorize(all, takes.general ? MatrixKind::general : MatrixKind::least_squares);
    }
  } catch (const SolverError& error) {
    fail(fmt::format("K - shift M with shift {:.6g} cannot be factorized: {}; the shift must be below all eigenvalues",
                     report_.shift, error.what()));
  }
  report_.factorize_seconds = watch.seconds();
  report_.inner = inner_->report().backend;
}

EigenPairs EigenBackend::rayleigh_ritz(const Eigen::MatrixXd& basis, Index count) const {
  const Eigen::MatrixXd Q = orthonormalized(basis, [&](const Vector& x) { return apply_mass(x); });
  if (Q.cols() < count || !Q.allFinite()) {
    fail(fmt::format("the iteration found {} independent vectors instead of {}", Q.cols(), count));
  }
  const Eigen::MatrixXd KQ = stiffness_.selfadjointView<Eigen::Lower>() * Q;
  const Eigen::MatrixXd T = Q.transpose() * KQ;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> small(0.5 * (T + T.transpose()));
  return {small.eigenvalues().head(count), Q * small.eigenvectors().leftCols(count)};
}

/// One step of inverse iteration. The Lanczos method leaves errors of its tolerance in all directions, which K
/// magnifies in the high ones; the operator makes them as small as they should be (Ericsson and Ruhe 1980).
EigenPairs EigenBackend::purified(const EigenPairs& pairs) {
  const Eigen::MatrixXd Y = inner_->solve(apply_mass_all(pairs.vectors));
  report_.operations += Y.cols();
  report_.solve_seconds += inner_->report().solve_seconds;
  return rayleigh_ritz(Y, static_cast<Index>(Y.cols()));
}

/// Lanczos vectors of the operator, started in the M-orthogonal complement of what was found and kept there; none if
/// they hold no value that is larger than the smallest one found.
Eigen::MatrixXd EigenBackend::search_complement(const EigenPairs& found, unsigned seed) {
  constexpr Index kSteps = 15;
  const auto k = static_cast<Index>(found.values.size());
  const Index steps = std::min(kSteps, rows() - k);
  const Eigen::MatrixXd MX = apply_mass_all(found.vectors);
  Eigen::MatrixXd V(rows(), steps);
  Eigen::MatrixXd MV(rows(), steps);
  Eigen::MatrixXd T = Eigen::MatrixXd::Zero(steps, steps);
  Vector v = fixed_vector(rows(), seed);
  Index size = 0;
  for (; size < steps; ++size) {
    const double before = v.norm();
    for (int pass = 0; pass < 2; ++pass) {
      v -= found.vectors * (MX.transpose() * v);
      v -= V.leftCols(size) * (MV.leftCols(size).transpose() * v);
    }
    const Vector Mv = apply_mass(v);
    const double norm = std::sqrt(std::max(0.0, v.dot(Mv)));
    if (!(v.norm() > 1e-10 * before)) break;
    V.col(size) = v / norm;
    MV.col(size) = Mv / norm;
    v = apply_inverse(MV.col(size));
    T.col(size).head(size + 1) = MV.leftCols(size + 1).transpose() * v;
  }
  if (size == 0) return {};
  const Eigen::MatrixXd upper = T.topLeftCorner(size, size);
  const Eigen::MatrixXd symmetric = upper.selfadjointView<Eigen::Upper>();
  const Vector ritz = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(symmetric).eigenvalues();
  const double largest = ritz.maxCoeff();
  if (ritz.minCoeff() < -1e-6 * ritz.cwiseAbs().maxCoeff()) refuse_shift();
  const double smallest_found = 1.0 / (found.values[k - 1] - report_.shift);
  constexpr double kClearly = 1.0 + 1e-6;
  if (!(largest > kClearly * smallest_found)) return {};
  return V.leftCols(size);
}

EigenPairs EigenBackend::solve(const SparseMatrix& K, const SparseMatrix& M, Index count) {
  EigenReport fresh;
  fresh.backend = report_.backend;
  fresh.inner = report_.inner;
  report_ = fresh;
  const Stopwatch watch;
  try {
    check(K, M, count);
    report_.rows = static_cast<Index>(K.rows());
    report_.count = count;
    stiffness_ = K;
    mass_ = M;
    factorize();
    const Index usual = std::max(2 * count + 1, 20);
    const Index subspace = std::min(std::max(options.subspace > 0 ? options.subspace : usual, count + 1), rows());
    EigenPairs pairs = rayleigh_ritz(iterate(count, subspace, fixed_vector(rows(), 1)), count);
    if (!(pairs.values[0] > report_.shift)) refuse_shift();
    pairs = purified(pairs);
    for (Index round = 0; round < 2 * count + 2; ++round) {
      const Eigen::MatrixXd missed = search_complement(pairs, 2 + static_cast<unsigned>(round));
      if (missed.cols() == 0) break;
      const double last = pairs.values[count - 1];
      Eigen::MatrixXd basis(rows(), count + missed.cols());
      basis << pairs.vectors, missed;
      pairs = purified(rayleigh_ritz(basis, count));
      if (pairs.values[count - 1] < last) ++report_.completed;
    }

    const Eigen::MatrixXd MX = apply_mass_all(pairs.vectors);
    const Eigen::MatrixXd KX = stiffness_.selfadjointView<Eigen::Lower>() * pairs.vectors;
    report_.residuals.resize(count);
    for (Index j = 0; j < count; ++j) {
      Eigen::Index largest = 0;
      pairs.vectors.col(j).cwiseAbs().maxCoeff(&largest);
      const double scale = (std::abs(pairs.values[j]) + std::abs(report_.shift)) * MX.col(j).norm();
      report_.residuals[j] = (KX.col(j) - pairs.values[j] * MX.col(j)).norm() / scale;
      if (pairs.vectors(largest, j) < 0.0) pairs.vectors.col(j) *= -1.0;
    }
    report_.residual = report_.residuals.maxCoeff();
    report_.seconds = watch.seconds();
    if (!(report_.residual <= residual_limit)) {
      fail(fmt::format("residual {:.3g} of an eigenpair exceeds {:.3g} (shift {:.6g}, {} unknowns, {} pairs)",
                       report_.residual, residual_limit, report_.shift, rows(), count));
    }
    report_.ok = true;
    return pairs;
  } catch (const Error& error) {
    report_.reason = error.what();
    throw;
  }
}

}  // namespace variform
