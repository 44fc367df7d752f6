// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "framework/base/error.h"
#include "framework/form/energy.h"

namespace variform {
namespace {

// As-similar-as-possible planar deformation: |r_t|^2 = |F - S*|^2 = (sigma_1 - sigma_2)^2 / 2 with the closest
// similarity S* of F (Martinez Esturo 2013, sec. 7.4.1). Linear in 2-D only.
class Asap final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() != DomainKind::planar) {
      throw UsageError(
          fmt::format("energy 'asap' is linear in the plane only and needs a planar domain, this one is {}",
                      to_string(domain.kind())));
    }
    return {.residuals = 4, .unknowns = 2, .columns = 1, .kernel = Kernel::similarities};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    // F - S* for vec(F) = (f11, f21, f12, f22).
    static const Eigen::Matrix4d kSimilarityDefect =
        0.5 * (Eigen::Matrix4d() << 1, 0, 0, -1, 0, 1, 1, 0, 0, 1, 1, 0, -1, 0, 0, 1).finished();
    Eigen::Matrix<double, 4, 6> H;
    vectorised_gradient(domain, t, 2, H);
    E = kSimilarityDefect * H;
  }
};

}  // namespace

EnergyEntry describe_asap() {
  return {.name = "asap",
          .doc = "as-similar-as-possible deformation, linear (Martinez Esturo 2013, sec. 7.4.1)",
          .domains = "planar",
          .make = [](const Parameters&) { return std::make_unique<Asap>(); }};
}

}  // namespace variform
