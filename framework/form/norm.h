// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "framework/base/types.h"
#include "framework/domain/domain.h"

namespace variform {

/// Weight b_f of the squared residual jump at an interior facet f with measure a_f, cells l and r, intrinsic dimension
/// m, and sigma = (total measure)^(1/m):
enum class FacetWeight {
  facet_measure,       ///< b_f = a_f: as published (Martinez Esturo 2013, sec. 7.2); beta changes its meaning when the
                       ///< mesh is scaled or refined
  facet_measure_unit,  ///< b_f = sigma a_f: scale invariant; the published norm on a mesh scaled to unit measure
  finite_volume,       ///< b_f = sigma^2 a_f / h_f with h_f = m (A_l + A_r) / ((m+1) a_f): scale invariant and mesh
                       ///< independent, a consistent discretization of the integral of |grad r|^2
};

std::string to_string(FacetWeight weight);
/// Throws UsageError listing the names.
FacetWeight facet_weight_from(const std::string& name);
/// The three names.
const std::vector<std::string>& facet_weight_names();

/// Frame in which the components of a residual are coordinates. Residuals of two cells may be subtracted only in a
/// common frame (methods: the gauge problem).
enum class Gauge {
  world,       ///< coordinates of the ambient or image space: subtract as they are
  cell_frame,  ///< pairs of components are coordinates in a tangent frame of each cell: the norm transports across
               ///< facets
};

/// Weighted inner product of residuals with n components per site: ||R||^2_W = sum_st W_st r_s' T_st r_t, with one
/// scalar symmetric positive (semi-)definite matrix W over the sites, shared by all components, and optional rotations
/// T_st between the frames of neighbouring sites. W is held as a diagonal and one off-diagonal entry per link; it is
/// never expanded to I_n (x) W.
class Norm {
 public:
  virtual ~Norm() = default;

  Index site_count() const { return static_cast<Index>(diagonal_.size()); }
  Index link_count() const { return static_cast<Index>(links_.rows()); }
  /// W_ss.
  const Vector& diagonal() const { return diagonal_; }
  /// links x 2: the sites s, t of each non-zero off-diagonal pair.
  const IndexMatrix& links() const { return links_; }
  /// W_st of each link.
  const Vector& link_weights() const { return link_weights_; }
  /// (cos, sin) of the rotation that takes a residual from the frame of t to that of s, links x 2; empty in world
  /// gauge.
  const Matrix& transports() const { return transports_; }

  /// Recomputes the weights on the same connectivity; allocates nothing (but for vertex_norm).
  virtual void refresh(const Domain& domain) = 0;

  /// A root S of W over the sites (S'S = W), rows x sites, row-major: the rows of the stacked least-squares form. In a
  /// row with two entries on a link with transport, the entry of t is meant to be transported to s; then the link of
  /// each row is given by root_links (-1 for rows without).
  virtual Eigen::SparseMatrix<double, Eigen::RowMajor, Index> root() const = 0;
  virtual std::vector<Index> root_links() const { return {}; }

  /// W R for residuals R (sites x (n * columns)), each row vec(r_s).
  Matrix apply(const Eigen::Ref<const Matrix>& R) const;
  void apply(const Eigen::Ref<const Matrix>& R, Matrix& result) const;
  /// sum_st W_st r_s' T_st r_t; deterministic.
  double squared(const Matrix& R) const;
  /// The same at beta = 0, E_P: sum_s A_s |r_s|^2 for cells; deterministic.
  double plain_squared(const Matrix& R) const;
  /// The weights A_s of E_P where it couples no sites, else null.
  const Vector* plain_weights() const { return plain_link_weights_.size() == 0 ? &plain_diagonal_ : nullptr; }

  /// W as a full symmetric sparse matrix, sites x sites. Throws UsageError when there are transports.
  SparseMatrix matrix() const;

 protected:
  /// Call once the links are set.
  void build_adjacency(Index sites);

  Vector diagonal_;
  IndexMatrix links_;
  Vector link_weights_;
  Matrix transports_;
  Vector plain_diagonal_;      // W at beta = 0
  Vector plain_link_weights_;  // empty: none

 private:
  double quadratic(const Matrix& R, const Vector& diagonal, const Vector& link_weights) const;

  friend class Assembly;
  // Links of each site: entries [adjacency_offsets_[s], adjacency_offsets_[s+1]) of adjacency_, each 2 * link + side,
  // where side says which end of the link the site is.
  std::vector<Index> adjacency_offsets_;
  std::vector<Index> adjacency_;
};

/// What the weight beta is given to.
enum class Regularizer {
  energy_smoothness,  ///< the variation of the residual: the W_n norm, or what the energy itself supplies
  tikhonov,           ///< the gradient of the solution, int |grad u|^2: knows nothing of the energy; for comparisons
                      ///< (Martinez Esturo 2013, sec. 7.4.6, Figure 53)
};

/// What a config's [norm] section says.
struct NormOptions {
  double beta = 0.0;  ///< regularization weight in [0, 1); 1 where the energy brings a regularizer of its own
  FacetWeight facet_weight = FacetWeight::facet_measure;
  Regularizer regularizer =
      Regularizer::energy_smoothness;  ///< looked at by Problem; cell_norm and vertex_norm ignore it
};

/// The problem-aware norm for residuals on cells, W = (1-beta) A + beta Q' B Q (Martinez Esturo 2013, sec. 7.2):
/// A = diag of cell measures, Q the signed facet-cell incidence of interior facets, B = diag of facet weights.
/// frames, for residuals in Gauge::cell_frame only: cells x 2p, the two orthonormal tangent vectors of each triangle;
/// the jump at a facet is then r_l - T_f r_r with the rotation T_f that unfolds the right triangle into the plane of
/// the left. Throws UsageError when beta is not in [0, 1), or frames do not fit.
std::unique_ptr<Norm> cell_norm(const Domain& domain, const NormOptions& options, const Matrix& frames = {});

/// The part of cell_norm that beta weighs, beta Q' B Q: semi-definite, zero for constant residuals. beta may be 1 here.
std::unique_ptr<Norm> variation_norm(const Domain& domain, const NormOptions& options, const Matrix& frames = {});

/// The norm for residuals on vertices, linear in between: W = (1-beta) M + beta s L with the consistent mass matrix M
/// and the cotangent Laplacian L (Martinez Esturo 2013, sec. 7.2, vertex-based energies); s = 1 for facet_measure (as
/// published), sigma^2 for the two scale-invariant weights.
std::unique_ptr<Norm> vertex_norm(const Domain& domain, const NormOptions& options);

/// W = diag(weights): for residuals that bring their own weights, which do not follow the domain: refresh keeps them.
/// (cell_norm with beta = 0 is the diagonal of the cell measures, which do.)
std::unique_ptr<Norm> diagonal_norm(const Vector& weights);

/// factor >= 0 times a norm; the plain norm stays that of `norm` itself. For blends of two terms by beta.
std::unique_ptr<Norm> scaled_norm(std::unique_ptr<Norm> norm, double factor);

/// b_f for every interior facet. The second form writes into a vector of the caller, without allocation when it has its
/// size already.
Vector facet_weights(const Domain& domain, FacetWeight weight);
void facet_weights(const Domain& domain, FacetWeight weight, Vector& b);

/// Variation of a residual field in world gauge (cells x anything), E_R = sum_f b_f |r_l - r_r|^2: what beta weighs,
/// also where beta = 0.
double residual_variation(const Domain& domain, FacetWeight weight, const Matrix& R);

}  // namespace variform
