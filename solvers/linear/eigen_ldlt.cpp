// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/eigen_simplicial.h"
#include "solvers/linear/linear_backends.h"

namespace variform {

LinearBackendEntry describe_eigen_ldlt() {
  LinearBackendEntry entry;
  entry.name = "eigen.ldlt";
  entry.doc = "sparse LDL' without square roots, column by column: for small factors";
  entry.capabilities = {.spd = true};
  entry.licence = "MPL-2.0";
  entry.make = [name = entry.name](const Parameters&) {
    return std::make_unique<EigenSimplicial<Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower>>>(name);
  };
  return entry;
}

}  // namespace variform
