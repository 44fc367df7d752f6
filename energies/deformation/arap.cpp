// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/energy.h"
#include "framework/operators/isotropic.h"
#include "framework/operators/operators.h"
#include "framework/operators/rotation.h"

namespace variform {
namespace {

// As-rigid-as-possible deformation: (E, c) = (G, R*) with the closest rotation R* of F = G U on every cell (Martinez
// Esturo 2013, sec. 7.4.2 and 7.4.3). One factorization serves all coordinates and all iterations. On a surface G is
// the 3 x 3 operator and the target the tangential part of the normal-completed rotation, (I - n n') R*: with the whole
// rotation the rest pose would not be a solution for beta > 0 (methods: errata C6).
class Arap final : public ProjectedEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    const int p = domain.ambient_dimension();
    return {.residuals = p, .unknowns = 1, .columns = p, .kernel = Kernel::constants, .state = StateDependence::target};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }

  bool target_of(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                 Eigen::Ref<Eigen::MatrixXd> c, SmallMatrix* derivative) const override {
    switch (domain.kind()) {
      case DomainKind::planar: return rotated<2>(Y, c, derivative);
      case DomainKind::tetrahedral: return rotated<3>(Y, c, derivative);
      case DomainKind::surface: break;
    }
    const SurfaceFrame B = surface_frame(domain, t);  // the target does not depend on the frame
    Matrix23 R = B;
    Matrix66 D;
    const bool defined = closest_orthonormal_rows(B * Y.topLeftCorner<3, 3>(), R, derivative != nullptr ? &D : nullptr);
    if (defined) c.topLeftCorner<3, 3>().noalias() = B.transpose() * R;
    if (derivative != nullptr) {
      derivative->setZero(9, 9);
      for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 3; ++i) {
          derivative->block<3, 3>(3 * i, 3 * j) = B.transpose() * D.block<2, 2>(2 * i, 2 * j) * B;
        }
      }
    }
    return defined;
  }

  int curvature_rank(const Domain& domain) const override {
    const int m = domain.intrinsic_dimension();
    return m * domain.ambient_dimension();
  }

  void curvature_root(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      Eigen::Ref<Eigen::MatrixXd> root) const override {
    switch (domain.kind()) {
      case DomainKind::planar:
        root.topLeftCorner<4, 4>() = closest_rotation_root(Eigen::Matrix2d(Y.topLeftCorner<2, 2>()));
        return;
      case DomainKind::tetrahedral:
        root.topLeftCorner<9, 9>() = closest_rotation_root(Eigen::Matrix3d(Y.topLeftCorner<3, 3>()));
        return;
      case DomainKind::surface: break;
    }
    const SurfaceFrame B = surface_frame(domain, t);
    const Matrix66 R = closest_orthonormal_rows_root(B * Y.topLeftCorner<3, 3>());
    for (int j = 0; j < 3; ++j) root.block<6, 3>(0, 3 * j).noalias() = R.middleCols<2>(2 * j) * B;
  }

 private:
  template <int d>
  static bool rotated(const Eigen::Ref<const Eigen::MatrixXd>& Y, Eigen::Ref<Eigen::MatrixXd> c,
                      SmallMatrix* derivative) {
    Eigen::Matrix<double, d, d> R;
    Eigen::Matrix<double, d * d, d * d> D;
    const Eigen::Matrix<double, d, d> F = Y.template topLeftCorner<d, d>();
    const bool defined = closest_rotation(F, R, derivative != nullptr ? &D : nullptr);
    if (defined) c.template topLeftCorner<d, d>() = R;
    if (derivative != nullptr) *derivative = D;
    return defined;
  }
};

}  // namespace

EnergyEntry describe_arap() {
  return {.name = "arap",
          .doc = "as-rigid-as-possible deformation, nonlinear (Martinez Esturo 2013, sec. 7.4.2, 7.4.3)",
          .domains = "planar, surface, tetrahedral",
          .make = [](const Parameters&) { return std::make_unique<Arap>(); }};
}

}  // namespace variform
