// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>
#include <random>
#include <regex>
#include <set>

#include "energies/energies.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/spectrum.h"
#include "framework/operators/operators.h"
#include "solvers/eigen/eigen_backends.h"
#include "solvers/linear/linear_backends.h"
#include "tests/support.h"

namespace variform {
namespace {

using testing::message_of;
using testing::test_name;

using ::testing::AllOf;
using ::testing::HasSubstr;
using Triplets = std::vector<Eigen::Triplet<double>>;

constexpr double kPi = std::numbers::pi;

SparseMatrix from_triplets(Index n, const Triplets& triplets) {
  SparseMatrix A(n, n);
  A.setFromTriplets(triplets.begin(), triplets.end());
  return A;
}

SparseMatrix diagonal(const Vector& values) {
  Triplets triplets;
  for (Index i = 0; i < values.size(); ++i) triplets.emplace_back(i, i, values[i]);
  return from_triplets(static_cast<Index>(values.size()), triplets);
}

SparseMatrix lower(const SparseMatrix& A) { return A.triangularView<Eigen::Lower>(); }

Eigen::MatrixXd dense(const SparseMatrix& lower_triangle) {
  return Eigen::MatrixXd(lower_triangle).selfadjointView<Eigen::Lower>();
}

struct Pencil {
  SparseMatrix K;
  SparseMatrix M;
};

/// Linear elements for -u'' = lambda u on (0, 1), u = 0 at both ends, n inner nodes. Eigenvalues (k pi)^2 + O(h^2).
Pencil interval(Index n) {
  const double h = 1.0 / (n + 1);
  Triplets K;
  Triplets M;
  for (Index i = 0; i < n; ++i) {
    K.emplace_back(i, i, 2.0 / h);
    M.emplace_back(i, i, 4.0 * h / 6.0);
    if (i + 1 == n) break;
    K.emplace_back(i + 1, i, -1.0 / h);
    M.emplace_back(i + 1, i, h / 6.0);
  }
  return {from_triplets(n, K), from_triplets(n, M)};
}

/// Rows and columns of the vertices that are not on the boundary of a rectangle.
SparseMatrix inner_part(const SparseMatrix& A, const std::vector<Index>& number, Index count) {
  Triplets triplets;
  for (Index j = 0; j < A.cols(); ++j) {
    for (SparseMatrix::InnerIterator entry(A, j); entry; ++entry) {
      if (entry.row() >= j && number[entry.row()] >= 0 && number[j] >= 0) {
        triplets.emplace_back(number[entry.row()], number[j], entry.value());
      }
    }
  }
  return from_triplets(count, triplets);
}

/// The Dirichlet Laplacian of a rectangle 2 x 1: eigenvalues pi^2 (i^2 / 4 + j^2) + O(h^2).
Pencil rectangle(double h) {
  const Domain domain(rectangle_mesh({.width = 2.0, .height = 1.0, .h = h}));
  std::vector<Index> number(static_cast<std::size_t>(domain.vertex_count()), -1);
  Index count = 0;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const double x = domain.positions()(v, 0);
    const double y = domain.positions()(v, 1);
    if (x > 1e-9 && x < 2.0 - 1e-9 && y > 1e-9 && y < 1.0 - 1e-9) number[v] = count++;
  }
  return {inner_part(cotangent_laplacian(domain), number, count), inner_part(mass_matrix(domain), number, count)};
}

Pencil random_pencil(Index n, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<Index> column(0, n - 1);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  const auto gram = [&](double shift) {
    Triplets triplets;
    for (Index i = 0; i < 2 * n; ++i) {
      for (Index k = 0; k < 3; ++k) triplets.emplace_back(i, column(generator), value(generator));
    }
    SparseMatrix J(2 * n, n);
    J.setFromTriplets(triplets.begin(), triplets.end());
    SparseMatrix I(n, n);
    I.setIdentity();
    return lower(SparseMatrix(J.transpose() * J) + shift * I);
  };
  return {gram(0.0), gram(1.0)};
}

Vector dense_values(const Pencil& pencil, Index count) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> solver(dense(pencil.K), dense(pencil.M));
  return solver.eigenvalues().head(count);
}

/// A problem wants constraints; its spectrum does not see them.
Constraints left_side_held(const Domain& domain) {
  const int d = domain.ambient_dimension();
  Constraints constraints(domain.vertex_count(), d);
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.positions()(v, 0) < 1e-9) constraints.fix(v, Eigen::RowVectorXd::Zero(d));
  }
  return constraints;
}

