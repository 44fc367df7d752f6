// SPDX-License-Identifier: BSD-3-Clause
#include "tests/energies/energy_suite.h"

#include <Eigen/Dense>
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "framework/form/problem.h"
#include "solvers/linear/linear_backends.h"
#include "tests/support.h"

namespace variform::testing {
namespace {

constexpr FacetWeight kWeights[] = {FacetWeight::facet_measure, FacetWeight::facet_measure_unit,
                                    FacetWeight::finite_volume};

Matrix rest_values(const Domain& domain, int d) {
  Matrix U = Matrix::Zero(domain.vertex_count(), d);
  const auto shared = std::min<Eigen::Index>(d, domain.positions().cols());
  U.leftCols(shared) = domain.positions().leftCols(shared);
  return U;
}

// Every third vertex, where there is a boundary only those on it: enough for any energy.
std::vector<Index> held_vertices(const Domain& domain) {
  std::vector<Index> held;
  for (Index v = 0; v < domain.vertex_count(); v += 3) {
    if (domain.boundary_vertices()[v] || domain.boundary_facets().rows() == 0) held.push_back(v);
  }
  return held;
}

// Fixed slightly off rest.
Constraints wobbly_boundary(const Domain& domain, int d) {
  Constraints constraints(domain.vertex_count(), d);
  const Matrix rest = rest_values(domain, d);
  for (const Index v : held_vertices(domain)) {
    Eigen::RowVectorXd value = rest.row(v);
    for (int i = 0; i < d; ++i) value[i] += 0.05 * std::sin(3.0 * v + i);
    constraints.fix(v, value);
  }
  return constraints;
}

void check_normal_equations(Problem& problem) {
  // E' W_n E by plain sparse products, component by component: W_n = I_n (x) W is never formed.
  const Form& first = problem.terms().front().form;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(first.unknown_count(), first.unknown_count());
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(first.unknown_count(), first.columns());
  for (const Term& term : problem.terms()) {
    const SparseMatrix E = term.form.sparse_operator();
    const Eigen::MatrixXd c = term.form.stacked_targets();
    const int n = term.form.residuals();
    const SparseMatrix W = term.norm->matrix();
    for (int i = 0; i < n; ++i) {
      SparseMatrix E_i(term.form.site_count(), E.cols());
      Eigen::MatrixXd c_i(term.form.site_count(), c.cols());
      std::vector<Eigen::Triplet<double, Index>> triplets;
      for (Index j = 0; j < E.outerSize(); ++j) {
        for (SparseMatrix::InnerIterator it(E, j); it; ++it) {
          if (it.row() % n == i) triplets.emplace_back(static_cast<Index>(it.row()) / n, j, it.value());
        }
      }
      E_i.setFromTriplets(triplets.begin(), triplets.end());
      for (Index s = 0; s < term.form.site_count(); ++s) c_i.row(s) = c.row(s * n + i);
      H += Eigen::MatrixXd(E_i.transpose() * W * E_i);
      g += E_i.transpose() * W * c_i;
    }
  }
  const Eigen::MatrixXd assembled = dense_symmetric(problem.normal_matrix());
  EXPECT_LT((assembled - H).cwiseAbs().maxCoeff(), 1e-12 * H.cwiseAbs().maxCoeff());
  EXPECT_LT((problem.normal_right_hand_side() - g).cwiseAbs().maxCoeff(),
            1e-12 * std::max(1.0, H.cwiseAbs().maxCoeff()));
}

void check_stacked_form(Problem& problem, const Domain& domain) {
  const int d = problem.traits().dimension();
  const Eigen::MatrixXd S_E = stacked_operator(problem.terms());
  const Eigen::MatrixXd S_c = stacked_targets(problem.terms());
  const Eigen::MatrixXd H = dense_symmetric(problem.normal_matrix());
  const double scale = H.cwiseAbs().maxCoeff();
  EXPECT_LT((S_E.transpose() * S_E - H).cwiseAbs().maxCoeff(), 1e-12 * scale);
  EXPECT_LT((S_E.transpose() * S_c - problem.normal_right_hand_side()).cwiseAbs().maxCoeff(),
            1e-12 * std::max(1.0, scale));
  for (int sample = 0; sample < 3; ++sample) {
    const Matrix U = rest_values(domain, d) + Matrix::Random(domain.vertex_count(), d);
    const Matrix X = as_unknowns(U, problem.terms().front().form);
    const double total = problem.value(U).total;
    EXPECT_NEAR((S_E * X - S_c).squaredNorm(), total, 1e-12 * total);
  }
}

// 2 (H u - g) for the current targets, one row per vertex.
Matrix gradient_at(Problem& problem, const Matrix& U) {
  const Form& form = problem.terms().front().form;
  const Matrix gradient = 2.0 * (problem.normal_matrix().selfadjointView<Eigen::Lower>() * as_unknowns(U, form) -
                                 problem.normal_right_hand_side());
  return as_vertex_values(gradient, form);
}

void check_gradient(Problem& problem, const Domain& domain) {
  const int d = problem.traits().dimension();
  const Matrix U = rest_values(domain, d) + 0.1 * Matrix::Random(domain.vertex_count(), d);
  const Matrix gradient = gradient_at(problem, U);
  const double scale = gradient.cwiseAbs().maxCoeff();
  for (int sample = 0; sample < 6; ++sample) {
    Matrix direction = Matrix::Random(U.rows(), d);
    const double step = 1e-4;
    const double difference =
        (problem.value(U + step * direction).total - problem.value(U - step * direction).total) / (2 * step);
    const double expected = (gradient.array() * direction.array()).sum();
    // Quadratic: central differences are exact up to rounding.
    EXPECT_NEAR(difference, expected, 1e-7 * scale * std::sqrt(static_cast<double>(U.size())));
  }
}

void check_kernel(Problem& problem, const Domain& domain) {
  EnergyTraits seen = problem.traits();
  seen.kernel = problem.kernel();
  const Eigen::MatrixXd basis = kernel_basis(seen, domain);
  const Eigen::MatrixXd H = dense_symmetric(problem.normal_matrix());
  if (basis.cols() > 0) {
    EXPECT_LT((H * basis).cwiseAbs().maxCoeff(), 1e-11 * H.cwiseAbs().maxCoeff());
  }
  const Vector eigenvalues = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues();
  const auto zeros = (eigenvalues.array() < 1e-11 * eigenvalues.maxCoeff()).count();
  EXPECT_GE(eigenvalues.minCoeff(), -1e-11 * eigenvalues.maxCoeff());
  if (problem.kernel() != Kernel::other) {
    EXPECT_EQ(zeros, basis.cols());
  }
}

void check_backends(const Domain& domain, const Energy& energy, const NormOptions& norm) {
  const int d = energy.traits(domain).dimension();
  Matrix reference;
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    if (!entry.available) continue;
    Problem problem(domain, energy, norm, wobbly_boundary(domain, d));
    Parameters parameters(entry.parameters);
    if (!entry.capabilities.direct) {
      // The error is the residual times the condition number: as small as that of direct backends.
      parameters.set("tolerance", 1e-14);
      parameters.set("max_iterations", std::int64_t{100000});
    }
    const auto backend = make_linear_backend(entry.name, parameters);
    const Matrix U = problem.solve(*backend);
    if (reference.size() == 0) reference = U;
    EXPECT_LT((U - reference).norm(), 1e-9 * reference.norm()) << entry.name;
    // The gradient vanishes but at the fixed vertices, where it is the force that holds them.
    const Matrix gradient = gradient_at(problem, U);
    std::vector<bool> fixed(domain.vertex_count(), false);
    for (const auto& value : problem.constraints().fixed()) fixed[value.vertex] = true;
    double left = 0.0;
    double forces = 0.0;
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      double& largest = fixed[v] ? forces : left;
      largest = std::max(largest, gradient.row(v).cwiseAbs().maxCoeff());
    }
    EXPECT_LT(left, (entry.capabilities.direct ? 1e-11 : 1e-7) * forces) << entry.name;
  }
}

