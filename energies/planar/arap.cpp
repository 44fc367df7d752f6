// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "framework/base/error.h"
#include "framework/form/energy.h"

namespace variform {
namespace {

// As-rigid-as-possible planar deformation: (E, c) = (G, R*) with the closest rotation R* of F = G U on every cell
// (Martinez Esturo 2013, sec. 7.4.2; closed form of R* with errata C4). One factorization serves both coordinates and
// all iterations.
class Arap final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain& domain) const override {
    if (domain.kind() != DomainKind::planar) {
      throw UsageError(fmt::format("energy 'arap' needs a planar domain, this one is {}", to_string(domain.kind())));
    }
    return {.residuals = 2, .unknowns = 1, .columns = 2, .kernel = Kernel::constants, .state = StateDependence::target};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }

  bool target(const Domain& domain, Index t, const Matrix& U, Eigen::Ref<Eigen::MatrixXd> c) const override {
    const auto G = domain.gradient(t);
    Eigen::Matrix2d F = Eigen::Matrix2d::Zero();
    for (int i = 0; i < 3; ++i) F += G.col(i).lazyProduct(U.row(domain.cells()(t, i)));
    const double p = F(0, 0) + F(1, 1);
    const double q = F(0, 1) - F(1, 0);
    const double length = std::hypot(p, q);
    // A cell that is exactly a reflected similarity has every rotation as closest one.
    if (length <= 1e-14 * F.norm() || length == 0.0) return false;
    c << p / length, q / length, -q / length, p / length;
    return true;
  }
};

}  // namespace

EnergyEntry describe_arap() {
  return {.name = "arap",
          .doc = "as-rigid-as-possible deformation, by local/global alternation (Martinez Esturo 2013, sec. 7.4.2)",
          .domains = "planar",
          .make = [](const Parameters&) { return std::make_unique<Arap>(); }};
}

}  // namespace variform
