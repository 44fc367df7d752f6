// SPDX-License-Identifier: BSD-3-Clause
#include "framework/solver/linear_backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <new>

#include "framework/base/error.h"
#include "framework/base/stopwatch.h"

namespace variform {

std::string to_string(MatrixKind kind) {
  switch (kind) {
    case MatrixKind::spd: return "symmetric positive definite";
    case MatrixKind::symmetric_indefinite: return "symmetric indefinite";
    case MatrixKind::general: return "general";
    case MatrixKind::least_squares: return "least squares";
  }
  return {};
}

bool LinearCapabilities::supports(MatrixKind kind) const {
  switch (kind) {
    case MatrixKind::spd: return spd;
    case MatrixKind::symmetric_indefinite: return symmetric_indefinite;
    case MatrixKind::general: return general;
    case MatrixKind::least_squares: return least_squares;
  }
  return false;
}

std::uint64_t pattern_hash(const SparseMatrix& A) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  const auto mix = [&hash](std::uint64_t value) {
    hash = (hash ^ value) * 0x9e3779b97f4a7c15ULL;
    hash ^= hash >> 29U;
  };
  mix(static_cast<std::uint64_t>(A.rows()));
  mix(static_cast<std::uint64_t>(A.cols()));
  for (Index j = 0; j <= A.outerSize(); ++j) mix(static_cast<std::uint64_t>(A.outerIndexPtr()[j]));
  for (Index k = 0; k < A.nonZeros(); ++k) mix(static_cast<std::uint64_t>(A.innerIndexPtr()[k]));
  return hash;
}

void LinearBackend::fail(const std::string& what) const {
  throw SolverError(fmt::format("linear backend '{}': {}", report_.backend, what));
}

template <class Phase>
double LinearBackend::run(const Phase& phase) {
  report_.ok = false;
  const Stopwatch watch;
  try {
    try {
      phase();
    } catch (const Error&) {
      throw;
    } catch (const std::bad_alloc&) {
      report_.reason = fmt::format("out of memory ({} x {} system)", report_.rows, report_.columns);
      throw;  // whoever runs this tells it from a solver that failed
    } catch (const std::exception& error) {
      fail(error.what());
    }
  } catch (const Error& error) {
    report_.reason = error.what();
    throw;
  }
  return watch.seconds();
}

void LinearBackend::analyze(const SparseMatrix& A, MatrixKind kind) {
  const auto refuse = [&](const std::string& what) {
    throw UsageError(fmt::format("linear backend '{}': {}", report_.backend, what));
  };
  if (!capabilities().supports(kind)) refuse(fmt::format("does not solve {} systems", to_string(kind)));
  if (!A.isCompressed()) refuse("the matrix must be compressed");
  if (kind == MatrixKind::least_squares ? A.rows() < A.cols() : A.rows() != A.cols()) {
    refuse(fmt::format("a {} system must be {}, got {} x {}", to_string(kind),
                       kind == MatrixKind::least_squares ? "tall" : "square", A.rows(), A.cols()));
  }
  const std::uint64_t pattern = pattern_hash(A);
  if (analyzed_ && kind == kind_ && pattern == pattern_) return;
  if (kind == MatrixKind::spd || kind == MatrixKind::symmetric_indefinite) {
    for (Index j = 0; j < A.cols(); ++j) {
      for (SparseMatrix::InnerIterator entry(A, j); entry; ++entry) {
        if (entry.row() < j) {
          refuse(fmt::format("a {} matrix must be given by its lower triangle, got entry ({}, {})", to_string(kind),
                             entry.row(), j));
        }
      }
    }
  }
  analyzed_ = factorized_ = false;
  report_.nnz_factor = -1;
  report_.flops = report_.peak_memory = -1.0;
  report_.rows = static_cast<Index>(A.rows());
  report_.columns = static_cast<Index>(A.cols());
  report_.nnz_matrix = A.nonZeros();
  report_.analyze_seconds = run([&] {
    kind_ = kind;
    pattern_ = pattern;
    matrix_ = A;
    if (A.cols() > 0 && A.nonZeros() == 0) fail("the matrix is singular: it has no entries");
    if (A.cols() > 0) do_analyze();
  });
  ++report_.analyses;
  analyzed_ = true;
}

void LinearBackend::factorize(const SparseMatrix& A, MatrixKind kind) {
  analyze(A, kind);
  factorized_ = false;
  held_.clear();
  report_.factorize_seconds = run([&] {
    const Eigen::Map<const Vector> values(A.valuePtr(), A.nonZeros());
    if (!values.allFinite()) fail("the matrix holds values that are not finite");
    Eigen::Map<Vector>(matrix_.valuePtr(), matrix_.nonZeros()) = values;
    if (A.cols() > 0) do_factorize();
  });
  ++report_.factorizations;
  report_.ok = factorized_ = true;
  report_.reason.clear();
}