// The targets c(u) of a state are the closest ones that the energy admits. At beta = 0 the sites do not see each other,
// so E(u) = min over c of |E u - c|^2, whose gradient is the one for constant c = c(u) (envelope theorem).
void check_closest_targets(const Domain& domain, const Energy& energy) {
  const int d = energy.traits(domain).dimension();
  Problem problem(domain, energy, {.beta = 0.0}, wobbly_boundary(domain, d));
  std::vector<Matrix> states;
  for (int i = 0; i < 3; ++i)
    states.push_back(rest_values(domain, d) + 0.05 * Matrix::Random(domain.vertex_count(), d));
  const auto closest_value = [&](const Matrix& U) {
    EXPECT_EQ(problem.refresh_target(U), 0);
    return problem.value(U).total;
  };
  for (const Matrix& U : states) {
    problem.refresh_target(U);
    const Matrix gradient = gradient_at(problem, U);
    const Vector distances = problem.residual(U).rowwise().norm();
    for (int sample = 0; sample < 6; ++sample) {
      const Matrix direction = Matrix::Random(U.rows(), d);
      const double step = 1e-6;
      const double difference =
          (closest_value(U + step * direction) - closest_value(U - step * direction)) / (2 * step);
      EXPECT_NEAR(difference, (gradient.array() * direction.array()).sum(), 1e-6 * gradient.norm());
    }
    // The targets of other states are admissible, too: none of them is closer, on any site.
    for (const Matrix& other : states) {
      problem.refresh_target(other);
      const Vector others = problem.residual(U).rowwise().norm();
      EXPECT_GE((others - distances).minCoeff(), -1e-14 * (1.0 + others.maxCoeff()));
    }
  }
}

