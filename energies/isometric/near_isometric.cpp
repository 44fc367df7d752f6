// SPDX-License-Identifier: BSD-3-Clause
#include "energies/isometric/near_isometric.h"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

// Midpoint rule: the ends of the edge of each midpoint.
constexpr std::array<std::array<int, 2>, 3> kMidpoints = {{{0, 1}, {1, 2}, {2, 0}}};

Matrix3d cross_matrix(const Vector3d& a) {
  Matrix3d C;
  C << 0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0;
  return C;
}

// Corners relative to the centroid.
Matrix3d centred(const Matrix3d& corners) { return corners.colwise() - corners.rowwise().mean(); }

double area(const Matrix3d& corners) {
  return 0.5 * Vector3d(corners.col(1) - corners.col(0)).cross(Vector3d(corners.col(2) - corners.col(0))).norm();
}

// W with r^r = sum_k W_k v_k, the blocks W_k side by side; Y: centred corners. The area of C = (A/12) sum y y' cancels.
Eigen::Matrix<double, 3, 9> angular_fit(const Matrix3d& Y) {
  const Matrix3d C = Y * Y.transpose();
  const Matrix3d inverse = (C.trace() * Matrix3d::Identity() - C).inverse();
  Eigen::Matrix<double, 3, 9> W;
  for (int k = 0; k < 3; ++k) W.middleCols<3>(3 * k) = inverse * cross_matrix(Y.col(k));
  return W;
}

Matrix3d corners_of(const Domain& domain, Index t) {
  Matrix3d corners;
  for (int i = 0; i < 3; ++i) corners.col(i) = domain.positions().row(domain.cells()(t, i)).transpose();
  return corners;
}

// Weighted by the measures of the cells, the rows give E_t: the field less its rigid fit at the midpoints.
void set_distortion(const Matrix3d& corners, Eigen::Map<Matrix9d>& E) {
  const Matrix3d Y = centred(corners);
  const Eigen::Matrix<double, 3, 9> W = angular_fit(Y);
  for (int m = 0; m < 3; ++m) {
    const auto [i, j] = kMidpoints[m];
    const Matrix3d C = cross_matrix(0.5 * (Y.col(i) + Y.col(j)));
    for (int k = 0; k < 3; ++k) {
      auto block = E.block<3, 3>(3 * m, 3 * k);
      block = C * W.middleCols<3>(3 * k);  // -(r^r x y) = C r^r
      block.diagonal().array() += (k == i || k == j ? 0.5 : 0.0) - 1.0 / 3.0;
    }
  }
  E *= std::sqrt(1.0 / 3.0);
}

// M of E_t = h' M h for the rates h of the edges (columns of e), and area A.
Matrix3d edge_form(const Matrix3d& e, double A) {
  const Vector3d u(e.col(1).dot(e.col(2)), e.col(2).dot(e.col(0)), e.col(0).dot(e.col(1)));
  Matrix3d M = 3.0 * u * u.transpose();
  M.array() -= 8.0 * A * A;
  M.diagonal().array() += 24.0 * A * A;
  return M / (144.0 * A * e.squaredNorm());
}

// Edge k is opposite to corner k.
Matrix3d edges_of(const Matrix3d& corners) {
  Matrix3d e;
  for (int k = 0; k < 3; ++k) e.col(k) = corners.col((k + 2) % 3) - corners.col((k + 1) % 3);
  return e;
}

// Upper triangle R with R'R = A, for a positive semi-definite A.
Matrix3d upper_root(const Matrix3d& A) {
  Matrix3d R = Matrix3d::Zero();
  for (int k = 0; k < 3; ++k) {
    const double pivot = A(k, k) - R.col(k).head(k).squaredNorm();
    if (!(pivot > 0.0)) continue;
    R(k, k) = std::sqrt(pivot);
    for (int j = k + 1; j < 3; ++j) R(k, j) = (A(k, j) - R.col(k).head(k).dot(R.col(j).head(k))) / R(k, k);
  }
  return R;
}

