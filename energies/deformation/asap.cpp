// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "framework/base/error.h"
#include "framework/form/energy.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

// As-similar-as-possible map to the plane: |r_t|^2 = |F - S*|^2 = (sigma_1 - sigma_2)^2 / 2 with the closest similarity
// S* of F (Martinez Esturo 2013, sec. 7.4.1). Linear where cells are triangles.
//
// On a surface F = B_t G_t U_t in a tangent frame B_t (2 x 3), and the residual is lifted to world coordinates,
// B_t'(F - S*). Turning the frame by R turns F and its closest similarity alike, S*(R F) = R S*(F), so the lifted
// residual knows no frame: with the normal n and the gradients a, b of the two coordinates its columns are
//
//   (a + n x b) / 2  and  (b - n x a) / 2.
//
// In the plane, n = z, this is F - S* itself.
class Asap final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() == DomainKind::tetrahedral) {
      throw UsageError(
          "energy 'asap' needs a planar or surface domain, this one is tetrahedral: the closest similarity is not "
          "linear in three dimensions; use the vector-field energy 'conf'");
    }
    // Maps that cost nothing: similarities of the plane; on a surface that cannot be unrolled, points alone.
    return {.residuals = 2 * domain.ambient_dimension(),
            .unknowns = 2,
            .columns = 1,
            .kernel = domain.kind() == DomainKind::planar ? Kernel::similarities : Kernel::constants};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    const auto G = domain.gradient(t);
    const auto p = G.rows();
    const TriangleGradient turned = turned_gradient(domain, t);
    for (int i = 0; i < 3; ++i) {
      E.col(2 * i).head(p) = 0.5 * G.col(i);
      E.col(2 * i).tail(p) = -0.5 * turned.col(i);
      E.col(2 * i + 1).head(p) = 0.5 * turned.col(i);
      E.col(2 * i + 1).tail(p) = 0.5 * G.col(i);
    }
  }
};

}  // namespace

EnergyEntry describe_asap() {
  return {.name = "asap",
          .doc =
              "as-similar-as-possible deformation, or map of a surface to the plane, linear; a surface that can be "
              "unrolled needs two fixed vertices (Martinez Esturo 2013, sec. 7.4.1)",
          .domains = "planar, surface",
          .make = [](const Parameters&) { return std::make_unique<Asap>(); }};
}

}  // namespace variform
