// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "framework/base/types.h"

namespace variform {

/// Symmetric positive definite approximation of the inverse of a symmetric positive definite matrix, which is given by
/// its lower triangle. The phases are those of LinearBackend; all throw SolverError on failure.
class Preconditioner {
 public:
  virtual ~Preconditioner() = default;
  virtual void analyze(const SparseMatrix& A) = 0;     ///< of the pattern
  virtual void factorize(const SparseMatrix& A) = 0;   ///< for new values
  virtual void apply(const Vector& r, Vector& z) = 0;  ///< z = approximately A^-1 r; z has the size of r
  virtual double bytes() const { return -1.0; }        ///< what it keeps; -1: unknown
};

struct MultigridOptions {
  std::string method;   ///< "boomeramg" (hypre) or "gamg" (PETSc)
  Index block_size;     ///< unknowns per vertex, which follow each other
  std::string options;  ///< in PETSc's syntax, for instance "-pc_hypre_boomeramg_strong_threshold 0.5"
};

/// One V-cycle of an algebraic multigrid method. Throws UsageError where PETSc is not compiled in.
std::unique_ptr<Preconditioner> make_multigrid(const MultigridOptions& options);

}  // namespace variform