void LinearBackend::do_update(const SparseMatrix& /*C*/, int /*sign*/) { fail("no updates"); }
void LinearBackend::do_hold(Index /*unknown*/) { fail("no updates"); }
void LinearBackend::do_release(Index /*unknown*/, const SparseRow& /*row*/) { fail("no updates"); }

void LinearBackend::check_update(const std::string& what) const {
  if (!capabilities().update || kind_ != MatrixKind::spd) {
    throw UsageError(
        fmt::format("linear backend '{}': {} needs a backend that updates factorizations of positive "
                    "definite matrices, as cholmod.simplicial does",
                    report_.backend, what));
  }
  if (!factorized_) fail(what + " before factorize");
}

void LinearBackend::update(const SparseMatrix& C, int sign) {
  check_update("update");
  if (C.rows() != matrix_.rows() || !C.isCompressed() || (sign != 1 && sign != -1) || !held_.empty()) {
    throw UsageError(
        fmt::format("linear backend '{}': update by {} x {} of a {} x {} matrix: expected as many rows, "
                    "compressed, a sign of 1 or -1 (got {}), and no unknowns held",
                    report_.backend, C.rows(), C.cols(), matrix_.rows(), matrix_.cols(), sign));
  }
  report_.update_seconds = run([&] {
    factorized_ = false;
    SparseMatrix change = (static_cast<double>(sign) * C * C.transpose()).eval().triangularView<Eigen::Lower>();
    SparseMatrix changed = matrix_ + change;
    changed.makeCompressed();
    // What was analysed is the pattern from before.
    if (changed.nonZeros() != matrix_.nonZeros()) analyzed_ = false;
    matrix_ = std::move(changed);
    do_update(C, sign);
  });
  ++report_.updates;
  report_.ok = factorized_ = true;
}

void LinearBackend::hold(const std::vector<Index>& unknowns) { change_held(unknowns, true); }
void LinearBackend::release(const std::vector<Index>& unknowns) { change_held(unknowns, false); }

void LinearBackend::change_held(const std::vector<Index>& unknowns, bool hold) {
  const char* what = hold ? "hold" : "release";
  check_update(what);
  if (unknowns.empty()) return;
  const auto n = static_cast<std::size_t>(matrix_.cols());
  std::vector<bool> after = held_.empty() ? std::vector<bool>(n, false) : held_;
  for (const Index i : unknowns) {
    if (i < 0 || i >= matrix_.cols() || after[static_cast<std::size_t>(i)] == hold) {
      throw UsageError(fmt::format("linear backend '{}': {} unknown {} of {}: it does not exist or {}", report_.backend,
                                   what, i, n, hold ? "is held already" : "is not held"));
    }
    after[static_cast<std::size_t>(i)] = hold;
  }
  report_.update_seconds = run([&] {
    factorized_ = false;
    if (held_.empty()) {
      free_values_ = Eigen::Map<const Vector>(matrix_.valuePtr(), matrix_.nonZeros());
      held_.assign(n, false);
    }
    // The rows that come back, of the free matrix.
    std::map<Index, SparseRow> rows;
    if (!hold) {
      for (const Index i : unknowns) rows[i];
      const auto note = [&](Index row, Index column, double value) {
        if (after[static_cast<std::size_t>(row)] != held_[static_cast<std::size_t>(row)]) {
          rows[row].emplace_back(column, value);
        }
      };
      for (Index j = 0; j < matrix_.cols(); ++j) {
        for (Index k = matrix_.outerIndexPtr()[j]; k < matrix_.outerIndexPtr()[j + 1]; ++k) {
          const Index i = matrix_.innerIndexPtr()[k];
          note(i, j, free_values_[k]);
          if (i != j) note(j, i, free_values_[k]);
        }
      }
    }
    for (const Index i : unknowns) {
      held_[static_cast<std::size_t>(i)] = hold;
      if (hold) {
        do_hold(i);
        continue;
      }
      SparseRow& row = rows[i];  // without what is still held
      row.erase(std::remove_if(row.begin(), row.end(),
                               [&](const auto& entry) { return held_[static_cast<std::size_t>(entry.first)]; }),
                row.end());
      std::sort(row.begin(), row.end());
      do_release(i, row);
    }
    for (Index j = 0; j < matrix_.cols(); ++j) {
      for (Index k = matrix_.outerIndexPtr()[j]; k < matrix_.outerIndexPtr()[j + 1]; ++k) {
        const Index i = matrix_.innerIndexPtr()[k];
        const bool gone = held_[static_cast<std::size_t>(i)] || held_[static_cast<std::size_t>(j)];
        matrix_.valuePtr()[k] = !gone ? free_values_[k] : i == j ? 1.0 : 0.0;
      }
    }
    if (std::find(held_.begin(), held_.end(), true) == held_.end()) held_.clear();
  });
  ++report_.updates;
  report_.ok = factorized_ = true;
}

