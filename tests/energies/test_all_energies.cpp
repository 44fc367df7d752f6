// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "energies/energies.h"
#include "energies/gradient/poisson.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "solvers/linear/linear_backends.h"
#include "tests/energies/energy_suite.h"

namespace variform {
namespace {

// A rectangle lifted by a Gaussian bump: curved, with boundary.
Mesh bump_mesh() {
  const Mesh flat = rectangle_mesh({.h = 0.2, .jitter = 0.3});
  Mesh mesh{Matrix(flat.vertex_count(), 3), flat.cells};
  for (Index v = 0; v < flat.vertex_count(); ++v) {
    const Eigen::RowVector2d x = flat.positions.row(v);
    mesh.positions.row(v) << x, 0.4 * std::exp(-6.0 * (x - Eigen::RowVector2d(0.4, 0.6)).squaredNorm());
  }
  return mesh;
}

std::vector<Domain> small_domains() {
  return {Domain(rectangle_mesh({.h = 0.2, .jitter = 0.3})), Domain(bump_mesh()),
          Domain(bar_surface_mesh(1.0, 0.5, 0.5, 0.25)), Domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5))};
}

// Whether the rest pose u = x costs nothing. It does for velocities, whose rest is u = 0, and for maps of curved
// surfaces to the plane.
bool rest_is_minimal(const EnergyEntry& entry, const EnergyTraits& traits, const Domain& domain) {
  return !entry.velocities && traits.dimension() == domain.ambient_dimension();
}

class RegisteredEnergy : public ::testing::TestWithParam<std::string> {};

TEST_P(RegisteredEnergy, PassesTheSuiteOnEveryDomainItTakes) {
  const EnergyEntry& entry = energies().find(GetParam());
  int taken = 0;
  for (const Domain& domain : small_domains()) {
    const auto energy = entry.make(Parameters(entry.parameters));
    EnergyTraits traits;
    try {
      traits = energy->traits(domain);
    } catch (const UsageError&) {
      continue;
    }
    ++taken;
    // Default parameters describe deformations that leave the rest pose alone.
    testing::check_energy(entry.name + " on " + to_string(domain.kind()), *energy, domain,
                          rest_is_minimal(entry, traits, domain));
  }
  EXPECT_GT(taken, 0);
}

INSTANTIATE_TEST_SUITE_P(All, RegisteredEnergy, ::testing::ValuesIn(energies().names()));

TEST(Poisson, PassesTheSuiteOnTetrahedraAndFewerColumns) {
  const std::vector<Domain> domains = small_domains();
  testing::check_energy("poisson, tetrahedral", *make_poisson(Eigen::MatrixXd(Eigen::Matrix3d::Identity())), domains[3],
                        true);
  testing::check_energy("poisson, planar, 1 column", *make_poisson(Eigen::MatrixXd(Eigen::Vector2d(1.0, -2.0))),
                        domains[0], false);
}

// On a surface the gradient of the coordinates is I - n n', the projection to the tangent plane: guided by it the rest
// pose is minimal, guided by the identity it is not.
TEST(Poisson, PassesTheSuiteOnSurfacesOpenAndClosed) {
  const auto identity = make_poisson(Eigen::MatrixXd(Eigen::Matrix3d::Identity()));
  int surfaces = 0;
  for (const Domain& domain : small_domains()) {
    if (domain.kind() != DomainKind::surface) continue;
    ++surfaces;
    const std::string label = domain.boundary_facets().rows() > 0 ? "open" : "closed";
    Matrix tangent(domain.cell_count(), 9);
    for (Index t = 0; t < domain.cell_count(); ++t) {
      const Eigen::Vector3d n = domain.normals().row(t);
      const Eigen::Matrix3d projection = Eigen::Matrix3d::Identity() - n * n.transpose();
      tangent.row(t) = Eigen::Map<const Eigen::RowVectorXd>(projection.data(), 9);
    }
    testing::check_energy("poisson, tangent guidance, " + label, *make_poisson(tangent, 3), domain, true);
    testing::check_energy("poisson, identity guidance, " + label, *identity, domain, false);
    // The residual there is -n n' on every cell.
    const Problem problem(domain, *identity, {}, testing::fixed_at(domain, 3, {{0, Eigen::RowVector3d::Zero()}}));
    EXPECT_NEAR(problem.value(domain.positions()).plain, domain.total_measure(), 1e-12) << label;
  }
  EXPECT_EQ(surfaces, 2);
}

