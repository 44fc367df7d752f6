// SPDX-License-Identifier: BSD-3-Clause
#include "solvers/linear/eigen_simplicial.h"
#include "solvers/linear/linear_backends.h"

namespace variform {

LinearBackendEntry describe_eigen_llt() {
  LinearBackendEntry entry;
  entry.name = "eigen.llt";
  entry.doc = "sparse LL', column by column";
  entry.capabilities = {.spd = true};
  entry.licence = "MPL-2.0";
  entry.make = [name = entry.name](const Parameters&) {
    return std::make_unique<EigenSimplicial<Eigen::SimplicialLLT<SparseMatrix, Eigen::Lower>>>(name);
  };
  return entry;
}

}  // namespace variform
