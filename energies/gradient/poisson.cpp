// SPDX-License-Identifier: BSD-3-Clause
#include "energies/gradient/poisson.h"

#include <fmt/format.h>

#include <cmath>

#include "framework/base/error.h"

namespace variform {
namespace {

class Poisson final : public CellEnergy {
 public:
  Poisson(const Matrix& guidance, int p) : guidance_(guidance), p_(p) {
    if (p < 1 || guidance.cols() == 0 || guidance.cols() % p != 0) {
      throw UsageError(
          fmt::format("energy 'poisson': {} guidance columns are no multiple of the dimension {}", guidance.cols(), p));
    }
  }

  EnergyTraits traits(const Domain& domain) const override {
    if (domain.ambient_dimension() != p_ || (guidance_.rows() != 1 && guidance_.rows() != domain.cell_count())) {
      throw UsageError(fmt::format("energy 'poisson': guidance for {} cells in dimension {}, the domain has {} in {}",
                                   guidance_.rows(), p_, domain.cell_count(), domain.ambient_dimension()));
    }
    return {.residuals = p_,
            .unknowns = 1,
            .columns = static_cast<int>(guidance_.cols()) / p_,
            .kernel = Kernel::constants};
  }

  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }

  bool target(const Domain&, Index t, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const override {
    c = Eigen::Map<const Eigen::MatrixXd>(guidance_.row(guidance_.rows() == 1 ? 0 : t).data(), c.rows(), c.cols());
    return true;
  }

 private:
  Matrix guidance_;
  int p_;
};

}  // namespace

std::unique_ptr<Energy> make_poisson(const Matrix& guidance, int ambient_dimension) {
  return std::make_unique<Poisson>(guidance, ambient_dimension);
}

std::unique_ptr<Energy> make_poisson(const Eigen::MatrixXd& constant_guidance) {
  return std::make_unique<Poisson>(
      Eigen::Map<const Eigen::RowVectorXd>(constant_guidance.data(), constant_guidance.size()),
      static_cast<int>(constant_guidance.rows()));
}

EnergyEntry describe_poisson() {
  return {
      .name = "poisson",
      .doc = "gradient fit E = G: the gradient of the coordinates is prescribed (Martinez Esturo 2013, sec. 7.3, 9.1)",
      .domains = "any",
      .parameters = {{.name = "gradient",
                      .value = std::vector<double>{1.0, 0.0, 0.0, 1.0},
                      .doc = "wanted deformation gradient, the same on all cells: p x p entries, column by column of "
                             "F = (dx u, dy u, dx v, dy v)"}},
      .make = [](const Parameters& parameters) {
        const std::vector<double>& entries = parameters.numbers("gradient");
        const auto p = static_cast<Eigen::Index>(std::lround(std::sqrt(static_cast<double>(entries.size()))));
        if (p * p != static_cast<Eigen::Index>(entries.size())) {
          throw UsageError(fmt::format("energy 'poisson': 'gradient' has {} entries, expected 4 or 9", entries.size()));
        }
        return make_poisson(Eigen::MatrixXd(Eigen::Map<const Eigen::MatrixXd>(entries.data(), p, p)));
      }};
}

}  // namespace variform
