// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// Private to the backends that use CHOLMOD's data structures; only for builds with SuiteSparse.

#include <cholmod.h>

#include <string>
#include <type_traits>
#include <utility>

#include "framework/solver/linear_backend.h"

namespace variform {

/// The state CHOLMOD and SPQR keep for one backend, quiet. Integer is the index type of the matrices (int or
/// SuiteSparse_long, which decides between the cholmod_ and the cholmod_l_ functions).
template <class Integer>
class CholmodCommon {
 public:
  static constexpr bool kLong = !std::is_same_v<Integer, int>;

  CholmodCommon() {
    if constexpr (kLong) {
      cholmod_l_start(&common_);
    } else {
      cholmod_start(&common_);
    }
    common_.print = 0;
    common_.error_handler = nullptr;
    common_.useGPU = 0;
  }
  ~CholmodCommon() {
    if constexpr (kLong) {
      cholmod_l_finish(&common_);
    } else {
      cholmod_finish(&common_);
    }
  }
  CholmodCommon(const CholmodCommon&) = delete;
  CholmodCommon& operator=(const CholmodCommon&) = delete;

  cholmod_common* get() { return &common_; }
  cholmod_common* operator->() { return &common_; }

  /// Empty unless the last call failed. Not positive definite is no failure here.
  std::string error() const {
    switch (common_.status) {
      case CHOLMOD_NOT_INSTALLED: return "method not installed";
      case CHOLMOD_OUT_OF_MEMORY: return "out of memory";
      case CHOLMOD_TOO_LARGE: return "problem too large for 32-bit indices";
      case CHOLMOD_INVALID: return "invalid input";
      default: return common_.status < 0 ? "status " + std::to_string(common_.status) : std::string();
    }
  }

 private:
  cholmod_common common_{};
};

/// CHOLMOD's view of a sparse matrix; stype -1 takes the lower triangle of a symmetric matrix, 0 all entries. CHOLMOD's
/// structures have no const, but inputs are not written to.
template <class Integer>
cholmod_sparse cholmod_view(const SparseMatrix& A, const Integer* column_pointers, const Integer* rows, int stype) {
  cholmod_sparse view{};
  view.nrow = static_cast<std::size_t>(A.rows());
  view.ncol = static_cast<std::size_t>(A.cols());
  view.nzmax = static_cast<std::size_t>(A.nonZeros());
  view.p = const_cast<Integer*>(column_pointers);
  view.i = const_cast<Integer*>(rows);
  view.x = const_cast<double*>(A.valuePtr());
  view.stype = stype;
  view.itype = CholmodCommon<Integer>::kLong ? CHOLMOD_LONG : CHOLMOD_INT;
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = 1;
  view.packed = 1;
  return view;
}

/// Columns [from, from + count) of a matrix.
inline cholmod_dense cholmod_view(const Eigen::MatrixXd& B, Eigen::Index from, Eigen::Index count) {
  cholmod_dense view{};
  view.nrow = static_cast<std::size_t>(B.rows());
  view.ncol = static_cast<std::size_t>(count);
  view.nzmax = static_cast<std::size_t>(B.rows() * count);
  view.d = view.nrow;
  view.x = const_cast<double*>(B.data() + from * B.rows());
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  return view;
}

inline cholmod_dense cholmod_view(const Eigen::MatrixXd& B) { return cholmod_view(B, 0, B.cols()); }

inline Eigen::Map<const Eigen::MatrixXd> eigen_view(const cholmod_dense& B) {
  return {static_cast<const double*>(B.x), static_cast<Eigen::Index>(B.nrow), static_cast<Eigen::Index>(B.ncol)};
}

}  // namespace variform
