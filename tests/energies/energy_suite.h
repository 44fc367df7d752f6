// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "framework/domain/domain.h"
#include "framework/form/constraints.h"
#include "framework/form/energy.h"

namespace variform::testing {

/// What every energy must satisfy, whatever it is; call it from a test for each domain that the energy takes. Checks on
/// the given (small) domain, for several beta and all facet weights: shapes of the form; assembled normal equations
/// against the plain sparse product; the stacked least-squares form against value and normal matrix; gradient of the
/// energy against finite differences; the declared kernel (of the regularized energy) against an eigen-decomposition;
/// agreement of all linear backends, and a gradient that vanishes at all free vertices; that targets are the closest
/// ones, for energies whose targets depend on the state; the rest pose as a fixed point when `rest_is_minimal`.
void check_energy(const std::string& label, const Energy& energy, const Domain& domain, bool rest_is_minimal);

/// Constraints that fix the given vertices at their rest positions plus an offset.
Constraints fixed_at(const Domain& domain, int dimension,
                     const std::vector<std::pair<Index, Eigen::RowVectorXd>>& moves);

}  // namespace variform::testing