// S of the two triangles l, r at a facet as a sum of 12 squares. The rigid fit is a projection: over t' the squared
// distance of v to the rigid field of t is E_t' and that of the two rigid fields. These differ by a rigid field d, and
// its integral over both triangles is that of a rigid body: (A_l + A_r) |d|^2 at the centre of mass, and the inertia
// tensor about it applied to the spin of d. nodes: the vertices of l, then the one of r that is not among them.
void set_smoothness(const Domain& domain, Index l, Index r, const Index* nodes,
                    Eigen::Map<Eigen::Matrix<double, 12, 12>>& E) {
  const std::array<Index, 2> triangles = {l, r};
  std::array<Matrix3d, 2> corners = {corners_of(domain, l), corners_of(domain, r)};
  const Vector3d origin = corners[0].col(0);
  std::array<Vector3d, 2> centroids;
  std::array<double, 2> areas;
  Vector3d centre = Vector3d::Zero();
  for (int side = 0; side < 2; ++side) {
    corners[side].colwise() -= origin;
    centroids[side] = corners[side].rowwise().mean();
    areas[side] = domain.cell_measures()[triangles[side]];
    centre += areas[side] * centroids[side];
  }
  const double total = areas[0] + areas[1];
  centre /= total;
  Matrix3d moments = Matrix3d::Zero();
  for (int side = 0; side < 2; ++side) {
    const Vector3d arm = centroids[side] - centre;
    const Matrix3d Y = corners[side].colwise() - centroids[side];
    moments += areas[side] / 12.0 * Y * Y.transpose() + areas[side] * arm * arm.transpose();
  }
  const Matrix3d inertia = upper_root(moments.trace() * Matrix3d::Identity() - moments);
  const double mass = std::sqrt(total);
  E.setZero();
  for (int side = 0; side < 2; ++side) {
    const double sign = side == 0 ? -1.0 : 1.0;
    const Matrix3d Y = corners[side].colwise() - centroids[side];
    const Eigen::Matrix<double, 3, 9> W = sign * angular_fit(Y);
    const Matrix3d lever = -mass * cross_matrix(centre - centroids[side]);
    const Matrix3d e = edges_of(corners[side]);
    const Matrix3d root = upper_root(edge_form(e, areas[side]));
    for (int k = 0; k < 3; ++k) {
      int at = 0;
      while (nodes[at] != domain.cells()(triangles[side], k)) ++at;
      const Matrix3d W_k = W.middleCols<3>(3 * k);
      auto shift = E.block<3, 3>(0, 3 * at);
      shift += lever * W_k;
      shift.diagonal().array() += sign * mass / 3.0;
      E.block<3, 3>(3, 3 * at) += inertia * W_k;
      // Corner k is the end of edge k + 1 and the start of edge k + 2 (see edge_rates).
      const int ends = (k + 1) % 3;
      const int starts = (k + 2) % 3;
      E.block<3, 3>(6 + 3 * side, 3 * at) =
          root.col(ends) * e.col(ends).transpose() - root.col(starts) * e.col(starts).transpose();
    }
  }
}

}  // namespace

Eigen::Matrix<double, 6, 9> rigid_fit(const Matrix3d& corners) {
  Eigen::Matrix<double, 6, 9> P;
  P.topRows<3>() = angular_fit(centred(corners));
  for (int k = 0; k < 3; ++k) P.block<3, 3>(3, 3 * k) = Matrix3d::Identity() / 3.0;
  return P;
}

Matrix9d near_isometric_by_projections(const Matrix3d& corners) {
  const Matrix3d Y = centred(corners);
  Eigen::Matrix<double, 9, 6> R;
  Matrix9d N;
  for (int i = 0; i < 3; ++i) {
    R.block<3, 3>(3 * i, 0) = -cross_matrix(Y.col(i));
    R.block<3, 3>(3 * i, 3).setIdentity();
    for (int j = 0; j < 3; ++j) {
      N.block<3, 3>(3 * i, 3 * j) = area(corners) / (i == j ? 6.0 : 12.0) * Matrix3d::Identity();
    }
  }
  const Matrix9d rest = Matrix9d::Identity() - R * (R.transpose() * N * R).llt().solve(R.transpose() * N);
  return rest.transpose() * N * rest;
}

Matrix9d near_isometric_by_strains(const Matrix3d& corners) {
  const Matrix3d Y = centred(corners);
  Eigen::Matrix<double, 3, 2> frame;
  frame.col(0) = Vector3d(Y.col(1) - Y.col(0)).normalized();
  const Vector3d normal = Vector3d(Y.col(1) - Y.col(0)).cross(Vector3d(Y.col(2) - Y.col(0))).normalized();
  frame.col(1) = normal.cross(Vector3d(frame.col(0)));
  const Eigen::Matrix<double, 2, 3> y = frame.transpose() * Y;
  const Eigen::Matrix2d C = area(corners) / 12.0 * y * y.transpose();
  // Gradients of the hat functions; strain rates (e_11, e_22, e_12) of v.
  Eigen::Matrix2d edges;
  edges << (y.col(1) - y.col(0)).transpose(), (y.col(2) - y.col(0)).transpose();
  Eigen::Matrix<double, 2, 3> G;
  G.rightCols<2>() = edges.inverse();
  G.col(0) = -G.col(1) - G.col(2);
  Eigen::Matrix<double, 3, 9> strain;
  for (int k = 0; k < 3; ++k) {
    strain.block<1, 3>(0, 3 * k) = G(0, k) * frame.col(0).transpose();
    strain.block<1, 3>(1, 3 * k) = G(1, k) * frame.col(1).transpose();
    strain.block<1, 3>(2, 3 * k) = 0.5 * (G(1, k) * frame.col(0) + G(0, k) * frame.col(1)).transpose();
  }
  Matrix3d form;                  // Tr(e^2 C)
  form << C(0, 0), 0.0, C(0, 1),  //
      0.0, C(1, 1), C(0, 1),      //
      C(0, 1), C(0, 1), C.trace();
  const Vector3d turn(-C(0, 1), C(0, 1), C(0, 0) - C(1, 1));  // Tr(e J C)
  form -= turn * turn.transpose() / C.trace();
  return strain.transpose() * form * strain;
}