// An energy with a smoothness of its own passes through the same problem and assembly.
class SelfRegularized final : public CellEnergy {
 public:
  EnergyTraits traits(const Domain&) const override {
    return {.residuals = 2,
            .unknowns = 1,
            .columns = 1,
            .kernel = Kernel::constants,
            .regularizer_kernel = Kernel::constants};
  }
  void cell(const Domain& domain, Index t, Eigen::Ref<Eigen::MatrixXd> E) const override { E = domain.gradient(t); }
  std::optional<Term> regularizer(const Domain& domain, const NormOptions&) const override {
    Form form(domain.vertex_count(), domain.facet_vertices(), 1, 1, 1);
    refresh_regularizer(domain, form);
    return Term{std::move(form), diagonal_norm(Vector::Ones(domain.facet_count()))};
  }
  // Difference of the values at the two ends of every interior facet, weighted by its measure.
  void refresh_regularizer(const Domain& domain, Form& form) const override {
    for (Index f = 0; f < domain.facet_count(); ++f) {
      const double root = std::sqrt(domain.facet_measures()[f]);
      form.block(f) << root, -root;
    }
  }
};

TEST(ProblemSuppliedRegularizer, IsBlendedByBeta) {
  const Domain domain(rectangle_mesh({.h = 0.2, .jitter = 0.3}));
  const SelfRegularized energy;
  Constraints constraints(domain.vertex_count(), 1);
  constraints.fix(0, Eigen::RowVectorXd::Constant(1, 0.0));
  constraints.fix(domain.vertex_count() - 1, Eigen::RowVectorXd::Constant(1, 1.0));
  const double beta = 0.4;
  Problem problem(domain, energy, {.beta = beta}, constraints);
  const Matrix u = Matrix::Random(domain.vertex_count(), 1);
  double variation = 0.0;
  for (Index f = 0; f < domain.facet_count(); ++f) {
    const double jump = u(domain.facet_vertices()(f, 0), 0) - u(domain.facet_vertices()(f, 1), 0);
    variation += domain.facet_measures()[f] * jump * jump;
  }
  Problem plain(domain, energy, {.beta = 0.0}, constraints);
  const EnergyValue value = problem.value(u);
  EXPECT_NEAR(value.variation, variation, 1e-12 * variation);
  EXPECT_NEAR(value.plain, plain.value(u).plain, 1e-12);
  EXPECT_NEAR(value.total, (1 - beta) * value.plain + beta * variation, 1e-12);
  const auto ldlt = make_linear_backend("eigen.ldlt");
  const Matrix minimizer = problem.solve(*ldlt);
  Matrix feasible = u;
  feasible(0, 0) = feasible(domain.vertex_count() - 1, 0) = 0.0;
  EXPECT_LT(problem.value(minimizer).total, problem.value(minimizer + 1e-3 * feasible).total);
  const Vector gradient = problem.normal_matrix().selfadjointView<Eigen::Lower>() * Vector(minimizer);
  EXPECT_LT(gradient.segment(1, domain.vertex_count() - 2).cwiseAbs().maxCoeff(), 1e-10);
}

// Every energies/**/*.cpp that describes an energy is in the registry, and nothing else is.
TEST(EnergyRegistry, ListsEveryEnergyInTheTree) {
  std::set<std::string> described;
  const std::regex pattern("EnergyEntry describe_([a-z0-9_]+)\\(\\) *\\{");
  for (const auto& file : std::filesystem::recursive_directory_iterator(VARIFORM_SOURCE_DIR "/energies")) {
    if (file.path().extension() != ".cpp") continue;
    std::stringstream text;
    text << std::ifstream(file.path()).rdbuf();
    const std::string source = text.str();
    for (std::sregex_iterator it(source.begin(), source.end(), pattern); it != std::sregex_iterator(); ++it) {
      described.insert((*it)[1]);
    }
  }
  std::set<std::string> registered;
  for (const std::string& name : energies().names())
    registered.insert(std::regex_replace(name, std::regex("\\."), "_"));
  EXPECT_EQ(described, registered);
}

}  // namespace
}  // namespace variform
