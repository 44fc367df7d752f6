// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "framework/form/energy.h"

namespace variform {

/// Weights of the vector-field energies of Martinez Esturo 2013, ch. 3: of velocities v with Jacobian J, per unit
/// measure,
///
///   strain |J + J'|^2_B + divergence tr(B J)^2,   |Y|^2_B = tr(Y' B Y),
///
/// with a symmetric positive definite tensor B (the identity where the material is isotropic).
struct VectorFieldWeights {
  double strain = 1.0;
  double divergence = 0.0;
};

/// The named energies, in the scaling of the source's explicit matrices, p the dimension:
enum class VectorFieldKind {
  killing,    ///< (1, 0): rate of change of lengths (akvf)
  metric,     ///< (1, 2): mean over all directions of the squared rate of squared length, times 4 in 2-D and 15/2 in
              ///< 3-D (metr; errata C9)
  conformal,  ///< (1, -4/tr B): rate of change of angles (conf)
  authalic,   ///< (parameter, 1): rate of change of area or volume, with a little strain (auth)
  phi,        ///< (sin parameter, cos parameter): the family that joins them
};

/// (sin phi, cos phi): Killing at pi/2, metric at arctan(1/2), conformal at largest_phi.
VectorFieldWeights phi_weights(double phi);

/// pi - arctan(tr(B)/4): the energy is non-negative for phi in (0, largest_phi] exactly. tr(B) = p if B = I.
double largest_phi(double trace);

/// The quadratic form M in j = vec(J), p^2 x p^2: energy density j' M j; the same in vec(J').
Eigen::MatrixXd vector_field_matrix(const VectorFieldWeights& weights, const Eigen::MatrixXd& B);

/// The symmetric positive semi-definite root S of M, S^2 = M, in closed form for B = I in dimension p:
/// S = 2 sqrt(strain) P_sym + sqrt(4 strain + p divergence) P_tr with the projections to symmetric trace-free matrices
/// and to multiples of the identity. Throws UsageError when M is indefinite.
Eigen::MatrixXd vector_field_root(const VectorFieldWeights& weights, int p);

/// The root for a tensor B (p x p), by eigen-decomposition on symmetric matrices (M vanishes on antisymmetric ones);
/// eigenvalues below 1e-12 of the largest one count as 0. Throws UsageError when M is indefinite.
Eigen::MatrixXd vector_field_root(const VectorFieldWeights& weights, const Eigen::MatrixXd& B);

/// What beta weighs in a vector-field energy.
enum class Smoothness {
  residual,  ///< the variation of the residual S_t j_t: the norm W_n (Martinez Esturo 2013, sec. 7.2)
  gradient,  ///< the variation of the gradient of the energy density, E_S = sum_f 4 b_f |M_l j_l - M_r j_r|^2 (sec.
             ///< 3.4.4, eq. 23) with the facet weights b_f of the norm (facet_measure as published)
};

/// The source minimizes E + alpha E_S; with Smoothness::gradient that is, up to the factor 1 + alpha, the problem for
/// beta = alpha / (1 + alpha). alpha >= 0 is a length for FacetWeight::facet_measure: the mesh scaled by s has the same
/// minimizer for s alpha. E_S grows with the square of the weights of an energy, E itself linearly: alpha has its
/// meaning for one scaling of them only. Throw UsageError for values out of range.
double beta_from_alpha(double alpha);
/// And back; beta in [0, 1).
double alpha_from_beta(double beta);

/// beta of W_n (Smoothness::residual) with the minimizer of E + alpha E_S where M acts as one factor m on all that it
/// sees: beta / (1 - beta) = 4 m alpha.
double residual_beta(double alpha, double m);

/// That factor m, the only non-zero eigenvalue of M for B = I in dimension p: 4 strain without divergence (Killing) and
/// at the conformal end, p divergence without strain. None for all others, where no single beta fits.
std::optional<double> only_stiffness(const VectorFieldWeights& weights, int p);

/// Energy of velocity fields on planar and tetrahedral domains, residual S_t vec(J) on every cell: n = p^2, d = p,
/// coupled, c = 0. Unknowns are velocities on the current shape: u = 0 is the rest state.
///
/// Kernel: rigid motions; similarities where every cell is at the conformal end of the range; Kernel::other without
/// strain. That of E_S alone (Smoothness::gradient and beta = 1) holds all affine fields where M is constant, and is
/// not checked.
class VectorFieldEnergy final : public CellEnergy {
 public:
  /// parameter: of each cell, or one for all (ignored by kinds without one). tensors: B_t of each cell, cells x p^2, or
  /// one row for all, or none for B = I. Throws UsageError for strain or phi out of every range, DataError naming the
  /// cell whose tensor is not symmetric positive definite.
  VectorFieldEnergy(VectorFieldKind kind, Vector parameter, const Matrix& tensors = {},
                    Smoothness smoothness = Smoothness::residual);

  /// New tensors in the places of the old ones, for shapes that move: see rotated_tensors.
  void set_tensors(const Matrix& tensors);

  VectorFieldKind kind() const { return kind_; }
  const Vector& parameter() const { return parameter_; }
  const Matrix& tensors() const { return tensors_; }
  Smoothness smoothness() const { return smoothness_; }
  /// Of an isotropic material in dimension p (of the first cell where they differ).
  VectorFieldWeights isotropic_weights(int p) const { return weights(0, p); }

  /// Throws UsageError when sizes do not fit the domain, or phi exceeds largest_phi there, naming the cell.
  EnergyTraits traits(const Domain& domain) const override;
  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override;
  void refresh_operator(const Domain& domain, Form& form) const override;
  std::optional<Term> regularizer(const Domain& domain, const NormOptions& norm) const override;
  void refresh_regularizer(const Domain& domain, Form& form) const override;

 private:
  // S_t H_t (the residual), or 2 M_t H_t (the gradient of the energy density), for all cells.
  template <int p>
  void fill(const Domain& domain, Smoothness what, Form& form) const;
  void fill(const Domain& domain, Smoothness what, Form& form) const;

  VectorFieldWeights weights(Index t, double trace) const;
  double trace(Index t, int p) const;

  VectorFieldKind kind_;
  Vector parameter_;
  Matrix tensors_;
  Smoothness smoothness_;
  // With tensors only, of each cell or one for all: S_t and 2 M_t.
  std::vector<Eigen::MatrixXd> roots_;
  std::vector<Eigen::MatrixXd> gradients_;
};

/// The phi family with phi of each cell or one for all, tensors as above.
std::unique_ptr<VectorFieldEnergy> make_vector_field_energy(const Vector& phi, const Matrix& tensors = {},
                                                            Smoothness smoothness = Smoothness::residual);

/// Tensors carried along by a deformation of the domain to vertex values U (|V| x p): B_t' = Q B_t Q' with the rotation
/// Q closest to the deformation gradient of the cell, the identity where there is no unique one. One row per cell.
Matrix rotated_tensors(const Domain& domain, const Matrix& U, const Matrix& tensors);
/// The same in place; with set_tensors it allocates nothing when sizes stay.
void rotated_tensors(const Domain& domain, const Matrix& U, const Matrix& tensors, Matrix& result);

}  // namespace variform