std::vector<std::string> available() {
  std::vector<std::string> names;
  for (const EigenBackendEntry& entry : eigen_backends().entries()) {
    if (entry.available) names.push_back(entry.name);
  }
  return names;
}

class AnyEigenBackend : public ::testing::TestWithParam<std::string> {
 protected:
  std::unique_ptr<EigenBackend> backend_ = make_eigen_backend(GetParam());
};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(AnyEigenBackend);
INSTANTIATE_TEST_SUITE_P(All, AnyEigenBackend, ::testing::ValuesIn(available()), test_name);

TEST_P(AnyEigenBackend, AgreesWithDenseOnRandomMatrices) {
  const Pencil pencil = random_pencil(120, 1);
  const Index count = 8;
  const EigenPairs pairs = backend_->solve(pencil.K, pencil.M, count);
  const Vector expected = dense_values(pencil, count);
  ASSERT_EQ(pairs.values.size(), count);
  EXPECT_LT((pairs.values - expected).cwiseAbs().maxCoeff(), 1e-10 * expected.maxCoeff());
  const Eigen::MatrixXd K = dense(pencil.K);
  const Eigen::MatrixXd M = dense(pencil.M);
  const Eigen::MatrixXd& X = pairs.vectors;
  EXPECT_LT((X.transpose() * M * X - Eigen::MatrixXd::Identity(count, count)).norm(), 1e-12);
  EXPECT_LT((K * X - M * X * pairs.values.asDiagonal()).norm(), 1e-7);
  for (Index j = 0; j < count; ++j) EXPECT_EQ(X.col(j).cwiseAbs().maxCoeff(), X.col(j).maxCoeff());

  const EigenReport& report = backend_->report();
  EXPECT_EQ(report.backend, GetParam());
  EXPECT_TRUE(report.ok);
  EXPECT_EQ(report.rows, 120);
  EXPECT_EQ(report.count, count);
  EXPECT_LT(report.shift, 0.0);
  EXPECT_GE(report.operations, count);
  EXPECT_GE(report.iterations, 1);
  ASSERT_EQ(report.residuals.size(), count);
  EXPECT_LT(report.residual, 1e-7);
  EXPECT_EQ(report.completed, 0);
}

TEST_P(AnyEigenBackend, GivesTheSameBitsTwice) {
  const Pencil pencil = random_pencil(80, 2);
  const EigenPairs first = backend_->solve(pencil.K, pencil.M, 5);
  const EigenPairs second = make_eigen_backend(GetParam())->solve(pencil.K, pencil.M, 5);
  EXPECT_EQ(first.values, second.values);
  EXPECT_EQ(first.vectors, second.vectors);
}

TEST_P(AnyEigenBackend, SpectrumOfAnIntervalConvergesWithTheSquareOfH) {
  Eigen::Vector2d errors;
  for (int level = 0; level < 2; ++level) {
    const Pencil pencil = interval(level == 0 ? 49 : 99);
    const EigenPairs pairs = backend_->solve(pencil.K, pencil.M, 5);
    const Vector exact = Vector::LinSpaced(5, 1.0, 5.0).array().square() * kPi * kPi;
    errors[level] = ((pairs.values - exact).array() / exact.array()).maxCoeff();
    EXPECT_GT((pairs.values - exact).minCoeff(), 0.0);  // Rayleigh-Ritz: from above
  }
  EXPECT_LT(errors[1], 0.003);
  EXPECT_NEAR(errors[0] / errors[1], 4.0, 0.1);
}

TEST_P(AnyEigenBackend, SpectrumOfARectangleConvergesWithTheSquareOfH) {
  std::vector<double> all;
  for (int i = 1; i < 8; ++i) {
    for (int j = 1; j < 8; ++j) all.push_back(kPi * kPi * (0.25 * i * i + j * j));
  }
  std::sort(all.begin(), all.end());
  const Vector exact = Eigen::Map<const Vector>(all.data(), 6);  // 5 pi^2 is double: (1, 2) alone, (4, 1) with it
  Eigen::Vector2d errors;
  for (int level = 0; level < 2; ++level) {
    const Pencil pencil = rectangle(level == 0 ? 0.1 : 0.05);
    const EigenPairs pairs = backend_->solve(pencil.K, pencil.M, 6);
    errors[level] = ((pairs.values - exact).array() / exact.array()).abs().maxCoeff();
  }
  EXPECT_LT(errors[1], 0.05);
  EXPECT_NEAR(errors[0] / errors[1], 4.0, 0.6);
}

