// SPDX-License-Identifier: BSD-3-Clause
#include "framework/form/energy.h"

#include <Eigen/Eigenvalues>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "framework/base/error.h"
#include "framework/base/parallel.h"

namespace variform {

Index Energy::refresh_target(const Domain&, const Matrix&, Form&) const { return 0; }

Matrix Energy::frames(const Domain&) const { return {}; }

std::optional<Term> Energy::regularizer(const Domain&, const NormOptions&) const { return std::nullopt; }

void Energy::refresh_regularizer(const Domain&, Form&) const {
  throw UsageError("an energy with a regularizer of its own must implement refresh_regularizer");
}

Kernel blended_kernel(const EnergyTraits& traits, double beta) {
  if (beta == 0.0) return traits.kernel;
  if (beta == 1.0 || traits.kernel == Kernel::other) return traits.regularizer_kernel;
  return traits.kernel;
}

bool CellEnergy::target(const Domain&, Index, const Matrix&, Eigen::Ref<Eigen::MatrixXd> c) const {
  c.setZero();
  return true;
}

Form CellEnergy::declare(const Domain& domain) const {
  const EnergyTraits t = traits(domain);
  Form form(domain.vertex_count(), domain.cells(), t.residuals, t.unknowns, t.columns);
  refresh_operator(domain, form);
  const int d = t.dimension();
  Matrix rest = Matrix::Zero(domain.vertex_count(), d);
  const auto shared = std::min<Eigen::Index>(d, domain.positions().cols());
  rest.leftCols(shared) = domain.positions().leftCols(shared);
  refresh_target(domain, rest, form);
  return form;
}

void CellEnergy::refresh_operator(const Domain& domain, Form& form) const {
  parallel_for(domain.cell_count(), [&](Index t) { cell(domain, t, form.block(t)); });
}

Index CellEnergy::refresh_target(const Domain& domain, const Matrix& U, Form& form) const {
  return static_cast<Index>(parallel_sum(
      domain.cell_count(), [&](Index t) { return target(domain, t, U, form.target(t)) ? 0.0 : 1.0; }, 1024));
}

TargetEnergy::SmallMatrix TargetEnergy::value(const Form& form, Index t, const Matrix& U) {
  const auto E = form.block(t);
  const int size = form.site_size(t);
  const int columns = form.columns();
  const int unknowns = form.unknowns();
  SmallMatrix Y = SmallMatrix::Zero(form.residuals(), columns);
  for (int i = 0; i < size; ++i) {
    const double* u = U.data() + static_cast<std::size_t>(form.node(t, i)) * unknowns * columns;
    for (int k = 0; k < unknowns; ++k) {
      for (int j = 0; j < columns; ++j) Y.col(j) += u[k * columns + j] * E.col(i * unknowns + k);
    }
  }
  return Y;
}

Form ProjectedEnergy::declare(const Domain& domain) const {
  Form form = CellEnergy::declare(domain);
  // Zero is not admissible: it is what undefined targets are left with. Y is any matrix without symmetries.
  const Eigen::MatrixXd Y =
      Eigen::MatrixXd::NullaryExpr(form.residuals(), form.columns(),
                                   [](Eigen::Index i, Eigen::Index j) { return std::cos(1.0 + 3.0 * i + 7.0 * j); });
  for (Index t = 0; t < form.site_count(); ++t) {
    if (form.target(t).isZero(0.0)) target_of(domain, t, Y, form.target(t), nullptr);
  }
  return form;
}

bool TargetEnergy::target(const Domain& domain, Index t, const Matrix& U, Eigen::Ref<Eigen::MatrixXd> c) const {
  const EnergyTraits own = traits(domain);
  Form form(domain.vertex_count(), domain.cells().row(t), own.residuals, own.unknowns, own.columns);
  cell(domain, t, form.block(0));
  return target_of(domain, t, value(form, 0, U), c, nullptr);
}

namespace {

// refresh_target for sizes that are known to the compiler: N x Size blocks, one unknown per node.
template <int N, int Size, int Columns>
Index refresh_values(const TargetEnergy& energy, const Domain& domain, const Matrix& U, Form& form) {
  const Index* nodes = form.nodes().data();
  return static_cast<Index>(parallel_sum(
      form.site_count(),
      [&](Index t) {
        const Eigen::Map<const Eigen::Matrix<double, N, Size>> E(form.block_data(0) +
                                                                 static_cast<std::ptrdiff_t>(t) * N * Size);
        Eigen::Matrix<double, N, Columns> Y = Eigen::Matrix<double, N, Columns>::Zero();
        for (int i = 0; i < Size; ++i) {
          const double* u =
              U.data() + static_cast<std::ptrdiff_t>(nodes[static_cast<std::ptrdiff_t>(t) * Size + i]) * Columns;
          for (int j = 0; j < Columns; ++j) Y.col(j) += u[j] * E.col(i);
        }
        return energy.target_of(domain, t, Y, form.target(t), nullptr) ? 0.0 : 1.0;
      },
      1024));
}

}  // namespace

Index TargetEnergy::refresh_target(const Domain& domain, const Matrix& U, Form& form) const {
  if (form.unknowns() == 1 && form.site_count() == domain.cell_count() &&
      static_cast<Eigen::Index>(form.nodes().size()) == domain.cells().size()) {
    const std::array<int, 3> sizes = {form.residuals(), domain.cell_size(), form.columns()};
    using Sizes = std::array<int, 3>;
    if (sizes == Sizes{2, 3, 2}) return refresh_values<2, 3, 2>(*this, domain, U, form);
    if (sizes == Sizes{3, 3, 2}) return refresh_values<3, 3, 2>(*this, domain, U, form);
    if (sizes == Sizes{3, 3, 3}) return refresh_values<3, 3, 3>(*this, domain, U, form);
    if (sizes == Sizes{3, 4, 3}) return refresh_values<3, 4, 3>(*this, domain, U, form);
  }
  return static_cast<Index>(parallel_sum(
      domain.cell_count(),
      [&](Index t) { return target_of(domain, t, value(form, t, U), form.target(t), nullptr) ? 0.0 : 1.0; }, 1024));
}

double TargetEnergy::longest_step(const Domain&, Index, const Eigen::Ref<const Eigen::MatrixXd>&,
                                  const Eigen::Ref<const Eigen::MatrixXd>&) const {
  return std::numeric_limits<double>::infinity();
}

int ProjectedEnergy::curvature_rank(const Domain& domain) const {
  const EnergyTraits own = traits(domain);
  return own.residuals * own.columns;
}

void ProjectedEnergy::curvature_root(const Domain& domain, Index t, const Eigen::Ref<const Eigen::MatrixXd>& Y,
                                     Eigen::Ref<Eigen::MatrixXd> R) const {
  SmallMatrix c = Y;
  SmallMatrix D(Y.size(), Y.size());
  target_of(domain, t, Y, c, &D);
  const Eigen::SelfAdjointEigenSolver<SmallMatrix> eigen(SmallMatrix(-0.5 * (D + D.transpose())));
  const Eigen::VectorXd roots = (1.0 + eigen.eigenvalues().array()).max(0.0).sqrt();
  R = roots.asDiagonal() * eigen.eigenvectors().transpose();
}

Eigen::MatrixXd kernel_basis(const EnergyTraits& traits, const Domain& domain) {
  const Index vertices = domain.vertex_count();
  const int d = traits.unknowns;
  const auto basis_of = [&](int columns) { return Eigen::MatrixXd::Zero(vertices * d, columns).eval(); };
  switch (traits.kernel) {
    case Kernel::trivial:
    case Kernel::other: return basis_of(0);
    case Kernel::constants: {
      Eigen::MatrixXd basis = basis_of(d);
      for (Index v = 0; v < vertices; ++v) basis.block(v * d, 0, d, d).setIdentity();
      return basis;
    }
    case Kernel::rigid_motions:
    case Kernel::similarities: break;
  }
  if (d != domain.ambient_dimension()) throw UsageError("kernel of rigid motions: one unknown per ambient coordinate");
  const int rotations = d * (d - 1) / 2;
  Eigen::MatrixXd basis = basis_of(d + rotations + (traits.kernel == Kernel::similarities ? 1 : 0));
  const Eigen::RowVectorXd centre = domain.positions().colwise().mean();
  const double diameter = domain.diameter();
  for (Index v = 0; v < vertices; ++v) {
    const Eigen::RowVectorXd x = (domain.positions().row(v) - centre) / diameter;
    int column = 0;
    for (; column < d; ++column) basis(v * d + column, column) = 1.0;
    for (int i = 0; i < d; ++i) {
      for (int j = i + 1; j < d; ++j, ++column) {
        basis(v * d + i, column) = -x[j];
        basis(v * d + j, column) = x[i];
      }
    }
    if (traits.kernel == Kernel::similarities) basis.block(v * d, column, d, 1) = x.transpose();
  }
  return basis;
}

void vectorised_gradient(const Domain& domain, Index t, int d, Eigen::Ref<Eigen::MatrixXd> H) {
  const auto G = domain.gradient(t);
  const auto p = G.rows();
  H.setZero();
  for (int coordinate = 0; coordinate < d; ++coordinate) {
    for (Eigen::Index i = 0; i < G.cols(); ++i) H.block(coordinate * p, i * d + coordinate, p, 1) = G.col(i);
  }
}

Eigen::MatrixXd vectorised_gradient(const Domain& domain, Index t, int d) {
  Eigen::MatrixXd H(domain.ambient_dimension() * d, d * domain.cell_size());
  vectorised_gradient(domain, t, d, H);
  return H;
}

}  // namespace variform