using Small = TargetEnergy::SmallMatrix;

Small gradient_by_value(const Domain& domain, const TargetEnergy& energy, Index t, const Small& Y) {
  Small c = Y;
  Small D(Y.size(), Y.size());
  EXPECT_TRUE(energy.target_of(domain, t, Y, c, &D));
  const Small r = Y - c;
  const Eigen::VectorXd vec = Eigen::Map<const Eigen::VectorXd>(r.data(), r.size());
  Small gradient = Y;
  Eigen::Map<Eigen::VectorXd>(gradient.data(), gradient.size()) = 2.0 * (vec - D.transpose() * vec);
  return gradient;
}

// Derivative, curvature and longest step of a target function on some cells, by differences and numeric
// eigen-decompositions.
void check_target_function(const Domain& domain, const TargetEnergy& energy) {
  const EnergyTraits traits = energy.traits(domain);
  const int d = traits.dimension();
  const Form form = energy.declare(domain);
  const int size = traits.residuals * traits.columns;
  const double step = 1e-5;
  int checked = 0;
  for (int sample = 0; sample < 4; ++sample) {
    // Rest, and states far enough from it that some curvatures are negative.
    const double scale = sample == 0 ? 1.0 : 0.6;
    const Matrix U = scale * (rest_values(domain, d) + 0.03 * sample * Matrix::Random(domain.vertex_count(), d));
    for (Index t = 0; t < domain.cell_count(); t += 7) {
      const Small Y = TargetEnergy::value(form, t, U);
      Small c = Y;
      Small D(size, size);
      if (!energy.target_of(domain, t, Y, c, &D)) continue;
      // The values that the cell can have, as an orthonormal basis.
      const Small local = form.block(t);
      Eigen::MatrixXd coupled = Eigen::MatrixXd::Zero(size, local.cols() * traits.columns);
      for (int j = 0; j < traits.columns; ++j) {
        coupled.block(j * traits.residuals, j * local.cols(), traits.residuals, local.cols()) = local;
      }
      Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(coupled);
      qr.setThreshold(1e-10);
      const Eigen::MatrixXd Q = Eigen::MatrixXd(qr.householderQ()).leftCols(qr.rank());
      Eigen::MatrixXd H(size, Q.cols());
      Eigen::MatrixXd slope(size, Q.cols());
      bool smooth = true;
      for (Eigen::Index k = 0; k < Q.cols(); ++k) {
        Small forward = Y;
        Small backward = Y;
        const Eigen::VectorXd direction = Q.col(k);
        const Eigen::Map<const Eigen::MatrixXd> dY(direction.data(), Y.rows(), Y.cols());
        forward += step * dY;
        backward -= step * dY;
        Small a = c;
        Small b = c;
        smooth = smooth && energy.target_of(domain, t, forward, a, nullptr) &&
                 energy.target_of(domain, t, backward, b, nullptr);
        if (!smooth) break;
        const Small dc = (a - b) / (2 * step);
        slope.col(k) = Eigen::Map<const Eigen::VectorXd>(dc.data(), size);
        const Small dg =
            (gradient_by_value(domain, energy, t, forward) - gradient_by_value(domain, energy, t, backward)) /
            (2 * step);
        H.col(k) = Eigen::Map<const Eigen::VectorXd>(dg.data(), size);
      }
      const double bound = D.cwiseAbs().maxCoeff();
      if (!smooth || bound > 50.0) continue;  // differences tell nothing there
      ++checked;
      EXPECT_LT((D * Q - slope).cwiseAbs().maxCoeff(), 1e-5 * (1.0 + bound * bound)) << "cell " << t;
      const Eigen::MatrixXd on_values = Q.transpose() * H;
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(0.5 * (on_values + on_values.transpose()));
      const Eigen::MatrixXd expected =
          eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * eigen.eigenvectors().transpose();
      Eigen::MatrixXd R(energy.curvature_rank(domain), size);
      energy.curvature_root(domain, t, Y, R);
      const Eigen::MatrixXd RQ = R * Q;
      EXPECT_LT((2.0 * RQ.transpose() * RQ - expected).cwiseAbs().maxCoeff(),
                1e-5 * (1.0 + expected.cwiseAbs().maxCoeff() * (1.0 + bound)))
          << "cell " << t;
      if (const auto* projected = dynamic_cast<const ProjectedEnergy*>(&energy)) {
        Eigen::MatrixXd numeric(size, size);
        projected->ProjectedEnergy::curvature_root(domain, t, Y, numeric);
        const Eigen::MatrixXd NQ = numeric * Q;
        EXPECT_LT((RQ.transpose() * RQ - NQ.transpose() * NQ).cwiseAbs().maxCoeff(), 1e-10);
      }
      const Eigen::VectorXd away = Q * Eigen::VectorXd::Random(Q.cols());
      const Small dY = Eigen::Map<const Eigen::MatrixXd>(away.data(), Y.rows(), Y.cols());
      const double longest = energy.longest_step(domain, t, Y, dY);
      EXPECT_GT(longest, 0.0);
      if (!traits.barrier) {
        EXPECT_EQ(longest, std::numeric_limits<double>::infinity());
        continue;
      }
      const auto defined = [&](double s) {
        Small at = Y + s * dY;
        return energy.target_of(domain, t, at, c, nullptr);
      };
      for (const double part : {0.1, 0.5, 0.9, 0.999}) EXPECT_TRUE(defined(part * std::min(longest, 1e3)));
      if (std::isfinite(longest)) {
        EXPECT_FALSE(defined(1.001 * longest));
      }
    }
  }
  EXPECT_GT(checked, 0);
}

}  // namespace

