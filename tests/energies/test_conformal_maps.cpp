// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <Eigen/SparseQR>
#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "energies/energies.h"
#include "energies/parametrization/parametrization.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/form/problem.h"
#include "framework/operators/distortion.h"
#include "framework/operators/operators.h"
#include "solvers/linear/linear_backends.h"
#include "tests/energies/curved_meshes.h"
#include "tests/energies/energy_suite.h"
#include "tests/support.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<Energy> make(const std::string& name, const std::string& variant = {}) {
  const EnergyEntry& entry = energies().find(name);
  Parameters parameters(entry.parameters);
  if (!variant.empty()) parameters.set("variant", variant);
  return entry.make(parameters);
}

Matrix minimize(const Domain& domain, const Energy& energy, const NormOptions& norm, const Constraints& constraints) {
  Problem problem(domain, energy, norm, constraints);
  const auto linear = make_linear_backend("eigen.ldlt");
  return problem.solve(*linear);
}

EnergyValue value_at(const Domain& domain, const Energy& energy, const NormOptions& norm, const Matrix& U) {
  Constraints pins(domain.vertex_count(), 2);
  for (const Index v : {0, 1}) pins.fix(v, U.row(v));
  return Problem(domain, energy, norm, pins).value(U);
}

// Two triangles on a tilted plane, whose normal is along no axis.
Domain tilted_plane() {
  const Eigen::Matrix3d Q = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1.0, 2.0, -0.5).normalized()).toRotationMatrix();
  return Domain(testing::lifted(rectangle_mesh({.h = 0.25, .jitter = 0.3}),
                                [&](double x, double y) {
                                  return Eigen::RowVector3d((Q * Eigen::Vector3d(x, y, 0.3)).transpose());
                                }),
                DomainKind::surface);
}

Matrix plane_coordinates() { return rectangle_mesh({.h = 0.25, .jitter = 0.3}).positions; }

// Least squares conformal maps as Levy, Petitjean, Ray and Maillot (2002) put them: local coordinates z_j of each
// triangle as complex numbers, weights W_1 = z_3 - z_2 and so on, the sum of |W_1 U_1 + W_2 U_2 + W_3 U_3|^2 / (2 A)
// minimal over complex U with two of them fixed. By QR of the real tall matrix.
Matrix levy_lscm(const Domain& domain, const Constraints& pins) {
  using Complex = std::complex<double>;
  const Index vertices = domain.vertex_count();
  std::vector<Index> column(vertices, -1);
  std::vector<Complex> fixed(vertices);
  std::vector<bool> is_fixed(vertices, false);
  for (const auto& pin : pins.fixed()) {
    is_fixed[pin.vertex] = true;
    fixed[pin.vertex] = {pin.value[0], pin.value[1]};
  }
  Index free = 0;
  for (Index v = 0; v < vertices; ++v) {
    if (!is_fixed[v]) column[v] = free++;
  }
  std::vector<Eigen::Triplet<double, Index>> triplets;
  Vector b = Vector::Zero(2 * domain.cell_count());
  for (Index t = 0; t < domain.cell_count(); ++t) {
    std::array<Eigen::Vector3d, 3> x;
    for (int i = 0; i < 3; ++i) x[i] = domain.positions().row(domain.cells()(t, i));
    const double base = (x[1] - x[0]).norm();
    const Eigen::Vector3d e = (x[1] - x[0]) / base;
    const double along = e.dot(x[2] - x[0]);
    const double height = (x[2] - x[0] - along * e).norm();
    const std::array<Complex, 3> z = {Complex(0.0, 0.0), Complex(base, 0.0), Complex(along, height)};
    const double scale = 1.0 / std::sqrt(base * height);
    for (int i = 0; i < 3; ++i) {
      const Complex w = scale * (z[(i + 2) % 3] - z[(i + 1) % 3]);
      const Index v = domain.cells()(t, i);
      if (is_fixed[v]) {
        b[2 * t] -= (w * fixed[v]).real();
        b[2 * t + 1] -= (w * fixed[v]).imag();
      } else {
        triplets.emplace_back(2 * t, 2 * column[v], w.real());
        triplets.emplace_back(2 * t, 2 * column[v] + 1, -w.imag());
        triplets.emplace_back(2 * t + 1, 2 * column[v], w.imag());
        triplets.emplace_back(2 * t + 1, 2 * column[v] + 1, w.real());
      }
    }
  }
  SparseMatrix A(2 * domain.cell_count(), 2 * free);
  A.setFromTriplets(triplets.begin(), triplets.end());
  const Eigen::SparseQR<SparseMatrix, Eigen::COLAMDOrdering<Index>> qr(A);
  const Vector solution = qr.solve(b);
  Matrix U(vertices, 2);
  for (Index v = 0; v < vertices; ++v) {
    if (is_fixed[v]) {
      U.row(v) << fixed[v].real(), fixed[v].imag();
    } else {
      U.row(v) << solution[2 * column[v]], solution[2 * column[v] + 1];
    }
  }
  return U;
}

