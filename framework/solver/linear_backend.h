// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "framework/base/types.h"

namespace variform {

/// What a linear backend is asked to solve, and how the matrix is stored.
enum class MatrixKind {
  spd,                   ///< symmetric positive definite; only the lower triangle is stored
  symmetric_indefinite,  ///< symmetric; only the lower triangle is stored
  general,               ///< square, all entries stored
  least_squares,         ///< tall with full column rank, all entries stored: minimizes |A x - b|
};

std::string to_string(MatrixKind kind);

/// Which kinds of matrices a backend takes, whether it is a direct method, and whether its factorization of a positive
/// definite matrix can be changed (update, hold, release).
struct LinearCapabilities {
  bool spd = false;
  bool symmetric_indefinite = false;
  bool general = false;
  bool least_squares = false;
  bool direct = true;
  bool update = false;

  bool supports(MatrixKind kind) const;
};

/// What a backend did, as far as it knows. Counts and sizes are -1 where unknown.
struct LinearReport {
  std::string backend;   ///< name of the backend that did the work (what "auto" chose, for example)
  bool ok = false;       ///< all phases so far succeeded
  std::string reason;    ///< why not, or how an iteration stopped
  std::string ordering;  ///< fill-reducing ordering, as the backend names it
  Index rows = 0;
  Index columns = 0;
  std::int64_t nnz_matrix = 0;   ///< stored entries (lower triangle for symmetric kinds)
  std::int64_t nnz_factor = -1;  ///< non-zeros of L (or of R, or of L+U)
  double flops = -1.0;           ///< of one numeric factorization
  double peak_memory = -1.0;     ///< bytes
  int analyses = 0;              ///< symbolic analyses so far: stays 1 while the pattern stays
  int factorizations = 0;
  int updates = 0;     ///< changes of a factorization: update, hold, release
  int solves = 0;      ///< calls of solve, not columns
  int iterations = 0;  ///< of the last solve, largest over the columns; 0 for direct methods
  /// Of the last solve, iterative methods: |A x - b| / |b| before every iteration and at the end, as the method itself
  /// knows it, for the column that took most iterations.
  std::vector<double> residual_history;
  double analyze_seconds = 0.0;  ///< of the last phase of each sort
  double factorize_seconds = 0.0;
  double update_seconds = 0.0;
  double solve_seconds = 0.0;
  /// Of the last solve: |A X - B| / |B| (Frobenius), or |A'(A X - B)| / (|A| |B|) for least squares (not relative to
  /// |A' B|, which is rounding noise for a B without a component in the range of A); 0 if B = 0.
  double residual = 0.0;
};

/// Solver for A X = B (or min |A X - B|), in three phases that are reused as far as possible:
///
///   backend.factorize(A, MatrixKind::spd);   // analyses the pattern, then factorizes
///   X = backend.solve(B);                    // any number of right-hand sides, all at once
///   backend.factorize(A2, MatrixKind::spd);  // same pattern, new values: numeric factorization only
///
/// Whether the pattern is the same is decided by a hash of (kind, sizes, column pointers, row indices); nothing has to
/// be declared stale by hand. The backend keeps its own copy of A. Every solve checks its own residual against
/// residual_limit: a wrong answer is an error, never a return value.
///
/// To add a backend, derive in solvers/linear/<name>.cpp, implement the three do_ functions (which throw SolverError
/// with the numbers on failure), and add one line to solvers/linear/linear_backends.cpp.
class LinearBackend {
 public:
  virtual ~LinearBackend() = default;
  LinearBackend(const LinearBackend&) = delete;
  LinearBackend& operator=(const LinearBackend&) = delete;

  /// A number that no other backend of this process has or had, never 0: says whose a factorization is.
  std::uint64_t id() const { return id_; }

  virtual LinearCapabilities capabilities() const = 0;

