// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

#include "energies/energies.h"
#include "energies/vector_field/vector_field.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "framework/operators/distortion.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"
#include "tests/energies/energy_suite.h"
#include "tests/support.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr FacetWeight kWeights[] = {FacetWeight::facet_measure, FacetWeight::facet_measure_unit,
                                    FacetWeight::finite_volume};

Domain square() { return Domain(rectangle_mesh({.h = 0.2, .jitter = 0.3})); }

// A Kuhn cube with its inner vertex moved, so that no symmetry helps.
Domain cube() {
  Domain domain(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  Matrix positions = domain.positions();
  positions += 0.08 * Matrix::Random(positions.rows(), 3);
  domain.set_positions(positions);
  return domain;
}

std::unique_ptr<Energy> make(const std::string& name,
                             const std::vector<std::pair<std::string, ParameterValue>>& values = {}) {
  const EnergyEntry& entry = energies().find(name);
  Parameters parameters(entry.parameters);
  for (const auto& [key, value] : values) parameters.set(key, value);
  return entry.make(parameters);
}

// Value and matrix of an energy; the constraints are there for the problem to be well-posed, nothing is solved.
struct Evaluated {
  EnergyValue value;
  Eigen::MatrixXd H;
};
Evaluated evaluate(const Domain& domain, const Energy& energy, const NormOptions& norm, const Matrix& U) {
  Constraints all(domain.vertex_count(), static_cast<int>(U.cols()));
  for (Index v = 0; v < domain.vertex_count(); v += 2) all.fix(v, U.row(v));
  Problem problem(domain, energy, norm, all);
  problem.refresh_target(U);
  return {problem.value(U), testing::dense_symmetric(problem.normal_matrix())};
}

Matrix minimize(const Domain& domain, const Energy& energy, const NormOptions& norm, const Constraints& constraints) {
  Problem problem(domain, energy, norm, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  return problem.solve(*linear);
}

Eigen::MatrixXd random_tensor(int p) {
  const Eigen::MatrixXd X = Eigen::MatrixXd::Random(p, p);
  return X * X.transpose() + 0.2 * Eigen::MatrixXd::Identity(p, p);
}

Matrix row_of(const Eigen::MatrixXd& B) { return Eigen::Map<const Eigen::RowVectorXd>(B.data(), B.size()); }

double density(const VectorFieldWeights& w, const Eigen::MatrixXd& B, const Eigen::MatrixXd& J) {
  const Eigen::MatrixXd strain = J + J.transpose();
  const double divergence = (B * J).trace();
  return w.strain * (strain.transpose() * B * strain).trace() + w.divergence * divergence * divergence;
}

TEST(VectorFieldMatrix, IsTheQuadraticFormInTheJacobianOrItsTranspose) {
  for (const int p : {2, 3}) {
    for (int sample = 0; sample < 5; ++sample) {
      const VectorFieldWeights w = phi_weights(0.4 + 0.4 * sample);
      const Eigen::MatrixXd B = random_tensor(p);
      const Eigen::MatrixXd M = vector_field_matrix(w, B);
      Eigen::MatrixXd J = Eigen::MatrixXd::Random(p, p);
      for (int turn = 0; turn < 2; ++turn, J.transposeInPlace()) {
        const Eigen::Map<const Eigen::VectorXd> j(J.data(), p * p);
        EXPECT_NEAR(j.dot(M * j), density(w, B, J), 1e-13 * M.norm());
      }
    }
  }
}

TEST(VectorFieldRoot, SquaresToTheMatrix) {
  for (const int p : {2, 3}) {
    const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(p, p);
    for (const double phi : {1e-3, std::atan(0.5), 0.5 * kPi, 2.2, largest_phi(p)}) {
      const Eigen::MatrixXd S = vector_field_root(phi_weights(phi), p);
      EXPECT_LT((S * S - vector_field_matrix(phi_weights(phi), I)).norm(), 1e-14 * p * p) << p << " " << phi;
      EXPECT_LT((S - S.transpose()).norm(), 1e-15);
      // The closed form is the positive semi-definite root, so the one by eigen-decomposition is the same.
      EXPECT_LT((S - vector_field_root(phi_weights(phi), I)).norm(), 1e-13) << p << " " << phi;
    }
    for (int sample = 0; sample < 10; ++sample) {
      const Eigen::MatrixXd B = random_tensor(p);
      for (const double phi : {1e-3, 0.7, 2.0, largest_phi(B.trace())}) {
        const Eigen::MatrixXd M = vector_field_matrix(phi_weights(phi), B);
        const Eigen::MatrixXd S = vector_field_root(phi_weights(phi), B);
        EXPECT_LT((S * S - M).norm(), 1e-11 * M.norm());
        EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(S).eigenvalues()[0], -1e-14 * S.norm());
      }
    }
  }
}

TEST(VectorFieldRoot, HasThePublishedEntriesInThePlane) {
  const auto expect = [](const VectorFieldWeights& w, const Eigen::Matrix4d& expected) {
    EXPECT_LT((vector_field_root(w, 2) - expected).cwiseAbs().maxCoeff(), 1e-15);
  };
  const double r = std::sqrt(2.0);
  Eigen::Matrix4d S;
  S << 2, 0, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 2;
  expect({1.0, 0.0}, S);
  S(0, 0) = S(3, 3) = r + 1.0;
  S(0, 3) = S(3, 0) = r - 1.0;
  expect({1.0, 2.0}, S);
  S(0, 0) = S(3, 3) = 1.0;
  S(0, 3) = S(3, 0) = -1.0;
  expect({1.0, -2.0}, S);
  S.setZero();
  S(0, 0) = S(3, 3) = S(0, 3) = S(3, 0) = r / 2.0;
  expect({0.0, 1.0}, S);
}

// Deficits of the 4 x 4 matrices: 1, 1, 2, 3, not three times as many for AUTH as for all others (errata C16).
TEST(VectorFieldMatrix, HasTheRankDeficitsOfErrataC16) {
  const auto deficit = [](const VectorFieldWeights& w) {
    const Vector values =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(vector_field_matrix(w, Eigen::Matrix2d::Identity()))
            .eigenvalues();
    return (values.array() < 1e-12 * values.maxCoeff()).count();
  };
  EXPECT_EQ(deficit({1.0, 0.0}), 1);
  EXPECT_EQ(deficit({1.0, 2.0}), 1);
  EXPECT_EQ(deficit({1.0, -2.0}), 2);
  EXPECT_EQ(deficit({0.0, 1.0}), 3);
}

TEST(VectorFieldMatrix, IsPositiveSemidefiniteExactlyInTheStatedRange) {
  for (const int p : {2, 3}) {
    for (int sample = 0; sample < 6; ++sample) {
      const Eigen::MatrixXd B = sample == 0 ? Eigen::MatrixXd::Identity(p, p).eval() : random_tensor(p);
      const double end = largest_phi(B.trace());
      const auto least = [&](double phi) {
        return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(vector_field_matrix(phi_weights(phi), B))
            .eigenvalues()[0];
      };
      for (const double phi : {1e-6, 0.5, 2.0, end - 1e-6, end}) EXPECT_GT(least(phi), -1e-13 * B.norm()) << phi;
      for (const double phi : {-1e-4, end + 1e-4}) {
        EXPECT_LT(least(phi), -1e-6) << phi;
        EXPECT_THROW(vector_field_root(phi_weights(phi), B), UsageError) << phi;
      }
    }
    EXPECT_THROW(vector_field_root(phi_weights(largest_phi(p) + 1e-4), p), UsageError);
  }
}

// Squared rate of squared length, averaged over all directions: (|J+J'|^2 + 2 tr(J)^2) / 4 in the plane and 2/15 times
// that in space, where the source prints 1/30 (errata C9).
TEST(VectorFieldMatrix, MetricIsTheMeanRateOfSquaredLength) {
  const Eigen::Matrix2d J2 = Eigen::Matrix2d::Random();
  double mean2 = 0.0;
  const int steps = 32;
  for (int i = 0; i < steps; ++i) {
    const Eigen::Vector2d r(std::cos(2.0 * kPi * i / steps), std::sin(2.0 * kPi * i / steps));
    mean2 += std::pow(r.dot((J2 + J2.transpose()) * r), 2) / steps;
  }
  EXPECT_NEAR(mean2, 0.25 * density({1.0, 2.0}, Eigen::Matrix2d::Identity(), J2), 1e-12);
  // In space: the vertices of an icosahedron integrate polynomials of degree 4 on the sphere exactly.
  const Eigen::Matrix3d J3 = Eigen::Matrix3d::Random();
  const double golden = 0.5 * (1.0 + std::sqrt(5.0));
  double mean3 = 0.0;
  for (int k = 0; k < 3; ++k) {
    for (const double a : {-1.0, 1.0}) {
      for (const double b : {-golden, golden}) {
        Eigen::Vector3d r;
        r[k] = 0.0;
        r[(k + 1) % 3] = a;
        r[(k + 2) % 3] = b;
        r.normalize();
        mean3 += std::pow(r.dot((J3 + J3.transpose()) * r), 2) / 12.0;
      }
    }
  }
  EXPECT_NEAR(mean3, 2.0 / 15.0 * density({1.0, 2.0}, Eigen::Matrix3d::Identity(), J3), 1e-12);
}

TEST(VectorFields, HaveTheStatedDensities) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Eigen::MatrixXd B = random_tensor(p);
    Eigen::VectorXd axis = Eigen::VectorXd::LinSpaced(p, 1.0, -0.5);
    const Eigen::MatrixXd stiff =
        0.5 * Eigen::MatrixXd::Identity(p, p) + 2.5 * axis.normalized() * axis.normalized().transpose();
    const std::vector<double> axis_list(axis.begin(), axis.end());
    const std::vector<std::pair<std::string, ParameterValue>> along = {{"stiffness", std::vector<double>{3.0, 0.5}},
                                                                       {"axis", axis_list}};
    const Matrix v = Matrix::Random(domain.vertex_count(), p);
    const auto check = [&](const Energy& energy, const VectorFieldWeights& w, const Eigen::MatrixXd& tensor) {
      double expected = 0.0;
      for (Index t = 0; t < domain.cell_count(); ++t) {
        expected += domain.cell_measures()[t] * density(w, tensor, deformation(domain, t, v));
      }
      EXPECT_NEAR(evaluate(domain, energy, {}, v).value.plain, expected, 1e-11 * expected);
    };
    const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(p, p);
    check(*make("akvf"), {1.0, 0.0}, I);
    check(*make("metr"), {1.0, 2.0}, I);
    check(*make("conf"), {1.0, -4.0 / p}, I);
    check(*make("auth"), {1.0 / 512.0, 1.0}, I);
    check(*make("auth", {{"shear", 0.25}}), {0.25, 1.0}, I);
    check(*make("phi", {{"phi", 1.1}}), {std::sin(1.1), std::cos(1.1)}, I);
    check(*make("akvf", along), {1.0, 0.0}, stiff);
    check(*make("metr", along), {1.0, 2.0}, stiff);
    check(*make("conf", along), {1.0, -4.0 / stiff.trace()}, stiff);
    check(*make_vector_field_energy(Vector::Constant(1, 0.8), row_of(B)), phi_weights(0.8), B);
  }
}