TEST(Lscm, EqualsTheComplexFormOfLevyEtAl) {
  for (const double h : {0.2, 0.1, 0.05}) {
    const Domain bump(testing::bump_mesh(h));
    const Constraints pins = default_pins(bump);
    const Matrix U = minimize(bump, *make("lscm"), {}, pins);
    EXPECT_LT((U - levy_lscm(bump, pins)).cwiseAbs().maxCoeff(), 1e-8) << h;
    EXPECT_TRUE(cell_distortion(bump, U).flipped.empty()) << h;
  }
}

TEST(Lscm, UnrollsAHalfCylinderUpToSimilarity) {
  Matrix unrolled;
  const Domain cylinder(testing::half_cylinder_mesh(0.1, &unrolled));
  const Constraints pins = default_pins(cylinder);
  for (const std::string name : {"lscm", "asap"}) {
    // The unrolled shape costs nothing, hence is the minimizer also where jumps of the residual are weighed.
    for (const double beta : {0.0, 0.3, 0.9}) {
      const Matrix U = minimize(cylinder, *make(name), {.beta = beta}, pins);
      const CellDistortion cells = cell_distortion(cylinder, U);
      EXPECT_LT((cells.conformal_ratio.array() - 1.0).maxCoeff(), 1e-8) << name << beta;
      EXPECT_LT(cells.determinant.maxCoeff() / cells.determinant.minCoeff() - 1.0, 1e-8) << name << beta;
      EXPECT_GT(cells.determinant.minCoeff(), 0.0);
      // Scaled to equal area it is congruent with the unrolled mesh.
      const double scale = 1.0 / std::sqrt(cells.determinant.mean());
      const auto distance = [](const Matrix& X, Index a, Index b) { return (X.row(a) - X.row(b)).norm(); };
      for (Index v = 1; v < cylinder.vertex_count(); ++v) {
        EXPECT_NEAR(scale * distance(U, 0, v), distance(unrolled, 0, v), 1e-8);
      }
    }
  }
}

