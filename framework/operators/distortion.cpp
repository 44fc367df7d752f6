// SPDX-License-Identifier: BSD-3-Clause
#include "framework/operators/distortion.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "framework/base/error.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

// Singular values of F, descending, the last with the sign of the determinant.
Eigen::Vector2d signed_singular_values(const Eigen::Matrix2d& F) {
  // F is a similarity plus a reflected one; their scales add and subtract.
  const double rotating = std::hypot(F(0, 0) + F(1, 1), F(0, 1) - F(1, 0));
  const double reflecting = std::hypot(F(0, 0) - F(1, 1), F(0, 1) + F(1, 0));
  const double largest = 0.5 * (rotating + reflecting);
  // Not the difference of the two scales: the sign must be that of the determinant, to the last bit.
  return {largest, largest > 0.0 ? F.determinant() / largest : 0.0};
}

Eigen::Vector3d signed_singular_values(const Eigen::Matrix3d& F) {
  Eigen::Vector3d sigma = Eigen::JacobiSVD<Eigen::Matrix3d>(F).singularValues();
  if (F.determinant() < 0.0) sigma[2] = -sigma[2];
  return sigma;
}

// A map of the plane to space, 2 x 3, in a tangent frame of its image: singular values stay, the determinant is the
// ratio of areas.
Eigen::Matrix2d in_image_plane(const SurfaceFrame& F) {
  const Eigen::Vector3d a = F.row(0).transpose();
  const Eigen::Vector3d b = F.row(1).transpose();
  const double length = a.norm();
  Eigen::Matrix2d result;
  if (length > 0.0) {
    result << length, 0.0, a.dot(b) / length, a.cross(b).norm() / length;
  } else {
    result << 0.0, 0.0, b.norm(), 0.0;
  }
  return result;
}

// deformation(t): the D x D deformation gradient of cell t, transposed or not.
template <int D, class Deformation>
CellDistortion cells_of(const Domain& domain, bool signed_determinants, const Deformation& deformation) {
  const double infinity = std::numeric_limits<double>::infinity();
  const Index cells = domain.cell_count();
  CellDistortion result;
  result.singular_values.resize(cells, D);
  for (Vector* field : {&result.determinant, &result.isometric, &result.conformal, &result.authalic, &result.metric,
                        &result.symmetric_dirichlet, &result.conformal_ratio}) {
    field->resize(cells);
  }
  for (Index t = 0; t < cells; ++t) {
    const Eigen::Matrix<double, D, D> F = deformation(t);
    const double determinant = F.determinant();
    const Eigen::Matrix<double, D, 1> sigma = signed_singular_values(F);
    double differences = 0.0;
    for (int i = 0; i < D; ++i) {
      for (int j = i + 1; j < D; ++j) differences += (sigma[i] - sigma[j]) * (sigma[i] - sigma[j]);
    }
    result.singular_values.row(t) = sigma.transpose();
    result.determinant[t] = determinant;
    result.isometric[t] = (sigma.array() - 1.0).square().sum();
    result.conformal[t] = differences / D;
    result.authalic[t] = (determinant - 1.0) * (determinant - 1.0);
    result.metric[t] = result.isometric[t] - differences / (D == 2 ? 4.0 : 5.0);
    const double least = signed_determinants ? 0.0 : kDegenerateImage * sigma[0] * sigma[0];
    const bool flipped = !(determinant > least);
    if (flipped) result.flipped.push_back(t);
    result.symmetric_dirichlet[t] =
        flipped ? infinity : (sigma.array().square() + sigma.array().square().inverse()).sum();
    result.conformal_ratio[t] = flipped ? infinity : sigma[0] / sigma[D - 1];
  }
  return result;
}

}  // namespace

CellDistortion cell_distortion(const Domain& domain, const Matrix& U) {
  const bool surface = domain.kind() == DomainKind::surface;
  const bool fits = U.cols() == domain.ambient_dimension() || (surface && U.cols() == 2);
  if (!fits || U.rows() != domain.vertex_count()) {
    throw UsageError(fmt::format("distortion: {} x {} values on a {} domain with {} vertices", U.rows(), U.cols(),
                                 to_string(domain.kind()), domain.vertex_count()));
  }
  // F_t = G_t U_t: p x d.
  const auto gradient_of_map = [&]<int P, int D>() {
    return [&](Index t) {
      const auto G = domain.gradient(t);
      Eigen::Matrix<double, P, D> F = Eigen::Matrix<double, P, D>::Zero();
      for (int i = 0; i < domain.cell_size(); ++i) F += G.col(i).lazyProduct(U.row(domain.cells()(t, i)));
      return F;
    };
  };
  if (domain.kind() == DomainKind::planar) return cells_of<2>(domain, true, gradient_of_map.operator()<2, 2>());
  if (!surface) return cells_of<3>(domain, true, gradient_of_map.operator()<3, 3>());
  if (U.cols() == 2) {
    const auto F = gradient_of_map.operator()<3, 2>();
    return cells_of<2>(domain, true, [&](Index t) -> Eigen::Matrix2d { return surface_frame(domain, t) * F(t); });
  }
  const auto F = gradient_of_map.operator()<3, 3>();
  return cells_of<2>(domain, false, [&](Index t) { return in_image_plane(surface_frame(domain, t) * F(t)); });
}

Distortion distortion(const Domain& domain, const CellDistortion& cells) {
  if (cells.determinant.size() != domain.cell_count()) {
    throw UsageError(
        fmt::format("distortion: of {} cells on a domain of {}", cells.determinant.size(), domain.cell_count()));
  }
  const auto mean = [&](const Vector& field) {
    double sum = 0.0;
    for (Index t = 0; t < domain.cell_count(); ++t) {
      sum += domain.cell_measures()[t] / domain.total_measure() * field[t];
    }
    return sum;
  };
  return {.isometric = mean(cells.isometric),
          .conformal = mean(cells.conformal),
          .authalic = mean(cells.authalic),
          .metric = mean(cells.metric),
          .symmetric_dirichlet = mean(cells.symmetric_dirichlet),
          .max_conformal_ratio = cells.conformal_ratio.maxCoeff(),
          .min_determinant = cells.determinant.minCoeff(),
          .area_ratio = mean(cells.determinant),
          .flipped = cells.flipped};
}

Distortion distortion(const Domain& domain, const Matrix& U) { return distortion(domain, cell_distortion(domain, U)); }

Index boundary_crossings(const Domain& domain, const Matrix& U) {
  const IndexMatrix& edges = domain.boundary_facets();
  if (domain.kind() == DomainKind::tetrahedral || U.rows() != domain.vertex_count() || U.cols() != 2) {
    throw UsageError("boundary crossings: images of triangle meshes in the plane only");
  }
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