TEST(VectorFields, HaveTheKernelsOfRigidMotionsAndSimilarities) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Index rigid = p == 2 ? 3 : 6;
    const Eigen::MatrixXd B = random_tensor(p);
    Vector mixed = Vector::Constant(domain.cell_count(), largest_phi(B.trace()));
    mixed[3] = 1.0;
    const auto conformal = make_vector_field_energy(Vector::Constant(1, largest_phi(B.trace())), row_of(B));
    const auto half = make_vector_field_energy(mixed, row_of(B));
    const auto phi = make("phi", {{"phi", 0.3}});
    std::map<std::string, std::unique_ptr<Energy>> named;
    for (const std::string name : {"akvf", "metr", "conf", "auth"}) named[name] = make(name);
    const std::vector<std::tuple<std::string, const Energy*, Index>> cases = {
        {"akvf", named["akvf"].get(), rigid},
        {"metr", named["metr"].get(), rigid},
        {"conf", named["conf"].get(), rigid + 1},
        {"auth", named["auth"].get(), rigid},
        {"phi", phi.get(), rigid},
        {"conformal phi with tensor", conformal.get(), rigid + 1},
        {"conformal on all cells but one", half.get(), rigid}};
    for (const auto& [label, energy, dimension] : cases) {
      EXPECT_EQ(kernel_basis(energy->traits(domain), domain).cols(), dimension) << label;
      for (const double beta : {0.0, 0.3, 0.9}) {
        const Eigen::MatrixXd H = evaluate(domain, *energy, {.beta = beta}, domain.positions()).H;
        const Vector values = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues();
        EXPECT_EQ((values.array() < 1e-11 * values.maxCoeff()).count(), dimension) << label << " " << beta;
      }
    }
  }
}

