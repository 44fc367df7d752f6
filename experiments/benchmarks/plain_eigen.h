// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/SparseCholesky>

#include <vector>

#include "framework/base/types.h"
#include "framework/domain/mesh.h"
#include "framework/form/constraints.h"

/// What one writes with Eigen alone, without the framework: operators from triplets, the normal equations as products
/// of sparse matrices, SimplicialLDLT. Triangles in space, one thread.
namespace variform::benchmarks::plain {

/// Gradient of every triangle, 3|T| x |V|, rows cell by cell; areas of the cells.
struct Gradients {
  SparseMatrix matrix;
  Vector areas;
};
Gradients gradients(const Mesh& mesh);

/// Cauchy-Riemann defect grad u + n x grad v, 3|T| x 2|V|, unknowns (u, v) vertex by vertex; areas of the cells.
Gradients conformal_defect(const Mesh& mesh);

/// W (x) I_n of the W_1 norm with facet weights |f|: (1-beta) A + beta Q'BQ.
SparseMatrix norm(const Mesh& mesh, const Vector& areas, double beta, int n);

/// Z (all unknowns x free unknowns) and the values of the fixed ones (0 elsewhere), for unknowns per vertex 1 or d.
struct Elimination {
  SparseMatrix Z;
  Eigen::MatrixXd fixed;
};
Elimination elimination(const Constraints& constraints, int unknowns);

using Factorization = Eigen::SimplicialLDLT<SparseMatrix>;

}  // namespace variform::benchmarks::plain