TEST_P(AnyEigenBackend, FindsAllCopiesOfAMultipleEigenvalue) {
  // 20 copies of 1, spread over the unknowns, above a simple one and below the rest.
  const Index n = 300;
  Vector values(n);
  for (Index i = 0; i < n; ++i) values[i] = i % 15 == 7 ? 1.0 : 2.0 + 0.01 * i;
  values[100] = 0.5;
  const EigenPairs pairs = backend_->solve(diagonal(values), SparseMatrix(), 22);
  std::sort(values.begin(), values.end());
  EXPECT_LT((pairs.values - values.head(22)).cwiseAbs().maxCoeff(), 1e-9);
}

TEST_P(AnyEigenBackend, SeparatesClusteredEigenvalues) {
  const Index n = 200;
  Vector values = Vector::LinSpaced(n, 5.0, 50.0);
  for (Index i = 0; i < 4; ++i) values[17 * i + 3] = 1.0 + 1e-7 * i;
  const EigenPairs pairs = backend_->solve(diagonal(values), SparseMatrix(), 4);
  for (Index i = 0; i < 4; ++i) EXPECT_NEAR(pairs.values[i], 1.0 + 1e-7 * i, 1e-11);
}

TEST_P(AnyEigenBackend, OnePairAndAllButOne) {
  const Pencil pencil = random_pencil(12, 3);
  const Vector expected = dense_values(pencil, 12);
  EXPECT_NEAR(backend_->solve(pencil.K, pencil.M, 1).values[0], expected[0], 1e-11);
  EXPECT_LT((backend_->solve(pencil.K, pencil.M, 11).values - expected.head(11)).norm(), 1e-10);
  const Pencil two{diagonal(Eigen::Vector2d(3.0, 2.0)), SparseMatrix()};
  EXPECT_NEAR(backend_->solve(two.K, two.M, 1).values[0], 2.0, 1e-12);
}

TEST_P(AnyEigenBackend, RefusesWhatItCannotDo) {
  const Pencil pencil = random_pencil(40, 4);
  for (const Index count : {0, 40, 41}) {
    EXPECT_THAT(message_of([&] { backend_->solve(pencil.K, pencil.M, count); }, ExitCode::usage),
                AllOf(HasSubstr(std::to_string(count) + " eigenpairs"), HasSubstr("1 to 39")));
  }
  EXPECT_THROW(backend_->solve(pencil.K, diagonal(Vector::Ones(39)), 2), UsageError);
  EXPECT_THAT(message_of([&] { backend_->solve(dense(pencil.K).sparseView(), pencil.M, 2); }, ExitCode::usage),
              HasSubstr("lower triangle"));
  SparseMatrix nan = pencil.K;
  nan.valuePtr()[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message_of([&] { backend_->solve(nan, pencil.M, 2); }, ExitCode::solver), HasSubstr("not finite"));
  EXPECT_FALSE(backend_->report().ok);

  const Vector values = dense_values(pencil, 3);
  backend_->options.shift = 0.5 * (values[1] + values[2]);
  EXPECT_THAT(message_of([&] { backend_->solve(pencil.K, pencil.M, 2); }, ExitCode::solver),
              HasSubstr("below all eigenvalues"));
  backend_->options.shift = -1.0;
  EXPECT_NEAR(backend_->solve(pencil.K, pencil.M, 2).values[1], values[1], 1e-10);
  EXPECT_EQ(backend_->report().shift, -1.0);
}

// Solvers for indefinite matrices factorize K - shift M whatever the shift: what lies below it would be left out.
TEST_P(AnyEigenBackend, ShiftAboveAnEigenvalueIsAnErrorWithInnerSolversForIndefiniteMatrices) {
  const Pencil pencil = random_pencil(40, 4);
  const Vector values = dense_values(pencil, 12);
  for (const std::string inner : {"eigen.lu", "eigen.qr"}) {
    for (const Index below : {1, 2, 10}) {
      Parameters parameters(eigen_backends().find(GetParam()).parameters);
      parameters.set("inner", inner);
      const auto backend = make_eigen_backend(GetParam(), parameters);
      backend->options.shift = 0.5 * (values[below - 1] + values[below]);
      EXPECT_THAT(message_of([&] { backend->solve(pencil.K, pencil.M, 3); }, ExitCode::solver),
                  HasSubstr("below all eigenvalues"))
          << inner << ", " << below << " eigenvalues below";
    }
  }
}