TEST(VectorFields, WithTensorsPassTheSuite) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    Matrix tensors(domain.cell_count(), p * p);
    Vector phi(domain.cell_count());
    for (Index t = 0; t < domain.cell_count(); ++t) {
      tensors.row(t) = row_of(random_tensor(p));
      phi[t] = 0.5 + 1.5 * t / domain.cell_count();
    }
    testing::check_energy("phi and tensors of their own on each cell", *make_vector_field_energy(phi, tensors), domain,
                          false);
    const Eigen::MatrixXd B = random_tensor(p);
    testing::check_energy("conformal with a tensor",
                          VectorFieldEnergy(VectorFieldKind::conformal, Vector::Zero(1), row_of(B)), domain, false);
  }
}

// Without strain AUTH sees nothing but the divergence: its kernel is large and not declared.
TEST(VectorFields, BareAuthalicFormIsUndeclared) {
  const Domain domain = square();
  const auto bare = make("auth", {{"shear", 0.0}});
  EXPECT_EQ(bare->traits(domain).kernel, Kernel::other);
  const Eigen::MatrixXd H = evaluate(domain, *bare, {}, domain.positions()).H;
  const Vector values = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues();
  EXPECT_GT((values.array() < 1e-11 * values.maxCoeff()).count(), 4);
}

TEST(VectorFields, AreLinearizedDeformations) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Matrix U = domain.positions() + 0.3 * Matrix::Random(domain.vertex_count(), p);
    for (const double beta : {0.0, 0.4}) {
      const double killing = evaluate(domain, *make("akvf"), {.beta = beta}, U - domain.positions()).value.total;
      EXPECT_NEAR(evaluate(domain, *make("larap"), {.beta = beta}, U).value.total, 0.25 * killing, 1e-12 * killing);
      if (p != 2) continue;
      const double conformal = evaluate(domain, *make("conf"), {.beta = beta}, U).value.total;
      EXPECT_NEAR(evaluate(domain, *make("asap"), {.beta = beta}, U).value.total, 0.25 * conformal, 1e-12 * conformal);
    }
    if (p == 2) {
      EXPECT_NEAR(evaluate(domain, *make("lscm"), {}, U).value.plain,
                  2.0 * domain.total_measure() * distortion(domain, U).conformal, 1e-11);
    }
  }
}

TEST(VectorFields, AffineFieldsDoNotVary) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Matrix affine = domain.positions() * Eigen::MatrixXd::Random(p, p);
    for (const std::string name : {"akvf", "metr", "conf", "auth", "phi", "larap"}) {
      for (const FacetWeight weight : kWeights) {
        const EnergyValue value = evaluate(domain, *make(name), {0.3, weight}, affine).value;
        EXPECT_LT(value.variation, 1e-26) << name;
        EXPECT_GT(value.plain, 1e-4) << name;
      }
    }
  }
}

