// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "framework/base/parameters.h"
#include "framework/base/registry.h"
#include "framework/domain/domain.h"
#include "framework/form/assembly.h"
#include "framework/form/form.h"
#include "framework/form/norm.h"

namespace variform {

/// Which part of (E, c) depends on the state u.
enum class StateDependence {
  none,    ///< linear: E and c are constant
  target,  ///< only c = c(u): local/global alternation keeps one factorization
};

/// Where the residual of an energy lives, hence which norm regularizes it.
enum class Support { cells, vertices };

/// The motions that an energy does not see: constraints must take them away.
enum class Kernel {
  trivial,        ///< none
  constants,      ///< one constant per unknown and component of the domain
  rigid_motions,  ///< translations and linearized rotations (coupled energies)
  similarities,   ///< and scaling
  other,          ///< not checked
};

/// Sizes and nature of an energy on a domain.
struct EnergyTraits {
  int residuals = 0;  ///< n, components of the residual at each site
  int unknowns = 1;   ///< per vertex in one linear system: d if the coordinates are coupled, 1 if they decouple
  int columns = 1;    ///< coordinates solved for with the same operator: 1 if coupled, d if they decouple
  Kernel kernel = Kernel::other;
  Kernel regularizer_kernel = Kernel::other;  ///< of the energy's own regularizer, where it brings one
  Gauge gauge = Gauge::world;
  StateDependence state = StateDependence::none;
  Support support = Support::cells;
  bool barrier = false;  ///< infinite where a target is undefined: states there are refused, see TargetEnergy

  /// d, coordinates of u at each vertex.
  int dimension() const { return unknowns * columns; }
};

/// An energy declares the residual r(u) = E u - c on a domain. It knows geometry and nothing of beta, norms,
/// constraints or solvers. Most energies derive from CellEnergy, which asks for one cell at a time.
class Energy {
 public:
  virtual ~Energy() = default;

  /// Throws UsageError when the energy cannot live on this domain, saying which it takes.
  virtual EnergyTraits traits(const Domain& domain) const = 0;

  /// A form of the right connectivity with E on the positions of the domain, and c at the rest state u = x.
  virtual Form declare(const Domain& domain) const = 0;

  /// New values of E for a domain whose positions moved, in place.
  virtual void refresh_operator(const Domain& domain, Form& form) const = 0;

  /// New values of c for the state U (|V| x d), in place; the same for every U if StateDependence::none. Returns the
  /// number of sites whose target is undefined at U (a closest rotation of a degenerate cell, say): these keep their
  /// last one.
  virtual Index refresh_target(const Domain& domain, const Matrix& U, Form& form) const;

  /// Cell frames for Gauge::cell_frame, cells x 2p; see cell_norm.
  virtual Matrix frames(const Domain& domain) const;

  /// Extension point: a regularizer of the energy's own, a term with weights ||E_S u - c_S||^2_B in place of the W_n
  /// norm. The problem becomes (1-beta) ||E u - c||^2_A + beta times this term, and beta may be 1. Most energies have
  /// none. B must follow the domain by its own Norm::refresh: variation_norm with beta = 1, say, or a diagonal_norm of
  /// ones and weights in the rows of E_S. Of `norm` the facet weight may matter.
  virtual std::optional<Term> regularizer(const Domain& domain, const NormOptions& norm) const;

  /// New values of E_S (and c_S) for a domain whose positions moved, in the form of that term, in place. Energies with
  /// a regularizer must implement it.
  virtual void refresh_regularizer(const Domain& domain, Form& form) const;
};

/// The kernel of (1-beta) times an energy plus beta times its own regularizer, for 0 <= beta <= 1: the kernel of both
/// terms where they are blended, which must be declared by one of them to be known.
Kernel blended_kernel(const EnergyTraits& traits, double beta);

/// Energy with one residual per cell whose operator is local to it.
class CellEnergy : public Energy {
 public:
  /// E_t on the rest positions: n x (unknowns (m+1)), columns vertex by vertex.
  virtual void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const = 0;

  /// c_t for vertex values U (|V| x d), n x columns. Returns false, leaving c as it is, when it is undefined at U.
  /// The default is c = 0.
  virtual bool target(const Domain& domain, Index t, const Matrix& U, Eigen::Ref<Eigen::MatrixXd> c) const;

