// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "framework/form/energy.h"

namespace variform {

/// Gradient fit: E = G, c = h, a guidance field prescribed on every cell. With beta = 0 this is the discrete Poisson
/// equation L u = G'A h; with h = 0 Laplace's (Martinez Esturo 2013, sec. 7.3 and 9.1). Any domain; the columns of u
/// decouple.
///
/// guidance: cells x (p k), row t is vec of the p x k matrix h_t whose column c is the wanted gradient of column c of
/// u. Throws UsageError when the number of columns is no multiple of p, or, on use, rows do not match the cells.
std::unique_ptr<Energy> make_poisson(const Matrix& guidance, int ambient_dimension);

/// The same h for every cell, p x k.
std::unique_ptr<Energy> make_poisson(const Eigen::MatrixXd& constant_guidance);

}  // namespace variform