TEST(VectorFields, TurnWithTheMeshAndTheTensors) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(0.9, p == 2 ? Eigen::Vector3d(0.0, 0.0, 1.0) : Eigen::Vector3d(2.0, -1.0, 0.5).normalized())
            .toRotationMatrix();
    const Eigen::MatrixXd Q = turn.topLeftCorner(p, p);
    Domain turned = domain;
    turned.set_positions(domain.positions() * Q.transpose());
    const Matrix v = Matrix::Random(domain.vertex_count(), p);
    const Matrix turned_v = v * Q.transpose();
    Matrix tensors(domain.cell_count(), p * p);
    for (Index t = 0; t < domain.cell_count(); ++t) tensors.row(t) = row_of(random_tensor(p));
    for (const double beta : {0.0, 0.5}) {
      for (const std::string name : {"akvf", "metr", "conf", "auth", "phi"}) {
        const double here = evaluate(domain, *make(name), {.beta = beta}, v).value.total;
        EXPECT_NEAR(evaluate(turned, *make(name), {.beta = beta}, turned_v).value.total, here, 1e-12 * here) << name;
      }
      const Vector phi = Vector::Constant(1, 1.2);
      const double here = evaluate(domain, *make_vector_field_energy(phi, tensors), {.beta = beta}, v).value.total;
      const auto carried = make_vector_field_energy(phi, tensors);
      carried->set_tensors(rotated_tensors(domain, turned.positions(), tensors));
      EXPECT_NEAR(evaluate(turned, *carried, {.beta = beta}, turned_v).value.total, here, 1e-11 * here);
      // Left behind, the tensors mean something else.
      const double unturned =
          evaluate(turned, *make_vector_field_energy(phi, tensors), {.beta = beta}, turned_v).value.total;
      EXPECT_GT(std::abs(unturned - here), 1e-4 * here);
    }
  }
}

// Where a cell is turned inside out, the closest rotation is still one: the mirror of the weaker direction is not.
TEST(RotatedTensors, FollowRotationsOnly) {
  const Domain domain = square();
  Matrix mirrored = domain.positions();
  mirrored.col(0) *= 2.0;
  mirrored.col(1) *= -1.0;
  const Matrix tensor = row_of((Eigen::Matrix2d() << 2.0, 0.5, 0.5, 1.0).finished());
  const Matrix carried = rotated_tensors(domain, mirrored, tensor);
  for (Index t = 0; t < domain.cell_count(); ++t) EXPECT_LT((carried.row(t) - tensor).norm(), 1e-13);
  EXPECT_THROW(rotated_tensors(domain, mirrored, Matrix::Ones(1, 9)), UsageError);
  EXPECT_THROW(rotated_tensors(domain, mirrored.topRows(3), tensor), UsageError);
}

// A square with its middle pushed apart, everything symmetric about the diagonal of the axes.
TEST(VectorFields, RespondSymmetricallyUnlessATensorIsStiffAlongOneAxis) {
  const Domain domain(rectangle_mesh({.h = 0.125, .tessellation = Tessellation::alternating}));
  const auto find = [&](double x, double y) {
    Index best = 0;
    (domain.positions().rowwise() - Eigen::RowVector2d(x, y)).rowwise().squaredNorm().minCoeff(&best);
    return best;
  };
  Constraints constraints(domain.vertex_count(), 2);
  constraints.fix(find(0.0, 0.0), Eigen::RowVector2d(0.0, 0.0));
  constraints.fix(find(1.0, 1.0), Eigen::RowVector2d(0.0, 0.0));
  constraints.fix(find(0.5, 0.5), Eigen::RowVector2d(0.2, 0.2));
  const auto asymmetry = [&](const Energy& energy) {
    const Matrix v = minimize(domain, energy, {.beta = 0.2}, constraints);
    double largest = 0.0;
    for (Index i = 0; i < domain.vertex_count(); ++i) {
      const Index j = find(domain.positions()(i, 1), domain.positions()(i, 0));
      largest = std::max(largest, (v.row(i) - v.row(j).reverse()).cwiseAbs().maxCoeff());
    }
    return largest;
  };
  EXPECT_LT(asymmetry(*make("akvf")), 1e-11);
  const auto stiff = [&](double along, double x, double y) {
    return make("akvf", {{"stiffness", std::vector<double>{along, 1.0}}, {"axis", std::vector<double>{x, y}}});
  };
  EXPECT_LT(asymmetry(*stiff(1.0, 1.0, 0.0)), 1e-11);
  EXPECT_LT(asymmetry(*stiff(20.0, 1.0, 1.0)), 1e-11);  // the axis of symmetry
  EXPECT_GT(asymmetry(*stiff(20.0, 1.0, 0.0)), 1e-2);
}

// phi from METR on the left to CONF on the right: the right half gives way in size, the left one does not.
TEST(VectorFields, NonhomogeneousPhiDistortsWhereItAllows) {
  const Domain domain(rectangle_mesh({.width = 2.0, .h = 0.125}));
  Vector phi(domain.cell_count());
  std::vector<bool> right(domain.cell_count());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    double x = 0.0;
    for (int i = 0; i < 3; ++i) x += domain.positions()(domain.cells()(t, i), 0) / 3.0;
    right[t] = x > 1.0;
    phi[t] = right[t] ? largest_phi(2) : std::atan(0.5);
  }
  Constraints constraints(domain.vertex_count(), 2);
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    const double x = domain.positions()(v, 0);
    if (x == 0.0 || x == 2.0) constraints.fix(v, Eigen::RowVector2d(0.0, (1.0 - x) * (domain.positions()(v, 1) - 0.5)));
  }
  const Matrix v = minimize(domain, *make_vector_field_energy(phi), {}, constraints);
  double growth[2] = {0.0, 0.0};
  for (Index t = 0; t < domain.cell_count(); ++t) {
    const double divergence = deformation(domain, t, v).trace();
    growth[right[t] ? 1 : 0] += domain.cell_measures()[t] * divergence * divergence;
  }
  EXPECT_GT(growth[1], 2.0 * growth[0]);
}