  Form declare(const Domain& domain) const override;
  void refresh_operator(const Domain& domain, Form& form) const override;
  Index refresh_target(const Domain& domain, const Matrix& U, Form& form) const override;
};

/// Energy whose targets are a function of the values, c_t(u) = c(Y_t) with Y_t = E_t u_t. Everything that nonlinear
/// backends need follows from c, its derivative, and the curvature of |Y - c(Y)|^2.
class TargetEnergy : public CellEnergy {
 public:
  /// A matrix of at most 9 x 9 with its storage in place: c_t and Y_t have at most 9 components.
  using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 9, 9>;

  /// c(Y), both n x columns. Returns false, leaving c as it is, where it is undefined. derivative, unless null:
  /// d vec c / d vec Y, (n columns) x (n columns), zero where it is undefined (c stays).
  virtual bool target_of(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                         Eigen::Ref<Eigen::MatrixXd> c, SmallMatrix* derivative) const = 0;

  /// Rows of curvature_root on this domain, at most n columns.
  virtual int curvature_rank(const Domain& domain) const = 0;
  /// A root R (curvature_rank x (n columns)) of half the Hessian H of |Y - c(Y)|^2 by vec Y, made positive
  /// semi-definite: R'R = H+ / 2, where H+ has the negative eigenvalues of H set to zero; of H as a form on the values
  /// Y = E_t u that the cell can have. Y must be one where c is defined.
  virtual void curvature_root(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                              Eigen::Ref<Eigen::MatrixXd> R) const = 0;

  /// Largest s such that c is defined at Y + s' dY for all s' in [0, s); infinite (the default) without a barrier.
  virtual double longest_step(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                              const Eigen::Ref<const Eigen::MatrixXd>& dY) const;

  bool target(const Domain& domain, Index t, const Matrix& U, Eigen::Ref<Eigen::MatrixXd> c) const override;
  Index refresh_target(const Domain& domain, const Matrix& U, Form& form) const override;

  /// Value Y_t = E_t u_t at vertex values U (|V| x d), n x columns.
  static SmallMatrix value(const Form& form, Index t, const Matrix& U);
};

/// Energy whose targets are projections: target_of gives the point of a set of admissible targets (rotations, say) that
/// is closest to Y; its derivative is bounded where it is nearly undefined: see rotation.h. Only for such targets does
/// an alternation of targets and states descend.
class ProjectedEnergy : public TargetEnergy {
 public:
  /// Targets that are undefined at rest begin as some admissible one.
  Form declare(const Domain& domain) const override;

  /// n columns.
  int curvature_rank(const Domain& domain) const override;
  /// H = 2 (I - dc/dY), since Y - c(Y) is half the gradient of |Y - c(Y)|^2. By a numeric eigen-decomposition: energies
  /// that know the eigenvectors of dc/dY are faster.
  void curvature_root(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      Eigen::Ref<Eigen::MatrixXd> R) const override;
};

/// How an energy is known to configs and to `variform list`.
struct EnergyEntry {
  std::string name = {};
  std::string doc = {};      ///< one line, with the source
  std::string domains = {};  ///< which domains it takes, for the listing
  bool velocities = false;   ///< whether u is a velocity field, not a map
  std::vector<Parameter> parameters = {};
  std::function<std::unique_ptr<Energy>(const Parameters&)> make = {};
};

/// Basis of the kernel of an energy, (unknowns |V|) x dim; no columns for Kernel::trivial and Kernel::other. Columns
/// are scaled alike.
Eigen::MatrixXd kernel_basis(const EnergyTraits& traits, const Domain& domain);

/// Vectorised gradient of cell t for vertex-major local unknowns: vec(F_t) = H_t u_t with F_t = G_t U_t, columns of F
/// one after the other; H_t = (I_d (x) G_t) P, (p d) x (d (m+1)) (methods: errata C3).
void vectorised_gradient(const Domain& domain, Index t, int d, Eigen::Ref<Eigen::MatrixXd> H);
Eigen::MatrixXd vectorised_gradient(const Domain& domain, Index t, int d);

}  // namespace variform
