// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "framework/base/error.h"
#include "framework/form/energy.h"

namespace variform {
namespace {

// Linearized as-rigid-as-possible planar deformation: F against its linearized closest rotation, which leaves the
// symmetric part of F minus the identity (Martinez Esturo 2013, sec. 7.4.1). |r_t|^2 is a quarter of the Killing energy
// of the displacement.
class Larap final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() != DomainKind::planar) {
      throw UsageError(fmt::format("energy 'larap' needs a planar domain, this one is {}", to_string(domain.kind())));
    }
    return {.residuals = 4, .unknowns = 2, .columns = 1, .kernel = Kernel::rigid_motions};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    static const Eigen::Matrix4d kSymmetricPart =
        0.5 * (Eigen::Matrix4d() << 2, 0, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 2).finished();
    Eigen::Matrix<double, 4, 6> H;
    vectorised_gradient(domain, t, 2, H);
    E = kSymmetricPart * H;
  }

  bool target(const Domain&, Index, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const override {
    c << 1.0, 0.0, 0.0, 1.0;
    return true;
  }
};

}  // namespace

EnergyEntry describe_larap() {
  return {.name = "larap",
          .doc = "linearized as-rigid-as-possible deformation (Martinez Esturo 2013, sec. 7.4.1)",
          .domains = "planar",
          .make = [](const Parameters&) { return std::make_unique<Larap>(); }};
}

}  // namespace variform