TEST(VectorFields, RigidConstraintVelocitiesGiveTheRigidField) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    Eigen::MatrixXd spin = Eigen::MatrixXd::Random(p, p);
    spin -= spin.transpose().eval();
    const Matrix rigid = (domain.positions() * spin).rowwise() + Eigen::RowVectorXd::LinSpaced(p, 0.5, -1.0);
    for (const std::string name : {"akvf", "metr", "conf", "auth", "phi"}) {
      const Matrix field = name == "conf" ? Matrix(rigid + 0.7 * domain.positions()) : rigid;
      for (const double beta : {0.0, 0.3, 0.9}) {
        for (const FacetWeight weight : kWeights) {
          Constraints constraints(domain.vertex_count(), p);
          for (Index v = 0; v < domain.vertex_count(); v += 5) constraints.fix(v, field.row(v));
          const Matrix v = minimize(domain, *make(name), {beta, weight}, constraints);
          EXPECT_LT((v - field).cwiseAbs().maxCoeff(), 1e-9) << name << " " << beta;
        }
      }
    }
  }
}

TEST(VectorFields, FollowTheDomainThatMoves) {
  Domain domain = square();
  const auto energy = make("metr");
  Constraints pins(domain.vertex_count(), 2);
  pins.fix(0, Eigen::RowVector2d::Zero());
  pins.fix(7, Eigen::RowVector2d(0.1, 0.2));
  Problem problem(domain, *energy, {.beta = 0.3}, pins);
  const auto linear = make_linear_backend("eigen.ldlt");
  problem.solve(*linear);
  Matrix moved = domain.positions();
  moved.col(0) += 0.3 * moved.col(1).cwiseAbs2();
  domain.set_positions(moved);
  problem.refresh_operator();
  EXPECT_LT((problem.solve(*linear) - minimize(domain, *energy, {.beta = 0.3}, pins)).norm(), 1e-12);
}

// E_S = sum over facets of 4 b_f |M_l j_l - M_r j_r|^2, of the published explicit form of M.
double gradient_variation(const Domain& domain, FacetWeight weight, const Matrix& v,
                          const std::function<Eigen::MatrixXd(Index)>& M) {
  const Vector b = facet_weights(domain, weight);
  double sum = 0.0;
  for (Index f = 0; f < domain.facet_count(); ++f) {
    Eigen::VectorXd jump = Eigen::VectorXd::Zero(v.cols() * v.cols());
    for (const int side : {0, 1}) {
      const Index t = domain.facet_cells()(f, side);
      const Eigen::MatrixXd J = deformation(domain, t, v).transpose();
      jump += (side == 0 ? 1.0 : -1.0) * M(t) * Eigen::Map<const Eigen::VectorXd>(J.data(), J.size());
    }
    sum += 4.0 * b[f] * jump.squaredNorm();
  }
  return sum;
}

TEST(GradientSmoothness, IsTheVariationOfTheGradientOfTheDensity) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(p, p);
    const Matrix v = Matrix::Random(domain.vertex_count(), p);
    Vector phi(domain.cell_count());
    Matrix tensors(domain.cell_count(), p * p);
    for (Index t = 0; t < domain.cell_count(); ++t) {
      phi[t] = 0.5 + 1.2 * t / domain.cell_count();
      tensors.row(t) = row_of(random_tensor(p));
    }
    const auto tensor = [&](Index t) { return Eigen::Map<const Eigen::MatrixXd>(tensors.row(t).data(), p, p); };
    for (const FacetWeight weight : kWeights) {
      const auto check = [&](const Energy& energy, const std::function<Eigen::MatrixXd(Index)>& M) {
        const double expected = gradient_variation(domain, weight, v, M);
        for (const double beta : {0.4, 1.0}) {
          const EnergyValue value = evaluate(domain, energy, {beta, weight}, v).value;
          EXPECT_NEAR(value.variation, expected, 1e-11 * expected);
          EXPECT_NEAR(value.total, (1.0 - beta) * value.plain + beta * expected, 1e-11 * expected);
        }
      };
      const std::pair<std::string, ParameterValue> gradient = {"smoothness", "gradient"};
      check(*make("metr", {gradient}), [&](Index) { return vector_field_matrix({1.0, 2.0}, I); });
      check(*make("phi", {gradient, {"phi", 1.1}}), [&](Index) { return vector_field_matrix(phi_weights(1.1), I); });
      check(*make_vector_field_energy(phi, {}, Smoothness::gradient),
            [&](Index t) { return vector_field_matrix(phi_weights(phi[t]), I); });
      check(*make_vector_field_energy(phi, tensors, Smoothness::gradient),
            [&](Index t) { return vector_field_matrix(phi_weights(phi[t]), tensor(t)); });
    }
  }
}

TEST(GradientSmoothness, PassesTheSuite) {
  for (const Domain& domain : {square(), cube()}) {
    for (const std::string name : {"akvf", "metr", "conf"}) {
      testing::check_energy(name + ", gradient", *make(name, {{"smoothness", "gradient"}}), domain, false);
    }
    const int p = domain.ambient_dimension();
    testing::check_energy(
        "tensor, gradient",
        *make_vector_field_energy(Vector::Constant(1, 0.8), row_of(random_tensor(p)), Smoothness::gradient), domain,
        false);
  }
}

