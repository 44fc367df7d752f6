// SPDX-License-Identifier: BSD-3-Clause
#include "framework/operators/distortion.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "framework/base/error.h"
#include "framework/operators/operators.h"

namespace variform {

Distortion distortion(const Domain& domain, const Matrix& U) {
  const int d = domain.ambient_dimension();
  if (domain.kind() == DomainKind::surface || U.rows() != domain.vertex_count() || U.cols() != d) {
    throw UsageError(fmt::format("distortion: {} x {} values on a {} domain with {} vertices", U.rows(), U.cols(),
                                 to_string(domain.kind()), domain.vertex_count()));
  }
  Distortion result;
  result.min_determinant = std::numeric_limits<double>::infinity();
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::MatrixXd F = deformation(domain, t, U);
    const double determinant = F.determinant();
    Vector sigma = Eigen::JacobiSVD<Eigen::MatrixXd>(F).singularValues();
    if (determinant < 0.0) sigma[d - 1] = -sigma[d - 1];
    double differences = 0.0;
    for (int i = 0; i < d; ++i) {
      for (int j = i + 1; j < d; ++j) differences += (sigma[i] - sigma[j]) * (sigma[i] - sigma[j]);
    }
    const double weight = domain.cell_measures()[t] / domain.total_measure();
    const double isometric = (sigma.array() - 1.0).square().sum();
    result.isometric += weight * isometric;
    result.conformal += weight * differences / d;
    result.authalic += weight * (determinant - 1.0) * (determinant - 1.0);
    result.metric += weight * (isometric - differences / (d == 2 ? 4.0 : 5.0));
    result.area_ratio += weight * determinant;
    result.min_determinant = std::min(result.min_determinant, determinant);
    if (!(determinant > 0.0)) result.flipped.push_back(t);
  }
  return result;
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
