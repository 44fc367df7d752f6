// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "framework/form/problem.h"
#include "framework/solver/eigen_backend.h"

namespace variform {

/// What measures |u|^2 in H x = lambda M x.
enum class SpectrumMetric {
  mass,      ///< M is the consistent mass matrix on vertices, the same for every unknown of a vertex
  identity,  ///< M = I: lambda is the energy of x (Martinez Esturo 2013, sec. 4.4)
};

/// The count smallest eigenpairs of the Hessian of a regularized energy, H x = lambda M x: H is the normal matrix of
/// the problem for its current (E, W), without its constraints. Motions that the energy does not see have lambda = 0.
/// Eigenvectors are of length unknowns |V|, the unknowns of a vertex side by side; where coordinates are solved for
/// separately (one unknown per vertex), they are functions on the vertices. With the mass matrix, lambda is measured in
/// units of energy per |u|^2 and measure of the domain. Throws as EigenBackend::solve.
EigenPairs spectrum(Problem& problem, EigenBackend& backend, Index count, SpectrumMetric metric = SpectrumMetric::mass);

}  // namespace variform