TEST(GradientSmoothness, DoesNotSeeAffineFields) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Matrix affine = (domain.positions() * Eigen::MatrixXd::Random(p, p)).rowwise() + Eigen::RowVectorXd::Ones(p);
    for (const std::string name : {"akvf", "metr", "conf", "auth", "phi"}) {
      const auto energy = make(name, {{"smoothness", "gradient"}});
      const Matrix other = Matrix::Random(domain.vertex_count(), p);
      const double scale = evaluate(domain, *energy, {.beta = 0.3}, other).value.variation;
      EXPECT_LT(std::abs(evaluate(domain, *energy, {.beta = 0.3}, affine).value.variation), 1e-12 * scale) << name;
      // At least d^2 + d motions.
      const Eigen::MatrixXd H = evaluate(domain, *energy, {.beta = 1.0}, affine).H;
      const Vector values = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues();
      EXPECT_GE((values.array() < 1e-11 * values.maxCoeff()).count(), p * p + p) << name;
    }
  }
}

TEST(GradientSmoothness, EqualsTheNormWhereTheMatrixActsAsOneFactor) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    Constraints constraints(domain.vertex_count(), p);
    for (Index v = 0; v < domain.vertex_count(); v += 5) constraints.fix(v, Eigen::RowVectorXd::Random(p));
    const double alpha = 0.1;
    const std::map<std::string, VectorFieldWeights> cases = {{"akvf", {1.0, 0.0}}, {"conf", {1.0, -4.0 / p}}};
    for (const auto& [name, weights] : cases) {
      const double m = only_stiffness(weights, p).value();
      EXPECT_DOUBLE_EQ(m, 4.0);
      EXPECT_NEAR(alpha_from_beta(residual_beta(alpha, m)), 16.0 * alpha, 1e-12);
      const Matrix v =
          minimize(domain, *make(name, {{"smoothness", "gradient"}}), {.beta = beta_from_alpha(alpha)}, constraints);
      const Matrix w = minimize(domain, *make(name), {.beta = residual_beta(alpha, m)}, constraints);
      EXPECT_LT((v - w).norm(), 1e-10 * w.norm()) << name;
      const Matrix other = minimize(domain, *make(name), {.beta = residual_beta(2.0 * alpha, m)}, constraints);
      EXPECT_GT((v - other).norm(), 1e-4 * w.norm()) << name;
    }
  }
  // The published values for alpha = 0.1.
  const auto of_phi = [](double phi, int p) { return residual_beta(0.1, only_stiffness(phi_weights(phi), p).value()); };
  EXPECT_NEAR(of_phi(0.5 * kPi, 2), 0.615, 5e-4);
  EXPECT_NEAR(of_phi(largest_phi(2), 2), 0.417, 5e-4);
  EXPECT_NEAR(of_phi(largest_phi(3), 3), 0.490, 5e-4);
  EXPECT_FALSE(only_stiffness({1.0, 2.0}, 2).has_value());
  EXPECT_EQ(only_stiffness({0.0, 1.0}, 3), 3.0);
  EXPECT_DOUBLE_EQ(alpha_from_beta(beta_from_alpha(0.7)), 0.7);
  EXPECT_THROW(beta_from_alpha(-0.1), UsageError);
  EXPECT_THROW(alpha_from_beta(1.0), UsageError);
}

// alpha is a length: a mesh twice as large has the same minimizer for 2 alpha.
TEST(GradientSmoothness, WeightIsALength) {
  const Domain domain = square();
  Domain twice = domain;
  twice.set_positions(2.0 * domain.positions());
  Constraints constraints(domain.vertex_count(), 2);
  for (Index v = 0; v < domain.vertex_count(); v += 5) constraints.fix(v, Eigen::RowVector2d::Random());
  const auto energy = make("metr", {{"smoothness", "gradient"}});
  const Matrix v = minimize(domain, *energy, {.beta = beta_from_alpha(0.1)}, constraints);
  EXPECT_LT((minimize(twice, *energy, {.beta = beta_from_alpha(0.2)}, constraints) - v).norm(), 1e-10);
}

TEST(GradientSmoothness, FollowsTheDomainThatMoves) {
  for (Domain domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    for (const FacetWeight weight : kWeights) {
      for (const auto& tensor : {Matrix(), row_of(random_tensor(p))}) {
        const auto energy = make_vector_field_energy(Vector::Constant(1, 0.8), tensor, Smoothness::gradient);
        Constraints pins(domain.vertex_count(), p);
        for (Index v = 0; v < domain.vertex_count(); v += 5) pins.fix(v, Eigen::RowVectorXd::Random(p));
        const NormOptions norm{.beta = 0.3, .facet_weight = weight};
        Problem problem(domain, *energy, norm, pins);
        problem.normal_matrix();
        Matrix moved = domain.positions();
        moved.col(0) += 0.3 * moved.col(1).cwiseAbs2();
        domain.set_positions(moved);
        problem.refresh_operator();
        Problem fresh(domain, *energy, norm, pins);
        EXPECT_EQ((problem.normal_matrix() - fresh.normal_matrix()).norm(), 0.0);
      }
    }
  }
}