TEST_P(AnyEigenBackend, RefusesAShiftAmongTheEigenvaluesWhateverTheInnerSolver) {
  for (const std::string inner : {"eigen.lu", "eigen.qr"}) {
    Parameters parameters(eigen_backends().find(GetParam()).parameters);
    parameters.set("inner", inner);
    parameters.set("shift", 20.5);
    const auto backend = make_eigen_backend(GetParam(), parameters);
    const SparseMatrix middle = diagonal(Vector::LinSpaced(60, 1.0, 60.0));
    EXPECT_THAT(message_of([&] { backend->solve(middle, SparseMatrix(), 4); }, ExitCode::solver),
                HasSubstr("below all eigenvalues"));
    Vector values = Vector::LinSpaced(60, 21.0, 80.0);
    values[30] = 1.0;  // far from the shift: none of those that are found first
    EXPECT_THAT(message_of([&] { backend->solve(diagonal(values), SparseMatrix(), 4); }, ExitCode::solver),
                HasSubstr("below all eigenvalues"));
  }
}

TEST_P(AnyEigenBackend, FindsBothCopiesOfTheManyDoubleEigenvaluesOfASquare) {
  const Index m = 60;
  Triplets triplets;
  std::vector<double> all;
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      triplets.emplace_back(i * m + j, i * m + j, 4.0);
      if (j + 1 < m) triplets.emplace_back(i * m + j + 1, i * m + j, -1.0);
      if (i + 1 < m) triplets.emplace_back(i * m + m + j, i * m + j, -1.0);
      const auto one = [&](Index k) { return 2.0 - 2.0 * std::cos((k + 1) * kPi / (m + 1)); };
      all.push_back(one(i) + one(j));
    }
  }
  std::sort(all.begin(), all.end());
  for (const Index count : {10, 25, 40}) {
    const EigenPairs pairs = backend_->solve(from_triplets(m * m, triplets), SparseMatrix(), count);
    const Vector exact = Eigen::Map<const Vector>(all.data(), count);
    EXPECT_LT((pairs.values - exact).cwiseAbs().maxCoeff(), 1e-10) << count << ' ' << backend_->report().completed;
  }
}

TEST_P(AnyEigenBackend, SaysWhenItDoesNotConverge) {
  const Pencil pencil = interval(400);
  backend_->options.max_iterations = 1;
  backend_->options.subspace = 7;
  backend_->options.shift = -1e7;
  EXPECT_THAT(message_of([&] { backend_->solve(pencil.K, pencil.M, 6); }, ExitCode::solver),
              AllOf(HasSubstr("of 6 eigenvalues converged"), HasSubstr("7 vectors")));
  EXPECT_FALSE(backend_->report().ok);
  EXPECT_THAT(backend_->report().reason, HasSubstr("converged"));
}

TEST_P(AnyEigenBackend, TakesEveryLinearBackendAsInnerSolver) {
  const Pencil pencil = interval(60);
  const Vector expected = dense_values(pencil, 3);
  for (const LinearBackendEntry& entry : linear_backends().entries()) {
    if (!entry.available) continue;
    Parameters parameters(eigen_backends().find(GetParam()).parameters);
    parameters.set("inner", entry.name);
    const auto backend = make_eigen_backend(GetParam(), parameters);
    EXPECT_LT((backend->solve(pencil.K, pencil.M, 3).values - expected).norm(), 1e-8 * expected[0]) << entry.name;
    EXPECT_GT(backend->report().operations, 3) << entry.name;
  }
}

// Infinitesimal rigid motions cost nothing: 3 in the plane, 6 in space; the next mode costs something.
TEST_P(AnyEigenBackend, FreeModesOfAnElasticEnergy) {
  const EnergyEntry& entry = energies().find("akvf");
  const auto energy = entry.make(Parameters(entry.parameters));
  const Domain plane(rectangle_mesh({.width = 2.0, .height = 1.0, .h = 0.125, .jitter = 0.2}));
  const Domain space(bar_tet_mesh(2.0, 1.0, 1.0, 0.5));
  for (const Domain* domain : {&plane, &space}) {
    const int d = domain->ambient_dimension();
    const Index rigid = d == 2 ? 3 : 6;
    Problem problem(*domain, *energy, {.beta = 0.2}, left_side_held(*domain));
    const EigenPairs modes = spectrum(problem, *backend_, rigid + 2);
    const double first = modes.values[rigid];
    EXPECT_GT(first, 1e-2);
    EXPECT_LT(modes.values.head(rigid).cwiseAbs().maxCoeff(), 1e-8 * first);
    // They span the rigid motions: fields of these have no part left.
    const Eigen::MatrixXd basis = kernel_basis(problem.traits(), *domain);
    ASSERT_EQ(basis.cols(), rigid);
    const Eigen::MatrixXd V = modes.vectors.leftCols(rigid);
    EXPECT_LT((basis - V * (V.transpose() * V).ldlt().solve(V.transpose() * basis)).norm(), 1e-6 * basis.norm());
  }
}

