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