  /// Symbolic phase, skipped when the pattern is the one analysed last.
  /// Throws UsageError when the backend does not take this kind or A is not stored as the kind asks, SolverError when
  /// the analysis fails.
  void analyze(const SparseMatrix& A, MatrixKind kind);

  /// analyze (if needed) and numeric phase. A must be compressed, and lower triangular for symmetric kinds.
  /// Throws SolverError when the factorization fails (not positive definite, singular, out of memory in a library) or A holds a
  /// value that is not finite.
  void factorize(const SparseMatrix& A, MatrixKind kind);

  /// Solves for all columns of B (rows x k); returns columns x k.
  /// Throws SolverError without a factorization, when an iteration does not converge, or when the residual exceeds
  /// residual_limit, or B holds a value that is not finite; UsageError when the rows of B do not fit.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& B);
  /// The same into a matrix of the caller; allocates nothing when X has its size already, but for what the library
  /// behind the backend allocates.
  void solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X);

  /// Changes the factorization into the one of A + C C' (sign 1) or A - C C' (sign -1): C is rows x few columns,
  /// compressed. Costs about as much as the columns of the factor that C reaches, far less than a factorization.
  /// Throws UsageError without the capability, when C does not fit or unknowns are held; SolverError without a
  /// factorization, or when the result is not positive definite (factorize again then).
  void update(const SparseMatrix& C, int sign);
  /// Holds unknowns: their rows and columns become those of the identity, so that solve() returns what the right-hand
  /// side has there, and the couplings to them are the caller's. release() brings the rows and columns back. No new
  /// factorization; factorize() forgets all. Throws as update(), and UsageError for indices out of range, unknowns that
  /// are held already, or are not.
  void hold(const std::vector<Index>& unknowns);
  void release(const std::vector<Index>& unknowns);

  const LinearReport& report() const { return report_; }

  /// Largest relative residual that a solve may return.
  double residual_limit = 1e-7;

 protected:
  explicit LinearBackend(std::string name) { report_.backend = std::move(name); }

  virtual void do_analyze() = 0;    ///< of matrix(), values arbitrary; may set ordering, nnz_factor, flops
  virtual void do_factorize() = 0;  ///< of matrix()
  /// X has its size, its values are arbitrary; may set iterations, residual_history, reason.
  virtual void do_solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) = 0;

  using SparseRow = std::vector<std::pair<Index, double>>;  ///< column and value

  // For backends with the capability `update`.
  virtual void do_update(const SparseMatrix& C, int sign);
  virtual void do_hold(Index unknown);                           ///< makes its row and column those of the identity
  virtual void do_release(Index unknown, const SparseRow& row);  ///< puts this row and column in their place

  /// Throws SolverError with the name of the backend in front.
  [[noreturn]] void fail(const std::string& what) const;

  const SparseMatrix& matrix() const { return matrix_; }
  MatrixKind kind() const { return kind_; }
  LinearReport& mutable_report() { return report_; }

 private:
  /// Runs one phase and returns its seconds. Failures are noted in the report; what is not an Error becomes a
  /// SolverError, but std::bad_alloc.
  template <class Phase>
  double run(const Phase& phase);
  void check_update(const std::string& what) const;
  void change_held(const std::vector<Index>& unknowns, bool hold);
  double relative_residual(const Eigen::MatrixXd& X, const Eigen::MatrixXd& B);

  std::uint64_t id_ = [] {
    static std::atomic<std::uint64_t> last{0};
    return ++last;
  }();

  SparseMatrix matrix_;
  MatrixKind kind_ = MatrixKind::spd;
  std::uint64_t pattern_ = 0;
  bool analyzed_ = false;
  bool factorized_ = false;
  std::vector<bool> held_;  // empty: none
  Vector free_values_;      // of the matrix while unknowns are held
  Vector scratch_;          // of the residual check
  LinearReport report_;
};

/// Hash of the sparsity pattern (sizes, column pointers, row indices), not of the values.
std::uint64_t pattern_hash(const SparseMatrix& A);

}  // namespace variform