Eigen::Matrix<double, 3, 9> edge_rates(const Matrix3d& corners) {
  Eigen::Matrix<double, 3, 9> rates = Eigen::Matrix<double, 3, 9>::Zero();
  for (int k = 0; k < 3; ++k) {
    const int from = (k + 1) % 3;
    const int to = (k + 2) % 3;
    const Vector3d e = corners.col(to) - corners.col(from);
    rates.block<1, 3>(k, 3 * to) = e.transpose();
    rates.block<1, 3>(k, 3 * from) = -e.transpose();
  }
  return rates;
}

Matrix9d near_isometric_by_edges(const Matrix3d& corners) {
  const Eigen::Matrix<double, 3, 9> h = edge_rates(corners);
  return h.transpose() * edge_form(edges_of(corners), area(corners)) * h;
}

EnergyTraits SurfaceVelocityEnergy::traits(const Domain& domain) const {
  if (domain.kind() != DomainKind::surface) {
    throw UsageError("near-isometric velocities need a surface domain, this one is " + to_string(domain.kind()) +
                     "; vector-field energies (akvf, metr, ...) take planar and tetrahedral ones");
  }
  // A triangle without neighbours has no smoothness.
  std::vector<Index> cells(static_cast<std::size_t>(domain.component_count()), 0);
  for (const Index component : domain.cell_components()) ++cells[component];
  const bool neighbours = std::find(cells.begin(), cells.end(), 1) == cells.end();
  return {.residuals = measure_ == SurfaceMeasure::distortion ? 9 : 3,
          .unknowns = 3,
          .columns = 1,
          .kernel = Kernel::other,
          .regularizer_kernel = neighbours ? Kernel::rigid_motions : Kernel::other};
}

Form SurfaceVelocityEnergy::declare(const Domain& domain) const {
  Form form(domain.vertex_count(), domain.cells(), traits(domain).residuals, 3, 1);
  refresh_operator(domain, form);
  return form;
}

void SurfaceVelocityEnergy::refresh_operator(const Domain& domain, Form& form) const {
  parallel_for(domain.cell_count(), [&](Index t) {
    const Matrix3d corners = corners_of(domain, t);
    if (measure_ == SurfaceMeasure::distortion) {
      Eigen::Map<Matrix9d> E(form.block_data(t));
      set_distortion(corners, E);
    } else {
      // The norm weighs by the measure of the triangle, this energy does not.
      Eigen::Map<Eigen::Matrix<double, 3, 9>>(form.block_data(t)) =
          edge_rates(corners) / std::sqrt(domain.cell_measures()[t]);
    }
  });
}

std::optional<Term> SurfaceVelocityEnergy::regularizer(const Domain& domain, const NormOptions&) const {
  IndexMatrix nodes(domain.facet_count(), 4);
  for (Index f = 0; f < domain.facet_count(); ++f) {
    nodes.row(f).head(3) = domain.cells().row(domain.facet_cells()(f, 0));
    for (const Index v : domain.cells().row(domain.facet_cells()(f, 1))) {
      if (v != domain.facet_vertices()(f, 0) && v != domain.facet_vertices()(f, 1)) nodes(f, 3) = v;
    }
  }
  Form form(domain.vertex_count(), nodes, 12, 3, 1);
  refresh_regularizer(domain, form);
  return Term{std::move(form), diagonal_norm(Vector::Ones(domain.facet_count()))};
}

void SurfaceVelocityEnergy::refresh_regularizer(const Domain& domain, Form& form) const {
  parallel_for(domain.facet_count(), [&](Index f) {
    Eigen::Map<Eigen::Matrix<double, 12, 12>> E(form.block_data(f));
    set_smoothness(domain, domain.facet_cells()(f, 0), domain.facet_cells()(f, 1), form.nodes().data() + form.offset(f),
                   E);
  });
}

EnergyEntry describe_near_isometric() {
  return {
      .name = "near_isometric",
      .doc =
          "near-isometric velocities of surfaces: distance to rigid fields per triangle, and their smoothness as "
          "regularizer, beta = omega in [0, 1] (Martinez Esturo 2013, ch. 4)",
      .domains = "surface",
      .velocities = true,
      .make = [](const Parameters&) { return std::make_unique<SurfaceVelocityEnergy>(SurfaceMeasure::distortion); }};
}

EnergyEntry describe_edge_lengths() {
  return {
      .name = "edge_lengths",
      .doc =
          "squared rates of the squared lengths of all edges of each triangle, with the regularizer of "
          "near_isometric; for comparisons (Martinez Esturo 2013, sec. 4.1.3)",
      .domains = "surface",
      .velocities = true,
      .make = [](const Parameters&) { return std::make_unique<SurfaceVelocityEnergy>(SurfaceMeasure::edge_lengths); }};
}

}  // namespace variform
