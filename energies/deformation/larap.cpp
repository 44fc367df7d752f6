// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "framework/base/error.h"
#include "framework/form/energy.h"

namespace variform {
namespace {

// Linearized as-rigid-as-possible deformation in any dimension: F against its linearized closest rotation, which leaves
// the symmetric part of F minus the identity, E_t = (I + K) H_t / 2 and c = vec I with the commutation matrix K
// (Martinez Esturo 2013, sec. 7.4.1). |r_t|^2 is a quarter of the Killing energy of the displacement.
class Larap final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() == DomainKind::surface) {
      throw UsageError(
          fmt::format("energy 'larap' needs a planar or tetrahedral domain, this one is {}", to_string(domain.kind())));
    }
    const int p = domain.ambient_dimension();
    return {.residuals = p * p, .unknowns = p, .columns = 1, .kernel = Kernel::rigid_motions};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override {
    // Row (r, c) of E for local vertex i: the symmetric part of d F_rc = g_r du_c.
    const auto G = domain.gradient(t);
    const auto p = G.rows();
    E.setZero();
    for (Eigen::Index i = 0; i < G.cols(); ++i) {
      for (Eigen::Index r = 0; r < p; ++r) {
        for (Eigen::Index c = 0; c < p; ++c) {
          E(c * p + r, i * p + c) += 0.5 * G(r, i);
          E(r * p + c, i * p + c) += 0.5 * G(r, i);
        }
      }
    }
  }

  bool target(const Domain& domain, Index, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const override {
    c.setZero();
    for (int i = 0; i < domain.ambient_dimension(); ++i) c(i * (domain.ambient_dimension() + 1), 0) = 1.0;
    return true;
  }
};

}  // namespace

EnergyEntry describe_larap() {
  return {.name = "larap",
          .doc = "linearized as-rigid-as-possible deformation (Martinez Esturo 2013, sec. 7.4.1)",
          .domains = "planar, tetrahedral",
          .make = [](const Parameters&) { return std::make_unique<Larap>(); }};
}

}  // namespace variform
