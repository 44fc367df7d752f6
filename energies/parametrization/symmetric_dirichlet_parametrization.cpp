// SPDX-License-Identifier: BSD-3-Clause
#include "energies/parametrization/framed_map.h"
#include "framework/operators/isotropic.h"

namespace variform {
namespace {

// Symmetric Dirichlet energy of a map of a surface to the plane, |F|^2 + |F^-1|^2 - 4 = |F - F^-T|^2 (Smith and
// Schaefer 2015, sec. 3). Infinite where a triangle is mirrored or degenerate: needs a start without, as a Tutte map.
class SymmetricDirichletParametrization final : public FramedMap<TargetEnergy> {
 public:
  explicit SymmetricDirichletParametrization(const MapGauge& gauge)
      : FramedMap("symmetric_dirichlet_parametrization", gauge) {}

  EnergyTraits traits(const Domain& domain) const override {
    EnergyTraits traits = FramedMap::traits(domain);
    traits.barrier = true;
    return traits;
  }

  double longest_step(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                      const Eigen::Ref<const Eigen::MatrixXd>& dY) const override {
    return longest_unflipped_step(in_frame(domain, t, Y), in_frame(domain, t, dY));
  }

 protected:
  bool planar_target(const Eigen::Matrix2d& F, Eigen::Matrix2d& C, Eigen::Matrix4d* derivative) const override {
    return inverse_transposed(F, C, derivative);
  }
  Eigen::Matrix4d planar_root(const Eigen::Matrix2d& F) const override { return symmetric_dirichlet_root(F); }
};

}  // namespace

EnergyEntry describe_symmetric_dirichlet_parametrization() {
  return {
      .name = "symmetric_dirichlet_parametrization",
      .doc = "symmetric Dirichlet energy of a map of a surface to the plane; nothing flips (Smith and Schaefer 2015)",
      .domains = "surface, planar",
      .parameters = MapGauge::parameters(),
      .make = [](const Parameters& p) { return std::make_unique<SymmetricDirichletParametrization>(MapGauge(p)); }};
}

}  // namespace variform