Constraints fixed_at(const Domain& domain, int dimension,
                     const std::vector<std::pair<Index, Eigen::RowVectorXd>>& moves) {
  Constraints constraints(domain.vertex_count(), dimension);
  const Matrix rest = rest_values(domain, dimension);
  for (const auto& [vertex, move] : moves) constraints.fix(vertex, rest.row(vertex) + move);
  return constraints;
}

void check_energy(const std::string& label, const Energy& energy, const Domain& domain, bool rest_is_minimal) {
  const EnergyTraits traits = energy.traits(domain);
  const int d = traits.dimension();
  if (traits.state == StateDependence::target) {
    SCOPED_TRACE(label);
    if (dynamic_cast<const ProjectedEnergy*>(&energy) != nullptr) check_closest_targets(domain, energy);
    if (const auto* targets = dynamic_cast<const TargetEnergy*>(&energy)) check_target_function(domain, *targets);
  }
  std::vector<double> betas = {0.0, 0.3, 0.9};
  if (traits.regularizer_kernel != Kernel::other) betas.push_back(1.0);
  for (const double beta : betas) {
    for (const FacetWeight weight : kWeights) {
      SCOPED_TRACE(fmt::format("{} beta {} {}", label, beta, to_string(weight)));
      const NormOptions norm{beta, weight};
      Problem problem(domain, energy, norm, wobbly_boundary(domain, d));
      const Form& form = problem.terms().front().form;
      ASSERT_EQ(form.residuals(), traits.residuals);
      ASSERT_EQ(form.unknowns() * form.columns(), d);
      ASSERT_EQ(form.site_count(), traits.support == Support::cells ? domain.cell_count() : domain.vertex_count());
      check_normal_equations(problem);
      check_stacked_form(problem, domain);
      check_gradient(problem, domain);
      check_kernel(problem, domain);
      // Alone, some energies leave motions free that only their own regularizer holds.
      const bool solvable = traits.regularizer_kernel == Kernel::other || problem.kernel() != Kernel::other;
      if (solvable) check_backends(domain, energy, norm);
      if (rest_is_minimal) {
        const Matrix rest = rest_values(domain, d);
        EXPECT_LT(problem.value(rest).total, 1e-24 * domain.total_measure() * domain.cell_count());
        Constraints still(domain.vertex_count(), d);
        for (const Index v : held_vertices(domain)) still.fix(v, rest.row(v));
        Problem at_rest(domain, energy, norm, still);
        const auto backend = make_linear_backend("eigen.ldlt");
        EXPECT_LT((at_rest.solve(*backend) - rest).cwiseAbs().maxCoeff(), 1e-12 * domain.diameter());
      }
    }
  }
}

}  // namespace variform::testing