// Boundary values of an affine field have that field inside, on any mesh, for any energy, with and without smoothing.
TEST(VectorFields, AffineBoundaryValuesGiveTheAffineField) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const Matrix affine = (domain.positions() * Eigen::MatrixXd::Random(p, p)).rowwise() + Eigen::RowVectorXd::Ones(p);
    Constraints constraints(domain.vertex_count(), p);
    for (Index v = 0; v < domain.vertex_count(); ++v) {
      if (domain.boundary_vertices()[v]) constraints.fix(v, affine.row(v));
    }
    ASSERT_LT(constraints.fixed().size(), static_cast<std::size_t>(domain.vertex_count()));
    for (const std::string name : {"akvf", "metr", "conf", "auth", "phi"}) {
      for (const std::string smoothness : {"residual", "gradient"}) {
        for (const double beta : {0.0, 0.3, 0.9}) {
          const Matrix v = minimize(domain, *make(name, {{"smoothness", smoothness}}), {.beta = beta}, constraints);
          EXPECT_LT((v - affine).cwiseAbs().maxCoeff(), 1e-11) << name << " " << smoothness << " " << beta;
        }
      }
    }
  }
}

// K = K_FEM / 2 for mu = 4 strain, lambda = 2 divergence, with the textbook element stiffness V B'DB in engineering
// strains.
TEST(VectorFields, MatrixIsHalfTheStiffnessOfLinearElasticity) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    const int strains = p * (p + 1) / 2;
    for (const double phi : {0.2, std::atan(0.5), 0.5 * kPi, 2.2}) {
      const VectorFieldWeights w = phi_weights(phi);
      const double mu = 4.0 * w.strain;
      const double lambda = 2.0 * w.divergence;
      Eigen::MatrixXd D = Eigen::MatrixXd::Zero(strains, strains);
      D.topLeftCorner(p, p).setConstant(lambda);
      for (int i = 0; i < strains; ++i) D(i, i) += i < p ? 2.0 * mu : mu;
      Eigen::MatrixXd K = Eigen::MatrixXd::Zero(p * domain.vertex_count(), p * domain.vertex_count());
      for (Index t = 0; t < domain.cell_count(); ++t) {
        const auto G = domain.gradient(t);
        Eigen::MatrixXd B = Eigen::MatrixXd::Zero(strains, p * (p + 1));
        for (int i = 0; i <= p; ++i) {
          for (int c = 0; c < p; ++c) B(c, i * p + c) = G(c, i);
          int row = p;
          for (int a = 0; a < p; ++a) {
            for (int b = a + 1; b < p; ++b, ++row) {
              B(row, i * p + a) = G(b, i);
              B(row, i * p + b) = G(a, i);
            }
          }
        }
        const Eigen::MatrixXd K_t = domain.cell_measures()[t] * B.transpose() * D * B;
        for (int i = 0; i <= p; ++i) {
          for (int j = 0; j <= p; ++j) {
            K.block(domain.cells()(t, i) * p, domain.cells()(t, j) * p, p, p) += K_t.block(i * p, j * p, p, p);
          }
        }
      }
      const auto energy = make("phi", {{"phi", phi}});
      EXPECT_LT((evaluate(domain, *energy, {}, domain.positions()).H - 0.5 * K).norm(), 1e-12 * K.norm()) << phi;
    }
  }
}

// The distance to the closest skew matrix is a quarter of the Killing energy.
TEST(VectorFieldMatrix, KillingIsFourTimesTheDistanceToSkewMatricesInThePlane) {
  const Eigen::Vector4d s(0.0, 1.0, -1.0, 0.0);  // vec of the quarter turn
  const Eigen::Matrix4d skew = Eigen::Matrix4d::Identity() - 0.5 * s * s.transpose();
  EXPECT_LT((vector_field_matrix({1.0, 0.0}, Eigen::Matrix2d::Identity()) - 4.0 * skew).norm(), 1e-15);
}

TEST(VectorFields, TensorsThatAreMultiplesOfTheIdentityChangeTheWeightsOnly) {
  for (const Domain& domain : {square(), cube()}) {
    const int p = domain.ambient_dimension();
    Constraints constraints(domain.vertex_count(), p);
    for (Index v = 0; v < domain.vertex_count(); v += 5) constraints.fix(v, Eigen::RowVectorXd::Random(p));
    const double s = 3.0;
    for (const double phi : {0.3, 0.5 * kPi, 2.0}) {
      const auto field = [&](double angle, const Matrix& tensor) {
        return minimize(domain, *make_vector_field_energy(Vector::Constant(1, angle), tensor), {.beta = 0.2},
                        constraints);
      };
      const Matrix isotropic = field(phi, {});
      EXPECT_LT((field(phi, row_of(Eigen::MatrixXd::Identity(p, p))) - isotropic).norm(), 1e-11 * isotropic.norm());
      // w_r -> w_r / s, which leaves akvf (w_r = 0) as it is.
      const double scaled = std::atan2(std::sin(phi), std::cos(phi) / s);
      EXPECT_LT((field(scaled, row_of(s * Eigen::MatrixXd::Identity(p, p))) - isotropic).norm(),
                1e-10 * isotropic.norm());
    }
  }
}

