// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "framework/base/error.h"
#include "framework/form/energy.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

// Least-squares conformal map (u, v) of triangles to the plane: the Cauchy-Riemann defect grad u + n x grad v in world
// coordinates, |r_t|^2 = (sigma_1 - sigma_2)^2 with signed singular values (Levy et al. 2002; Martinez Esturo 2013,
// ch. 7). The sign printed there, grad u - n x grad v, vanishes on mirrored maps instead (errata C7).
class Lscm final : public CellEnergy {
 public:
  explicit Lscm(bool as_printed) : sign_(as_printed ? -1.0 : 1.0) {}

  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() == DomainKind::tetrahedral) {
      throw UsageError(
          fmt::format("energy 'lscm' maps triangles to the plane and needs a surface or planar domain, "
                      "this one is {}",
                      to_string(domain.kind())));
    }
    // Printed sign in the plane: mirrored similarities, which Kernel has no name for.
    const Kernel planar = sign_ > 0.0 ? Kernel::similarities : Kernel::other;
    return {.residuals = domain.ambient_dimension(),
            .unknowns = 2,
            .columns = 1,
            .kernel = domain.kind() == DomainKind::planar ? planar : Kernel::constants};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    const auto G = domain.gradient(t);
    const TriangleGradient turned = turned_gradient(domain, t);
    for (int i = 0; i < 3; ++i) {
      E.col(2 * i) = G.col(i);
      E.col(2 * i + 1) = sign_ * turned.col(i);
    }
  }

 private:
  double sign_;
};

}  // namespace

EnergyEntry describe_lscm() {
  return {.name = "lscm",
          .doc =
              "least-squares conformal map to the plane; a surface that can be unrolled needs two fixed vertices "
              "(Levy et al. 2002; Martinez Esturo 2013, ch. 7)",
          .domains = "planar, surface",
          .parameters = {{.name = "variant",
                          .value = std::string("corrected"),
                          .doc = "sign of the Cauchy-Riemann defect: corrected, or as_printed, which favours mirrored "
                                 "maps (errata C7)",
                          .choices = {"corrected", "as_printed"}}},
          .make = [](const Parameters& parameters) {
            return std::make_unique<Lscm>(parameters.string("variant") == "as_printed");
          }};
}

}  // namespace variform
