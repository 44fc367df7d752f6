// SPDX-License-Identifier: BSD-3-Clause
#include "framework/base/error.h"
#include "framework/form/energy.h"
#include "framework/operators/isotropic.h"

namespace variform {
namespace {

// Symmetric Dirichlet energy |F|^2 + |F^-1|^2 less its minimum 2d, which is |F - F^-T|^2: (E, c) = (G, F^-T), the
// operator, kernel and gauge of ARAP with another target (energy: Schreiner et al. 2004, Smith and Schaefer 2015, sec.
// 3). Infinite where a cell is not positively oriented: no step flips one.
class SymmetricDirichlet final : public TargetEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() == DomainKind::surface) {
      throw UsageError(
          "energy 'symmetric_dirichlet' deforms planar and tetrahedral meshes, this domain is a surface: a triangle in "
          "space has no orientation that a barrier could keep. See 'symmetric_dirichlet_parametrization' for maps to "
          "the plane, 'arap' for deformations");
    }
    const int p = domain.ambient_dimension();
    return {.residuals = p,
            .unknowns = 1,
            .columns = p,
            .kernel = Kernel::constants,
            .state = StateDependence::target,
            .barrier = true};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }

  bool target_of(const Domain& domain, Index, const Eigen::Ref<const Eigen::MatrixXd>& Y, Eigen::Ref<Eigen::MatrixXd> c,
                 SmallMatrix* derivative) const override {
    return domain.ambient_dimension() == 2 ? inverse<2>(Y, c, derivative) : inverse<3>(Y, c, derivative);
  }

  int curvature_rank(const Domain& domain) const override {
    return domain.ambient_dimension() * domain.ambient_dimension();
  }

  void curvature_root(const Domain& domain, Index, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      Eigen::Ref<Eigen::MatrixXd> R) const override {
    if (domain.ambient_dimension() == 2) {
      R.topLeftCorner<4, 4>() = symmetric_dirichlet_root(Eigen::Matrix2d(Y.topLeftCorner<2, 2>()));
    } else {
      R.topLeftCorner<9, 9>() = symmetric_dirichlet_root(Eigen::Matrix3d(Y.topLeftCorner<3, 3>()));
    }
  }

  double longest_step(const Domain& domain, Index, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      const Eigen::Ref<const Eigen::MatrixXd>& dY) const override {
    return domain.ambient_dimension() == 2 ? longest_unflipped_step(Eigen::Matrix2d(Y), Eigen::Matrix2d(dY))
                                           : longest_unflipped_step(Eigen::Matrix3d(Y), Eigen::Matrix3d(dY));
  }

 private:
  template <int d>
  static bool inverse(const Eigen::Ref<const Eigen::MatrixXd>& Y, Eigen::Ref<Eigen::MatrixXd> c,
                      SmallMatrix* derivative) {
    Eigen::Matrix<double, d, d> C;
    Eigen::Matrix<double, d * d, d * d> D;
    const Eigen::Matrix<double, d, d> F = Y.template topLeftCorner<d, d>();
    const bool defined = inverse_transposed(F, C, derivative != nullptr ? &D : nullptr);
    if (defined) c.template topLeftCorner<d, d>() = C;
    if (derivative != nullptr) *derivative = D;
    return defined;
  }
};

}  // namespace

EnergyEntry describe_symmetric_dirichlet() {
  return {.name = "symmetric_dirichlet",
          .doc = "symmetric Dirichlet energy of a deformation, |F - F^-T|^2; nothing flips (Smith and Schaefer 2015)",
          .domains = "planar, tetrahedral",
          .make = [](const Parameters&) { return std::make_unique<SymmetricDirichlet>(); }};
}

}  // namespace variform
