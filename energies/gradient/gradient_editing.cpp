// SPDX-License-Identifier: BSD-3-Clause
#include <memory>

#include "framework/form/energy.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

// Gradients of the coordinates kept as they are in the declared shape x: r = G_t (u - x) on every cell. Rotations of the
// handles do not spread (gradient-domain editing: Yu et al. 2004 without propagated rotations; a method of one linear
// solve that Martinez Esturo 2013, Figure 18, compares with).
class GradientEditing final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    const int p = domain.ambient_dimension();
    return {.residuals = p, .unknowns = 1, .columns = p, .kernel = Kernel::constants};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }

  bool target(const Domain& domain, Index t, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const override {
    c = deformation(domain, t, domain.positions());
    return true;
  }
};

}  // namespace

EnergyEntry describe_gradient_editing() {
  return {.name = "gradient_editing",
          .doc = "gradients of the coordinates kept as they are at rest (Yu et al. 2004, no propagated rotations)",
          .domains = "any",
          .make = [](const Parameters&) { return std::make_unique<GradientEditing>(); }};
}

}  // namespace variform
