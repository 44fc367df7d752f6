// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "framework/form/energy.h"

namespace variform {

/// The velocity field of a triangle (linear, 9 values v_1, v_2, v_3 vertex by vertex) has a closest rigid field r(x) =
/// r^t + r^r x (x - centroid), and the energy of Martinez Esturo 2013, sec. 4.1, is what remains of it:
///
///   E_t(v) = min over r of the integral over t of |v - r|^2.
///
/// Corners are the columns of a 3 x 3 matrix, anywhere in space, not on one line. E_t vanishes exactly where the
/// lengths of the edges do not change to first order; out-of-plane velocities that bend no triangle cost nothing within
/// it.

/// (r^r; r^t), 6 x 9: angular velocity, and velocity at the centroid (sec. 4.2; closed form about the centroid, so that
/// it is as accurate far from the origin).
Eigen::Matrix<double, 6, 9> rigid_fit(const Eigen::Matrix3d& corners);

/// The quadratic form of E_t in v, 9 x 9, in three expressions of the same: by projections, (I - R P)' N (I - R P) with
/// the mass matrix N (sec. 4.2.2); by the in-plane strain rate e and second moments C, Tr(e^2 C) - Tr(e J C)^2 / Tr C;
/// by the rates h_k of the edges, h' M h (sec. 4.1.3; repaired, see docs/errata.md).
Eigen::Matrix<double, 9, 9> near_isometric_by_projections(const Eigen::Matrix3d& corners);
Eigen::Matrix<double, 9, 9> near_isometric_by_strains(const Eigen::Matrix3d& corners);
Eigen::Matrix<double, 9, 9> near_isometric_by_edges(const Eigen::Matrix3d& corners);

/// Rates of the edges, h_k = e_k . (v_{k+2} - v_{k+1}) with e_k = x_{k+2} - x_{k+1} opposite to corner k: half the rate
/// of the squared length; 3 x 9.
Eigen::Matrix<double, 3, 9> edge_rates(const Eigen::Matrix3d& corners);

/// How a velocity field of a surface is measured on one triangle.
enum class SurfaceMeasure {
  distortion,    ///< E_t: near-isometric
  edge_lengths,  ///< h_1^2 + h_2^2 + h_3^2, whatever the size of the triangle: the measure of the literature that sec.
                 ///< 4.1.3 compares with
};

/// Energies of velocity fields on triangle meshes in space (d = 3, coupled, c = 0) on the current shape, with the
/// smoothness of Martinez Esturo 2013, sec. 4.1.2, as the regularizer of their own: the rigid field of every triangle
/// is compared with the field of its neighbours,
///
///   S = sum over pairs t, t' that share an edge, in both orders, of the integral over t' of |v - r_t|^2.
///
/// The problem is (1 - beta) E + beta S with beta the omega of the source (1/3 there), 0 <= beta <= 1. n = 9 residuals
/// per triangle, the remainder at the midpoints of its edges (where the midpoint rule is exact), or 3 rates of edges. S
/// is held as 12 squares per edge: the rigid fits of the two triangles differ by a rigid field, which is integrated
/// over both as over a rigid body, and each brings its E_t (the fit is a projection, so S_t,t' = E_t' plus that part).
///
/// Kernel: rigid motions for beta > 0 (facet-connected meshes with two triangles at least). Alone, E does not see the
/// infinitesimal isometries, which a closed convex surface has not, but a surface with a boundary or a planar one has:
/// Kernel::other at beta = 0.
class SurfaceVelocityEnergy final : public Energy {
 public:
  explicit SurfaceVelocityEnergy(SurfaceMeasure measure) : measure_(measure) {}

  /// Throws UsageError unless the domain is a surface.
  EnergyTraits traits(const Domain& domain) const override;
  Form declare(const Domain& domain) const override;
  void refresh_operator(const Domain& domain, Form& form) const override;
  std::optional<Term> regularizer(const Domain& domain, const NormOptions& norm) const override;
  void refresh_regularizer(const Domain& domain, Form& form) const override;

 private:
  SurfaceMeasure measure_;
};

}  // namespace variform
