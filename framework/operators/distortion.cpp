// SPDX-License-Identifier: BSD-3-Clause
#include "framework/operators/distortion.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "framework/base/error.h"

namespace variform {
namespace {

// Singular values of F, descending, the last with the sign of the determinant.
Eigen::Vector2d signed_singular_values(const Eigen::Matrix2d& F) {
  // F is a similarity plus a reflected one; their scales add and subtract.
  const double rotating = std::hypot(F(0, 0) + F(1, 1), F(0, 1) - F(1, 0));
  const double reflecting = std::hypot(F(0, 0) - F(1, 1), F(0, 1) + F(1, 0));
  return {0.5 * (rotating + reflecting), 0.5 * (rotating - reflecting)};
}

Eigen::Vector3d signed_singular_values(const Eigen::Matrix3d& F) {
  Eigen::Vector3d sigma = Eigen::JacobiSVD<Eigen::Matrix3d>(F).singularValues();
  if (F.determinant() < 0.0) sigma[2] = -sigma[2];
  return sigma;
}

template <int D>
Distortion distortion_of(const Domain& domain, const Matrix& U) {
  Distortion result;
  result.min_determinant = std::numeric_limits<double>::infinity();
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const auto G = domain.gradient(t);
    Eigen::Matrix<double, D, D> F = Eigen::Matrix<double, D, D>::Zero();
    for (int i = 0; i <= D; ++i) F.noalias() += G.col(i) * U.row(domain.cells()(t, i));
    const double determinant = F.determinant();
    const Eigen::Matrix<double, D, 1> sigma = signed_singular_values(F);
    double differences = 0.0;
    for (int i = 0; i < D; ++i) {
      for (int j = i + 1; j < D; ++j) differences += (sigma[i] - sigma[j]) * (sigma[i] - sigma[j]);
    }
    const double weight = domain.cell_measures()[t] / domain.total_measure();
    const double isometric = (sigma.array() - 1.0).square().sum();
    result.isometric += weight * isometric;
    result.conformal += weight * differences / D;
    result.authalic += weight * (determinant - 1.0) * (determinant - 1.0);
    result.metric += weight * (isometric - differences / (D == 2 ? 4.0 : 5.0));
    result.area_ratio += weight * determinant;
    result.min_determinant = std::min(result.min_determinant, determinant);
    if (!(determinant > 0.0)) result.flipped.push_back(t);
  }
  return result;
}

}  // namespace

Distortion distortion(const Domain& domain, const Matrix& U) {
  const int d = domain.ambient_dimension();
  if (domain.kind() == DomainKind::surface || U.rows() != domain.vertex_count() || U.cols() != d) {
    throw UsageError(fmt::format("distortion: {} x {} values on a {} domain with {} vertices", U.rows(), U.cols(),
                                 to_string(domain.kind()), domain.vertex_count()));
  }
  return d == 2 ? distortion_of<2>(domain, U) : distortion_of<3>(domain, U);
}

Index boundary_crossings(const Domain& domain, const Matrix& U) {
  const IndexMatrix& edges = domain.boundary_facets();
  if (domain.kind() != DomainKind::planar || U.cols() != 2) throw UsageError("boundary crossings: planar meshes only");
  const auto x = [&](Index v) { return Eigen::Vector2d(U.row(v).transpose()); };
  const auto low = [&](Index e) { return std::min(U(edges(e, 0), 0), U(edges(e, 1), 0)); };
  const auto high = [&](Index e) { return std::max(U(edges(e, 0), 0), U(edges(e, 1), 0)); };
  std::vector<Index> order(edges.rows());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](Index a, Index b) { return low(a) < low(b); });
  const auto side = [&](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  };
  Index crossings = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const auto a = x(edges(order[i], 0));
    const auto b = x(edges(order[i], 1));
    for (std::size_t j = i + 1; j < order.size() && low(order[j]) <= high(order[i]); ++j) {
      const auto c = x(edges(order[j], 0));
      const auto d = x(edges(order[j], 1));
      if (side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0) ++crossings;
    }
  }
  return crossings;
}

}  // namespace variform