// x given on both ends, sides free, held against rigid motions by rollers: the field is homogeneous, and the sides give
// way by kappa = w_r / (4 w_q + (p - 1) w_r) of the strain along x.
TEST(VectorFields, UniaxialStrainBetweenRollersIsHomogeneous) {
  const Domain strip(rectangle_mesh({.width = 2.0, .h = 0.25, .jitter = 0.3}));
  const Domain bar(bar_tet_mesh(1.0, 0.5, 0.5, 0.25, 0.2));
  for (const Domain* domain : {&strip, &bar}) {
    const int p = domain->ambient_dimension();
    const Eigen::RowVectorXd low = domain->positions().colwise().minCoeff();
    const Eigen::RowVectorXd high = domain->positions().colwise().maxCoeff();
    const auto on = [](double a, double b) { return std::abs(a - b) < 1e-9; };
    const double rate = -0.3;
    Constraints rollers(domain->vertex_count(), p);
    for (Index v = 0; v < domain->vertex_count(); ++v) {
      const Eigen::RowVectorXd x = domain->positions().row(v);
      std::vector<bool> held(p, false);
      held[0] = on(x[0], low[0]) || on(x[0], high[0]);
      // One lateral component in the plane; in space those of one corner and one of another.
      const bool corner = held[0] && on(x[0], low[0]) && on(x[1], low[1]) && (p == 2 || on(x[2], low[2]));
      if (corner) held.assign(p, true);
      if (p == 3 && on(x[0], low[0]) && on(x[1], high[1]) && on(x[2], low[2])) held[2] = true;
      if (std::find(held.begin(), held.end(), true) == held.end()) continue;
      Eigen::RowVectorXd value = Eigen::RowVectorXd::Zero(p);
      value[0] = rate * (x[0] - low[0]);
      rollers.fix(v, value, held);
    }
    const std::map<std::string, double> kappas = {{"akvf", 0.0}, {"metr", p == 2 ? 1.0 / 3.0 : 0.25}, {"conf", -1.0}};
    for (const auto& [name, kappa] : kappas) {
      Matrix expected = domain->positions().rowwise() - low;
      expected.col(0) *= rate;
      expected.rightCols(p - 1) *= -kappa * rate;
      for (const std::string smoothness : {"residual", "gradient"}) {
        for (const double beta : {0.0, 0.4}) {
          const auto energy = make(name, {{"smoothness", smoothness}});
          const Matrix v = minimize(*domain, *energy, {.beta = beta}, rollers);
          EXPECT_LT((v - expected).cwiseAbs().maxCoeff(), 1e-10) << name << " " << smoothness << " " << beta;
        }
      }
    }
  }
}

TEST(VectorFields, RefuseWhatTheyCannotDo) {
  const Domain flat = square();
  const Domain solid = cube();
  EXPECT_THROW(make("akvf")->traits(Domain(bar_surface_mesh(1.0, 1.0, 1.0, 0.5))), UsageError);
  const auto message = [](const auto& call) {
    try {
      call();
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("nothing thrown");
  };
  // In range in the plane, out of it in space.
  const auto late = make("phi", {{"phi", 2.6}});
  EXPECT_NO_THROW(late->traits(flat));
  EXPECT_THAT(message([&] { late->traits(solid); }), HasSubstr("phi = 2.6: expected a value in (0, 2.498"));
  EXPECT_THROW(make("phi", {{"phi", 0.0}}), UsageError);
  Vector phi = Vector::Constant(flat.cell_count(), 1.0);
  phi[4] = 3.0;
  EXPECT_THAT(message([&] { make_vector_field_energy(phi)->traits(flat); }), HasSubstr("on cell 4"));
  EXPECT_THAT(message([&] { make_vector_field_energy(Vector::Ones(3))->traits(flat); }), HasSubstr("3 parameters for"));
  Matrix tensors = Matrix(flat.cell_count(), 4);
  tensors.rowwise() = Eigen::RowVector4d(1.0, 0.0, 0.0, 1.0);
  tensors.row(6) << 1.0, 2.0, 2.0, 1.0;
  EXPECT_THAT(message([&] { make_vector_field_energy(Vector::Ones(1), tensors); }),
              HasSubstr("the tensor of cell 6 is not symmetric positive definite: its smallest eigenvalue is -1"));
  tensors.row(6) << 1.0, 0.5, 0.0, 1.0;
  EXPECT_THAT(message([&] { make_vector_field_energy(Vector::Ones(1), tensors); }), HasSubstr("not symmetric, or"));
  EXPECT_THROW(make_vector_field_energy(Vector::Ones(1), Matrix::Ones(1, 6)), DataError);
  tensors.row(6) = tensors.row(0);
  EXPECT_THROW(make_vector_field_energy(Vector::Ones(1), tensors)->traits(solid), UsageError);
  EXPECT_THROW(make_vector_field_energy(Vector::Ones(1), tensors)->set_tensors(tensors.topRows(2)), UsageError);
  EXPECT_THROW(make_vector_field_energy(Vector::Ones(2), tensors), UsageError);
  EXPECT_THROW(make("akvf", {{"stiffness", std::vector<double>{2.0, 1.0}}}), UsageError);
  EXPECT_THROW(make("akvf", {{"axis", std::vector<double>{2.0, 1.0}}}), UsageError);
  EXPECT_THROW(make("akvf", {{"stiffness", std::vector<double>{2.0, 0.0}}, {"axis", std::vector<double>{1.0, 0.0}}}),
               UsageError);
  EXPECT_THROW(make("akvf", {{"stiffness", std::vector<double>{2.0, 1.0}}, {"axis", std::vector<double>{0.0, 0.0}}}),
               UsageError);
}

}  // namespace
}  // namespace variform
