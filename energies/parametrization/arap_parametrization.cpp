// SPDX-License-Identifier: BSD-3-Clause
#include "energies/parametrization/framed_map.h"
#include "framework/operators/isotropic.h"
#include "framework/operators/rotation.h"

namespace variform {
namespace {

// As-rigid-as-possible parametrization of a surface: the target is the closest planar rotation R* (Martinez Esturo
// 2013, sec. 7.4.5).
class ArapParametrization final : public FramedMap<ProjectedEnergy> {
 public:
  explicit ArapParametrization(const MapGauge& gauge) : FramedMap("arap_parametrization", gauge) {}

  bool target_of(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                 Eigen::Ref<Eigen::MatrixXd> c, SmallMatrix* derivative) const override {
    if (Y.rows() == 2 || derivative != nullptr) return FramedMap::target_of(domain, t, Y, c, derivative);
    // Without a frame: half the time, and all that an alternation asks for.
    const Eigen::Map<const Eigen::Vector3d> normal(domain.normals().data() + std::ptrdiff_t{3} * t);
    Matrix32 lifted;
    const bool defined = closest_rotation(normal, Y.topLeftCorner<3, 2>(), lifted);
    if (defined) c.topLeftCorner<3, 2>() = lifted;
    return defined;
  }

 protected:
  bool planar_target(const Eigen::Matrix2d& F, Eigen::Matrix2d& C, Eigen::Matrix4d* derivative) const override {
    return closest_rotation(F, C, derivative);
  }
  Eigen::Matrix4d planar_root(const Eigen::Matrix2d& F) const override { return closest_rotation_root(F); }
};

}  // namespace

EnergyEntry describe_arap_parametrization() {
  return {.name = "arap_parametrization",
          .doc = "as-rigid-as-possible map of a surface to the plane, nonlinear (Martinez Esturo 2013, sec. 7.4.5)",
          .domains = "surface, planar",
          .parameters = MapGauge::parameters(),
          .make = [](const Parameters& p) { return std::make_unique<ArapParametrization>(MapGauge(p)); }};
}

}  // namespace variform
