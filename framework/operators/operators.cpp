// SPDX-License-Identifier: BSD-3-Clause
#include "framework/operators/operators.h"

#include <Eigen/Geometry>

#include <cstddef>
#include <vector>

namespace variform {
namespace {

/// Assembles sum over cells of the dense local matrices local(t), (m+1) x (m+1).
template <class Local>
SparseMatrix assemble_vertices(const Domain& domain, const Local& local) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  const int corners = domain.cell_size();
  triplets.reserve(static_cast<std::size_t>(domain.cell_count()) * corners * corners);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const Eigen::MatrixXd block = local(t);
    for (int i = 0; i < corners; ++i) {
      for (int j = 0; j < corners; ++j) {
        triplets.emplace_back(domain.cells()(t, i), domain.cells()(t, j), block(i, j));
      }
    }
  }
  SparseMatrix result(domain.vertex_count(), domain.vertex_count());
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

}  // namespace

SparseMatrix gradient_matrix(const Domain& domain) {
  std::vector<Eigen::Triplet<double, Index>> triplets;
  const Index cells = domain.cell_count();
  const int p = domain.ambient_dimension();
  for (Index t = 0; t < cells; ++t) {
    const auto G = domain.gradient(t);
    for (int r = 0; r < p; ++r) {
      for (int i = 0; i < domain.cell_size(); ++i) {
        triplets.emplace_back(r * cells + t, domain.cells()(t, i), G(r, i));
      }
    }
  }
  SparseMatrix result(p * cells, domain.vertex_count());
  result.setFromTriplets(triplets.begin(), triplets.end());
  return result;
}

SparseMatrix cotangent_laplacian(const Domain& domain) {
  return assemble_vertices(domain, [&](Index t) -> Eigen::MatrixXd {
    const auto G = domain.gradient(t);
    return domain.cell_measures()[t] * G.transpose() * G;
  });
}

SparseMatrix mass_matrix(const Domain& domain) {
  const int corners = domain.cell_size();
  const double m = domain.intrinsic_dimension();
  return assemble_vertices(domain, [&](Index t) -> Eigen::MatrixXd {
    // m!/(m+2)! = 1/((m+1)(m+2)).
    const double scale = domain.cell_measures()[t] / ((m + 1.0) * (m + 2.0));
    return scale * (Eigen::MatrixXd::Ones(corners, corners) + Eigen::MatrixXd::Identity(corners, corners));
  });
}

TriangleGradient turned_gradient(const Domain& domain, Index t) {
  const auto G = domain.gradient(t);
  TriangleGradient turned(G.rows(), 3);
  if (G.rows() == 2) {
    turned.row(0) = -G.row(1);
    turned.row(1) = G.row(0);
  } else {
    const Eigen::Vector3d n = domain.normals().row(t);
    for (int i = 0; i < 3; ++i) turned.col(i) = n.cross(Eigen::Vector3d(G.col(i)));
  }
  return turned;
}

SurfaceFrame surface_frame(const Domain& domain, Index t) {
  const auto x = [&](int i) {
    return Eigen::Map<const Eigen::Vector3d>(domain.positions().data() + std::ptrdiff_t{3} * domain.cells()(t, i));
  };
  const Eigen::Map<const Eigen::Vector3d> n(domain.normals().data() + std::ptrdiff_t{3} * t);
  const Eigen::Vector3d edge = (x(1) - x(0)).normalized();
  SurfaceFrame B;
  B.row(0) = edge.transpose();
  B.row(1) = n.cross(edge).transpose();
  return B;
}

TangentFrame edge_frame(const Domain& domain, Index t) {
  if (domain.ambient_dimension() == 3) return surface_frame(domain, t);
  TangentFrame B(2, 2);
  B.row(0) = (domain.positions().row(domain.cells()(t, 1)) - domain.positions().row(domain.cells()(t, 0))).normalized();
  B.row(1) << -B(0, 1), B(0, 0);
  return B;
}

Eigen::MatrixXd deformation(const Domain& domain, Index t, const Matrix& U) {
  Eigen::MatrixXd local(domain.cell_size(), U.cols());
  for (int i = 0; i < domain.cell_size(); ++i) local.row(i) = U.row(domain.cells()(t, i));
  return domain.gradient(t) * local;
}

}  // namespace variform
