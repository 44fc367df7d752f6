// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "framework/base/types.h"
#include "framework/solver/linear_backend.h"

namespace variform {

struct EigenOptions {
  double tolerance = 1e-10;   ///< relative accuracy of 1 / (lambda - shift) at which an eigenvalue counts as converged
  int max_iterations = 1000;  ///< restarts
  Index subspace = 0;         ///< vectors kept, at most the size of K; 0: max(2 k + 1, 20)
  /// What is smaller than every eigenvalue, so that K - shift M is positive definite; no value: -1e-8 times the mean of
  /// K's diagonal over that of M's, in absolute values: far below the eigenvalues of interest, and far enough from 0
  /// that a factorization of K with free modes is still accurate.
  std::optional<double> shift = {};
};

/// Eigenpairs, smallest first: K x = lambda M x.
struct EigenPairs {
  Vector values;
  Eigen::MatrixXd vectors;  ///< rows of K x k, M-orthonormal; the entry of largest magnitude is positive
};

/// What a backend did. Counts are -1 where unknown.
struct EigenReport {
  std::string backend;
  std::string inner;  ///< linear backend that solved with K - shift M
  bool ok = false;
  std::string reason;  ///< why not
  Index rows = 0;
  Index count = 0;                 ///< eigenpairs asked for
  double shift = 0.0;              ///< the one used
  int iterations = -1;             ///< restarts
  std::int64_t operations = 0;     ///< solves with K - shift M
  Index completed = 0;             ///< eigenpairs that the iteration had missed and the check found, see EigenBackend
  double factorize_seconds = 0.0;  ///< symbolic and numeric, of K - shift M
  double solve_seconds = 0.0;      ///< in all of these solves
  double seconds = 0.0;            ///< of all
  Vector residuals;                ///< of each pair: |K x - lambda M x| / ((|lambda| + |shift|) |M x|)
  double residual = 0.0;           ///< the largest
};

/// The k smallest eigenpairs of K x = lambda M x by iterations with (K - shift M)^-1, which a linear backend applies.
///
///   auto backend = make_eigen_backend("spectra.shift_invert");
///   EigenPairs modes = backend->solve(K, M, 10);
///
/// Starts from the same vector every time. Iterations from one vector find several copies of a multiple eigenvalue by
/// rounding only, and may miss one: a second, short iteration on the M-orthogonal complement of what was found looks
/// for values that belong in between, and puts them there, and for a shift that is not below all of them. Every pair's
/// residual is checked against residual_limit: a wrong answer is an error, never a return value.
///
/// To add a backend, derive in solvers/eigen/<name>.cpp, implement iterate(), and add one line to
/// solvers/eigen/eigen_backends.cpp.
class EigenBackend {
 public:
  virtual ~EigenBackend() = default;

  /// K symmetric positive semi-definite and M symmetric positive definite, both by their lower triangles, compressed;
  /// an M of size 0 stands for the identity. Throws UsageError unless sizes fit and 1 <= count < rows, SolverError when
  /// K - shift M is not positive definite (or singular), when the iteration does not converge, and when a residual
  /// exceeds residual_limit.
  EigenPairs solve(const SparseMatrix& K, const SparseMatrix& M, Index count);

  const EigenReport& report() const { return report_; }
  /// Of the inner solver: ordering, size of the factor, iterations.
  const LinearReport& inner_report() const { return inner_->report(); }

  EigenOptions options;
  /// Largest residual that a pair may have.
  double residual_limit = 1e-6;

 protected:
  EigenBackend(std::string name, std::unique_ptr<LinearBackend> inner);

  /// Approximate eigenvectors (rows x count, any scale and order, linearly independent) for the count largest
  /// eigenvalues of (K - shift M)^-1 M. Sets report().iterations. Throws SolverError when it does not converge.
  virtual Eigen::MatrixXd iterate(Index count, Index subspace, const Vector& start) = 0;

  /// (K - shift M)^-1 b.
  Vector apply_inverse(const Eigen::Ref<const Vector>& b);
  /// M x.
  Vector apply_mass(const Eigen::Ref<const Vector>& x) const;

  Index rows() const { return report_.rows; }
  EigenReport& mutable_report() { return report_; }
  /// Throws SolverError with the name of the backend in front.
  [[noreturn]] void fail(const std::string& what) const;

 private:
  void check(const SparseMatrix& K, const SparseMatrix& M, Index count) const;
  void factorize();
  [[noreturn]] void refuse_shift() const;
  Eigen::MatrixXd apply_mass_all(const Eigen::MatrixXd& X) const;
  EigenPairs rayleigh_ritz(const Eigen::MatrixXd& basis, Index count) const;
  EigenPairs purified(const EigenPairs& pairs);
  Eigen::MatrixXd search_complement(const EigenPairs& found, unsigned seed);

  std::unique_ptr<LinearBackend> inner_;
  SparseMatrix stiffness_;
  SparseMatrix mass_;
  EigenReport report_;
};

}  // namespace variform