Eigen::MatrixXd LinearBackend::solve(const Eigen::MatrixXd& B) {
  Eigen::MatrixXd X;
  solve(B, X);
  return X;
}

void LinearBackend::solve(const Eigen::MatrixXd& B, Eigen::MatrixXd& X) {
  if (!factorized_) fail("solve before factorize");
  if (B.rows() != matrix_.rows()) {
    throw UsageError(fmt::format("linear backend '{}': {} rows on the right-hand side, the matrix has {}",
                                 report_.backend, B.rows(), matrix_.rows()));
  }
  report_.iterations = 0;
  report_.residual_history.clear();
  X.resize(matrix_.cols(), B.cols());
  report_.solve_seconds = run([&] {
    if (!B.allFinite()) fail("the right-hand side holds values that are not finite");
    if (X.size() > 0) do_solve(B, X);
  });
  ++report_.solves;
  run([&] {
    report_.residual = relative_residual(X, B);
    if (!(report_.residual <= residual_limit)) {
      fail(fmt::format(
          "relative residual {:.3g} exceeds {:.3g} ({} x {} system); the matrix is singular or badly conditioned, or "
          "too few constraints are given",
          report_.residual, residual_limit, matrix_.rows(), matrix_.cols()));
    }
  });
  report_.ok = true;
}

namespace {

// |A X - B| (Frobenius) for the lower triangle of a symmetric A, reading A once for all columns of at most Width.
template <int Width>
double squared_residual(const SparseMatrix& A, const Eigen::Ref<const Eigen::MatrixXd>& X,
                        const Eigen::Ref<const Eigen::MatrixXd>& B, double* scratch) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Width, Width == 1 ? Eigen::ColMajor : Eigen::RowMajor>;
  using Row = Eigen::Array<double, 1, Width>;
  Eigen::Map<Rows> x(scratch, X.rows(), X.cols());
  Eigen::Map<Rows> r(scratch + X.size(), X.rows(), X.cols());
  x = X;
  r = -B;
  for (Index j = 0; j < A.cols(); ++j) {
    const Row xj = x.row(j).array();
    Row sum = Row::Zero();
    for (Index k = A.outerIndexPtr()[j]; k < A.outerIndexPtr()[j + 1]; ++k) {
      const Index i = A.innerIndexPtr()[k];
      const double a = A.valuePtr()[k];
      sum += a * x.row(i).array();
      if (i != j) r.row(i).array() += a * xj;
    }
    r.row(j).array() += sum;
  }
  return r.squaredNorm();
}

double symmetric_residual(const SparseMatrix& A, const Eigen::MatrixXd& X, const Eigen::MatrixXd& B, Vector& scratch) {
  scratch.resize(2 * X.rows() * std::min<Eigen::Index>(X.cols(), 8));
  double sum = 0.0;
  for (Eigen::Index first = 0; first < B.cols();) {
    const Eigen::Index left = B.cols() - first;
    const Eigen::Index width = left >= 8 ? 8 : left >= 4 ? 4 : left;
    const auto x = X.middleCols(first, width);
    const auto b = B.middleCols(first, width);
    switch (width) {
      case 1: sum += squared_residual<1>(A, x, b, scratch.data()); break;
      case 2: sum += squared_residual<2>(A, x, b, scratch.data()); break;
      case 3: sum += squared_residual<3>(A, x, b, scratch.data()); break;
      case 4: sum += squared_residual<4>(A, x, b, scratch.data()); break;
      default: sum += squared_residual<8>(A, x, b, scratch.data());
    }
    first += width;
  }
  return std::sqrt(sum);
}

}  // namespace

double LinearBackend::relative_residual(const Eigen::MatrixXd& X, const Eigen::MatrixXd& B) {
  if (matrix_.cols() == 0 || B.cols() == 0) return 0.0;
  const auto ratio = [](double numerator, double denominator) {
    return denominator > 0.0 ? numerator / denominator : numerator;
  };
  switch (kind_) {
    case MatrixKind::least_squares: {
      const Eigen::MatrixXd residual = matrix_ * X - B;
      return ratio((matrix_.transpose() * residual).norm(), matrix_.norm() * B.norm());
    }
    case MatrixKind::general: return ratio((matrix_ * X - B).norm(), B.norm());
    default: return ratio(symmetric_residual(matrix_, X, B, scratch_), B.norm());
  }
}

}  // namespace variform
