// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <vector>

#include "framework/base/parallel.h"
#include "framework/form/energy.h"
#include "framework/operators/operators.h"

namespace variform {
namespace {

// Differential coordinates kept as they are in the declared shape x: r = M_l^{-1} L (u - x) at every vertex, with the
// cotangent Laplacian L (positive semi-definite) and the lumped mass M_l, an equal share of its measure from each cell
// of a vertex. The residual is linear in between the vertices, so its plain norm is that of the consistent mass matrix,
// not of M_l (Laplacian editing: Sorkine et al. 2004; vertex-based energies: Martinez Esturo 2013, sec. 7.2). Of
// velocities on the current shape: r = M_l^{-1} L v.
class Laplacian final : public Energy {
 public:
  explicit Laplacian(bool velocities) : velocities_(velocities) {}

  EnergyTraits traits(const Domain& domain) const override {
    return {.residuals = 1,
            .unknowns = 1,
            .columns = domain.ambient_dimension(),
            .kernel = Kernel::constants,
            .support = Support::vertices};
  }

  Form declare(const Domain& domain) const override {
    const SparseMatrix E = divided_laplacian(domain);
    const Eigen::MatrixXd c = E * domain.positions();
    return Form::from_sparse(E, velocities_ ? Eigen::MatrixXd::Zero(c.rows(), c.cols()) : c, 1);
  }

  // The targets stay those of the shape that was declared.
  void refresh_operator(const Domain& domain, Form& form) const override {
    // Column i of the transpose is row i of the operator, its rows sorted as the nodes of site i.
    const SparseMatrix rows = divided_laplacian(domain).transpose();
    parallel_for(form.site_count(), [&](Index v) {
      std::copy_n(rows.valuePtr() + rows.outerIndexPtr()[v], form.site_size(v), form.block_data(v));
    });
  }

 private:
  static SparseMatrix divided_laplacian(const Domain& domain) {
    Vector mass = Vector::Zero(domain.vertex_count());
    for (Index t = 0; t < domain.cell_count(); ++t) {
      for (int i = 0; i < domain.cell_size(); ++i) {
        mass[domain.cells()(t, i)] += domain.cell_measures()[t] / domain.cell_size();
      }
    }
    return mass.cwiseInverse().asDiagonal() * cotangent_laplacian(domain);
  }

  bool velocities_;
};

}  // namespace

EnergyEntry describe_laplacian() {
  return {.name = "laplacian",
          .doc =
              "Laplacian editing: differential coordinates of the rest shape kept, residuals on vertices (Sorkine et "
              "al. 2004; Martinez Esturo 2013, sec. 7.2)",
          .domains = "any",
          .make = [](const Parameters&) { return std::make_unique<Laplacian>(false); }};
}

EnergyEntry describe_bilaplacian() {
  return {.name = "bilaplacian",
          .doc =
              "integral of the squared Laplacian of velocities on the current shape, residuals on vertices (Martinez "
              "Esturo 2013, Figure 28)",
          .domains = "any",
          .velocities = true,
          .make = [](const Parameters&) { return std::make_unique<Laplacian>(true); }};
}

}  // namespace variform