// Errata C7: with the printed sign mirrored maps cost nothing and the identity 4 times the area; corrected, the other
// way around.
TEST(Lscm, PrintedSignFavoursMirrors) {
  const Domain plane(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  const Domain tilted = tilted_plane();
  for (const Domain* domain : {&plane, &tilted}) {
    const Matrix identity = plane_coordinates();
    Matrix mirror = identity;
    mirror.col(0) *= -1.0;
    for (const double beta : {0.0, 0.4}) {
      const auto cost = [&](const std::string& variant, const Matrix& U) {
        return value_at(*domain, *make("lscm", variant), {.beta = beta}, U);
      };
      EXPECT_LT(cost("corrected", identity).total, 1e-26);
      EXPECT_LT(cost("as_printed", mirror).total, 1e-26);
      EXPECT_NEAR(cost("corrected", mirror).plain, 4.0, 1e-12);
      EXPECT_NEAR(cost("as_printed", identity).plain, 4.0, 1e-12);
    }
  }
  // What that does: the free-boundary map comes out mirrored, all triangles flipped.
  const Domain bump(testing::bump_mesh(0.1));
  const Matrix U = minimize(bump, *make("lscm", "as_printed"), {}, default_pins(bump));
  EXPECT_EQ(static_cast<Index>(cell_distortion(bump, U).flipped.size()), bump.cell_count());
}

TEST(Lscm, PassesTheSuiteWithThePrintedSign) {
  const Domain plane(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  testing::check_energy("lscm as printed, planar", *make("lscm", "as_printed"), plane, false);
  testing::check_energy("lscm as printed, bump", *make("lscm", "as_printed"), Domain(testing::bump_mesh(0.2)), false);
  // In the plane the kernel are the four mirrored similarities.
  Problem problem(plane, *make("lscm", "as_printed"), {}, default_pins(plane));
  const Eigen::MatrixXd H = testing::dense_symmetric(problem.normal_matrix());
  const Vector values = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues();
  EXPECT_EQ((values.array() < 1e-11 * values.maxCoeff()).count(), 4);
  EXPECT_EQ(problem.traits().kernel, Kernel::other);
}

TEST(ConformalMaps, CostWhatTheConformalErrorIs) {
  const Domain bump(testing::bump_mesh(0.1));
  const Matrix U = bump.positions().leftCols(2) + 0.05 * Matrix::Random(bump.vertex_count(), 2);
  const double expected = bump.total_measure() * distortion(bump, U).conformal;
  EXPECT_NEAR(value_at(bump, *make("asap"), {}, U).plain, expected, 1e-12 * expected);
  EXPECT_NEAR(value_at(bump, *make("lscm"), {}, U).plain, 2.0 * expected, 1e-12 * expected);
}

// ASAP on a surface is B'(F - S*(F)), F = B G U, with a tangent frame B of each triangle, whichever it is. Each lifted
// form is assembled here from its definition and has the residuals, hence all values and minimizers, of the energy.
TEST(Asap, OnSurfacesDoesNotDependOnTheFrame) {
  for (const Domain& domain : {Domain(testing::bump_mesh(0.2)), Domain(bar_surface_mesh(1.0, 0.5, 0.5, 0.25))}) {
    const Matrix U = Matrix::Random(domain.vertex_count(), 2);
    const Form form = make("asap")->declare(domain);
    const Matrix residual = form.residual(as_unknowns(U, form));
    const std::array<Matrix, 4> frames = {tangent_frames(domain), tangent_frames(domain, FrameChoice::edge_aligned),
                                          tangent_frames(domain, FrameChoice::random, 1),
                                          tangent_frames(domain, FrameChoice::random, 2)};
    for (const Matrix& choice : frames) {
      for (Index t = 0; t < domain.cell_count(); ++t) {
        const Eigen::Map<const Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> B(choice.row(t).data());
        const Eigen::Matrix2d F = B * deformation(domain, t, U);
        Eigen::Matrix2d similarity;
        const double p = F(0, 0) + F(1, 1);
        const double q = F(0, 1) - F(1, 0);
        similarity << p, q, -q, p;
        const Eigen::Matrix<double, 3, 2> lifted = B.transpose() * (F - 0.5 * similarity);
        EXPECT_LT((residual.row(t).transpose() - Eigen::Map<const Eigen::VectorXd>(lifted.data(), 6)).norm(),
                  1e-12 * residual.row(t).norm());
      }
    }
  }
}

TEST(Asap, OnATiltedPlaneIsAsapInThePlane) {
  const Domain flat(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  const Domain tilted = tilted_plane();
  const Matrix U = Matrix::Random(flat.vertex_count(), 2);
  for (const std::string name : {"asap", "lscm"}) {
    for (const double beta : {0.0, 0.5}) {
      const double here = value_at(flat, *make(name), {.beta = beta}, U).total;
      EXPECT_NEAR(value_at(tilted, *make(name), {.beta = beta}, U).total, here, 1e-12 * here) << name;
      Constraints pins(flat.vertex_count(), 2);
      for (Index v = 0; v < flat.vertex_count(); v += 4) pins.fix(v, U.row(v));
      EXPECT_LT(
          (minimize(flat, *make(name), {.beta = beta}, pins) - minimize(tilted, *make(name), {.beta = beta}, pins))
              .cwiseAbs()
              .maxCoeff(),
          1e-11)
          << name;
    }
  }
}

// At beta = 0 they are the same method; the jumps that beta > 0 weighs are of n = 3 and of 6 components and differ
// where the normals do.
TEST(ConformalMaps, AgreeWithoutRegularization) {
  const Domain bump(testing::bump_mesh(0.1));
  const Constraints pins = default_pins(bump);
  EXPECT_LT((minimize(bump, *make("asap"), {}, pins) - minimize(bump, *make("lscm"), {}, pins)).norm(), 1e-10);
  EXPECT_GT(
      (minimize(bump, *make("asap"), {.beta = 0.3}, pins) - minimize(bump, *make("lscm"), {.beta = 0.3}, pins)).norm(),
      1e-6);
}

// Interior pins: flips without regularization, none with it (benchmark L1 at its coarsest).
TEST(Lscm, InteriorPinsFlipTrianglesUnlessRegularized) {
  const Domain bump(testing::lifted(rectangle_mesh({.h = 1.0 / 16, .jitter = 0.2}), [](double x, double y) {
    const double r2 = (x - 0.5) * (x - 0.5) + (y - 0.5) * (y - 0.5);
    return Eigen::RowVector3d(x, y, 0.3 * std::exp(-20.0 * r2));
  }));
  const Matrix flat = bump.positions().leftCols(2);
  Constraints constraints(bump.vertex_count(), 2);
  for (Index v = 0; v < bump.vertex_count(); ++v) {
    if (bump.boundary_vertices()[v]) constraints.fix(v, flat.row(v));
  }
  const Eigen::Rotation2Dd turn(35.0 * std::numbers::pi / 180.0);
  const Eigen::Vector2d centre(0.5, 0.5);
  for (const Eigen::Vector2d& at :
       {Eigen::Vector2d(0.3, 0.3), Eigen::Vector2d(0.7, 0.3), Eigen::Vector2d(0.7, 0.7), Eigen::Vector2d(0.3, 0.7)}) {
    Index v = 0;
    (flat.rowwise() - at.transpose()).rowwise().squaredNorm().minCoeff(&v);
    const Eigen::Vector2d target = centre + turn * (flat.row(v).transpose() - centre);
    constraints.fix(v, target.transpose());
  }
  const auto flips = [&](double beta) {
    return cell_distortion(bump, minimize(bump, *make("lscm"), {.beta = beta}, constraints)).flipped.size();
  };
  EXPECT_GT(flips(0.0), 0u);
  EXPECT_EQ(flips(0.2), 0u);
  EXPECT_EQ(flips(0.4), 0u);
}

TEST(ConformalMaps, RefuseTetrahedraWithTheReason) {
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  const auto message = [&](const std::string& name) {
    try {
      make(name)->traits(solid);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(message("asap"), HasSubstr("the closest similarity is not linear in three dimensions"));
  EXPECT_THAT(message("asap"), HasSubstr("'conf'"));
  EXPECT_THAT(message("lscm"), HasSubstr("maps triangles to the plane"));
  const EnergyEntry& entry = energies().find("lscm");
  EXPECT_THROW(Parameters(entry.parameters).set("variant", std::string("printed")), UsageError);
}

}  // namespace
}  // namespace variform