// A sphere is rigid, a sheet is not: its smoothness alone holds all that is no rigid motion.
TEST_P(AnyEigenBackend, SmoothedNearIsometricEnergiesHaveSixFreeModes) {
  const EnergyEntry& entry = energies().find("near_isometric");
  const auto energy = entry.make(Parameters(entry.parameters));
  const Domain sphere(sphere_mesh(1.0, 0.5));
  const Domain sheet(half_cylinder_mesh(1.0, 2.0, {.h = 0.25, .jitter = 0.2}));
  for (const Domain* domain : {&sphere, &sheet}) {
    for (const double omega : {1.0 / 3.0, 1.0}) {
      Problem problem(*domain, *energy, {.beta = omega}, left_side_held(*domain));
      for (const SpectrumMetric metric : {SpectrumMetric::mass, SpectrumMetric::identity}) {
        const EigenPairs modes = spectrum(problem, *backend_, 8, metric);
        const double first = modes.values[6];
        EXPECT_LT(modes.values.head(6).cwiseAbs().maxCoeff(), 1e-7 * first) << omega;
        if (metric == SpectrumMetric::mass) continue;
        // Unit vectors whose energy is their eigenvalue.
        const Matrix x = Eigen::Map<const Matrix>(modes.vectors.col(6).data(), domain->vertex_count(), 3);
        EXPECT_NEAR(x.norm(), 1.0, 1e-8);
        EXPECT_NEAR(problem.value(x).total, first, 1e-8 * first);
      }
    }
  }
}

TEST(EigenBackends, AgreeWithEachOther) {
  const Pencil pencil = rectangle(0.05);
  std::vector<EigenPairs> all;
  for (const std::string& name : available()) {
    all.push_back(make_eigen_backend(name)->solve(pencil.K, pencil.M, 9));
    EXPECT_LT((all.back().values - all.front().values).norm(), 1e-8 * all.front().values[0]) << name;
    const Eigen::MatrixXd overlap = all.back().vectors.transpose() * dense(pencil.M) * all.front().vectors;
    EXPECT_LT((overlap * overlap.transpose() - Eigen::MatrixXd::Identity(9, 9)).norm(), 1e-8) << name;
  }
}

TEST(EigenRegistry, EntriesAreCompleteAndErrorsNameThePackage) {
  EXPECT_THAT(message_of([] { make_eigen_backend("lapack"); }, ExitCode::usage),
              AllOf(HasSubstr("lapack"), HasSubstr("arpack"), HasSubstr("spectra.shift_invert")));
  for (const EigenBackendEntry& entry : eigen_backends().entries()) {
    EXPECT_FALSE(entry.doc.empty()) << entry.name;
    EXPECT_FALSE(entry.licence.empty()) << entry.name;
    if (entry.available) continue;
    EXPECT_THAT(message_of([&] { make_eigen_backend(entry.name); }, ExitCode::usage),
                AllOf(HasSubstr(entry.package), HasSubstr(entry.option + "=ON")));
  }
}

TEST(EigenRegistry, HoldsEveryBackendInTheFolder) {
  std::set<std::string> described;
  const std::regex definition(R"(EigenBackendEntry describe_(\w+)\(\) \{)");
  for (const auto& file : std::filesystem::directory_iterator(VARIFORM_SOURCE_DIR "/solvers/eigen")) {
    if (file.path().extension() != ".cpp") continue;
    std::ifstream stream(file.path());
    const std::string text(std::istreambuf_iterator<char>(stream), {});
    std::smatch match;
    if (!std::regex_search(text, match, definition)) continue;
    EXPECT_EQ(file.path().stem(), match[1].str());
    std::string name = match[1];
    if (const auto underscore = name.find('_'); underscore != std::string::npos) name[underscore] = '.';
    described.insert(name);
  }
  const std::vector<std::string> names = eigen_backends().names();
  EXPECT_EQ(described, std::set<std::string>(names.begin(), names.end()));
}

}  // namespace
}  // namespace variform
