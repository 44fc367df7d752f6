// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "experiments/continuous_deformations/material.h"
#include "experiments/continuous_deformations/measurements.h"
#include "experiments/continuous_deformations/saved_integration.h"
#include "experiments/continuous_deformations/segmentation.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"

namespace variform {
namespace {

using std::numbers::pi;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

double number(const Row& row, const std::string& key) {
  const Value* const value = row.find(key);
  return value == nullptr ? std::nan("") : to_number(*value);
}

Row measured(const Domain& domain, const Matrix& X, const MeasureChoice& choice,
             const std::vector<Handle>& handles = {}) {
  Row row;
  measure(domain, handles, X, choice, row);
  return row;
}

// [0, 2] x [0, 1], mirror symmetric with its diagonals.
Domain strip() { return Domain(rectangle_mesh({.width = 2.0, .h = 0.25, .tessellation = Tessellation::alternating})); }

TEST(Measure, DistortionOfARegionIsThatOfItsCells) {
  const Domain domain = strip();
  Matrix X = domain.positions();
  for (Index v = 0; v < domain.vertex_count(); ++v) X(v, 0) += std::max(0.0, X(v, 0) - 1.0);  // twice as long
  const Row row = measured(domain, X, {.region = {1.0, 0.0, 2.0, 1.0}});
  EXPECT_NEAR(number(row, "region_area_ratio"), 2.0, 1e-12);
  EXPECT_NEAR(number(row, "region_E_isom"), 1.0, 1e-12);
  EXPECT_NEAR(number(row, "region_E_conf"), 0.5, 1e-12);
  EXPECT_NEAR(number(row, "region_E_auth"), 1.0, 1e-12);
  EXPECT_NEAR(number(row, "region_E_metr"), 0.75, 1e-12);
  EXPECT_NEAR(number(row, "region_E_metr_max"), 0.75, 1e-12);
  const Row half = measured(domain, X, {.region = {0.5, 0.0, 1.5, 1.0}});
  EXPECT_NEAR(number(half, "region_area_ratio"), 1.5, 1e-12);
  EXPECT_NEAR(number(half, "region_E_isom"), 0.5, 1e-12);
  EXPECT_NEAR(number(half, "region_E_metr_max"), 0.75, 1e-12);
}

TEST(Measure, DisplacementsAreByTheDiameter) {
  const Domain domain = strip();
  Matrix X = domain.positions();
  X.rowwise() += Eigen::RowVector2d(0.3, 0.4);
  X.row(7) = domain.positions().row(7);
  const std::vector<Handle> handles = {{.vertices = {7}}};
  const Row row = measured(domain, X, {.direction = {2.0, 0.0}}, handles);
  EXPECT_NEAR(number(row, "displacement"), 0.5 / std::sqrt(5.0), 1e-12);
  EXPECT_NEAR(number(row, "centroid_shift"), 0.5 / std::sqrt(5.0), 1e-12) << "of the free vertices";
  EXPECT_NEAR(number(row, "tangential"), 0.4, 1e-12);
  EXPECT_EQ(row.find("roughness"), nullptr);
  EXPECT_EQ(row.find("asymmetry"), nullptr);
}

TEST(Measure, DistortionNearHandlesIsThatWithinTwoRingsOfMovingOnes) {
  const Domain domain(rectangle_mesh({.width = 4.0, .h = 0.25, .tessellation = Tessellation::regular}));
  Matrix X = domain.positions();
  for (Index v = 0; v < domain.vertex_count(); ++v) X(v, 0) += std::max(0.0, X(v, 0) - 2.0);
  std::vector<Index> left, column;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (domain.positions()(v, 0) == 0.0) left.push_back(v);
    if (domain.positions()(v, 0) == 1.5) column.push_back(v);
  }
  const auto motion = translate(Eigen::Vector2d(1.0, 0.0), {});
  const auto near = [&](const std::vector<Index>& vertices, const MotionPointer& moves) {
    return number(measured(domain, X, {}, {{.vertices = vertices, .motion = moves}}), "near_handle_E_metr");
  };
  EXPECT_NEAR(near(left, motion), 0.0, 1e-12);
  EXPECT_NEAR(near(column, motion), 0.0, 1e-12) << "two rings of quads end where the stretch begins";
  for (Index& v : column) ++v;
  EXPECT_EQ(domain.positions()(column.front(), 0), 1.75);
  EXPECT_NEAR(near(column, motion), 0.75, 1e-12);
  EXPECT_EQ(near(column, nullptr), 0.0);
}

TEST(Measure, ThePercentileLeavesOneInAHundredOut) {
  // 10 x 10 quads; two corners have one triangle only.
  const Domain domain(rectangle_mesh({.h = 0.1, .tessellation = Tessellation::regular}));
  std::vector<int> triangles(static_cast<std::size_t>(domain.vertex_count()), 0);
  for (Index t = 0; t < domain.cell_count(); ++t) {
    for (int i = 0; i < 3; ++i) ++triangles[static_cast<std::size_t>(domain.cells()(t, i))];
  }
  Matrix X = domain.positions();
  int moved = 0;
  for (Index v = 0; v < domain.vertex_count(); ++v) {
    if (triangles[static_cast<std::size_t>(v)] != 1) continue;
    X.row(v) += 0.5 * (X.row(v) - Eigen::RowVector2d(0.5, 0.5));
    ++moved;
  }
  ASSERT_EQ(moved, 2);
  ASSERT_EQ(domain.cell_count(), 200);
  EXPECT_LT(number(measured(domain, X, {}), "E_isom_p99"), 1e-20) << "two of 200";
  X.row(domain.vertex_count() / 2) += Eigen::RowVector2d(0.01, 0.0);
  EXPECT_GT(number(measured(domain, X, {}), "E_isom_p99"), 1e-6) << "eight of 200";
}

TEST(Measure, AsymmetryIsTheDistanceFromTheMirrorImage) {
  const Domain domain = strip();
  EXPECT_NEAR(number(measured(domain, domain.positions(), {.mirror = "x"}), "asymmetry"), 0.0, 1e-12);
  Matrix X = domain.positions();
  X.col(1) += 0.3 * (X.col(0).array() - 1.0).square().matrix();
  EXPECT_NEAR(number(measured(domain, X, {.mirror = "x"}), "asymmetry"), 0.0, 1e-12);
  X.row(3) += Eigen::RowVector2d(0.03, 0.04);
  EXPECT_NEAR(number(measured(domain, X, {.mirror = "x"}), "asymmetry"), 0.05, 1e-12);
  const Domain irregular(rectangle_mesh({.h = 0.25, .jitter = 0.3}));
  EXPECT_TRUE(std::isnan(number(measured(irregular, irregular.positions(), {.mirror = "x"}), "asymmetry")));
}

TEST(Measure, ALineStretchesAndTurnsMoreThanOnce) {
  const double length = 4.0;
  const Domain tube(tube_mesh({.radius = 0.5, .length = length, .around = 12, .along = 16}));
  const MeasureChoice choice = {
      .line = {0.5, 0.0, 0.0, 0.5, 0.0, length}, .axis = {0.0, 0.0, 2.0}, .about = {0.0, 0.0, 1.0}};
  for (const double degrees : {135.0, -280.0, 700.0}) {
    Matrix X = tube.positions();
    for (Index v = 0; v < tube.vertex_count(); ++v) {
      const double angle = degrees / 180.0 * pi * X(v, 2) / length + 0.4;
      X.row(v).head(2) = (Eigen::Rotation2Dd(angle) * Eigen::Vector2d(tube.positions().row(v).head(2))).transpose();
    }
    const Row row = measured(tube, X, choice);
    EXPECT_NEAR(number(row, "line_turn"), degrees, 1e-9);
    const double chord = 2.0 * 0.5 * std::sin(std::abs(degrees) / 16.0 / 360.0 * pi);
    EXPECT_NEAR(number(row, "line_stretch"), std::hypot(chord, 0.25) / 0.25, 1e-12);
  }
}

TEST(Measure, RoughnessIsTheJumpOfNormals) {
  Mesh mesh{Matrix(4, 3), IndexMatrix(2, 3)};
  mesh.positions << 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0;
  mesh.cells << 0, 1, 2, 2, 1, 3;
  const Domain domain(mesh, DomainKind::surface);
  EXPECT_NEAR(number(measured(domain, domain.positions(), {}), "roughness"), 0.0, 1e-12);
  // Folded about the diagonal from 1 to 2 by an angle.
  const double angle = 0.7;
  Matrix X = domain.positions();
  const Eigen::Vector3d axis = Eigen::Vector3d(1.0, -1.0, 0.0).normalized();
  const Eigen::Vector3d hinge(1.0, 0.0, 0.0);
  X.row(3) = (hinge + Eigen::AngleAxisd(angle, axis) * (Eigen::Vector3d(1.0, 1.0, 0.0) - hinge)).transpose();
  EXPECT_NEAR(number(measured(domain, X, {}), "roughness"), 2.0 * std::sin(0.5 * angle), 1e-12);
}

TEST(Measure, TurnedAnglesHaveASignByTheAxisSoFar) {
  const Domain flat = strip();
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();
  const std::vector<Index> some = {0, 5, 11};
  for (const double degrees : {50.0, -120.0}) {
    const Eigen::Matrix2d R = Eigen::Rotation2Dd(degrees / 180.0 * pi).toRotationMatrix();
    const Matrix turned = (flat.positions() * R.transpose()).rowwise() + Eigen::RowVector2d(3.0, -1.0);
    EXPECT_NEAR(turned_angle(flat.positions(), turned, some, axis), degrees, 1e-10);
  }
  const Domain solid(bar_tet_mesh(1.0, 1.0, 1.0, 0.5));
  const Eigen::Vector3d about = Eigen::Vector3d(1.0, 2.0, -0.5).normalized();
  const auto turn = [&](double degrees) {
    const Eigen::Matrix3d R = Eigen::AngleAxisd(degrees / 180.0 * pi, about).toRotationMatrix();
    return turned_angle(solid.positions(), solid.positions() * R.transpose(), {0, 4, 9, 20}, axis);
  };
  EXPECT_NEAR(turn(120.0), 120.0, 1e-9);
  EXPECT_LT((axis - about).norm(), 1e-12);
  EXPECT_NEAR(turn(-30.0), -30.0, 1e-9);
  EXPECT_LT((axis - about).norm(), 1e-12);
  EXPECT_TRUE(std::isnan(turned_angle(solid.positions(), solid.positions(), {0, 1, 2}, axis))) << "on a line";
}

TEST(Measure, ProbesAreReflectedAboutTheMiddleOfTheRestShape) {
  const Domain domain = strip();
  const Matrix images = probe_images(domain, domain.positions(), {.reflect = "x"});
  EXPECT_LT((images.col(0) + domain.positions().col(0) - Vector::Constant(images.rows(), 2.0)).norm(), 1e-12);
  EXPECT_EQ(images.col(1), domain.positions().col(1));
}

std::vector<ConfigNode> tables(const Config& config) { return config.root().at("material").elements(); }

Material material(const std::string& text, const Domain& domain) {
  return load_material(tables(Config::parse(text, "t.toml", ".")), domain);
}

TEST(Materials, LaterTablesReplaceEarlierOnes) {
  const Domain domain = strip();
  const Material made = material(
      "[[material]]\nphi = [0.5, 2.5]\n[[material]]\nregion = [1.0, 0.0, 2.0, 1.0]\nphi = 1.0\n"
      "[[material]]\nregion = [0.0, 0.0, 0.5, 1.0]\ndirection = [3.0, 4.0]\nstiffness = 11.0\n",
      domain);
  Eigen::Matrix2d B;
  B << 1.0 + 3.6, 4.8, 4.8, 1.0 + 6.4;
  for (Index t = 0; t < domain.cell_count(); ++t) {
    double x = 0.0;
    for (int i = 0; i < 3; ++i) x += domain.positions()(domain.cells()(t, i), 0) / 3.0;
    EXPECT_NEAR(made.phi[t], x > 1.0 ? 1.0 : 0.5 + x, 1e-12);
    const Eigen::Map<const Eigen::Matrix2d> tensor(made.tensors.row(t).data());
    EXPECT_LT((tensor - (x < 0.5 ? B : Eigen::Matrix2d::Identity())).norm(), 1e-12);
  }
  const Material none = load_material({}, domain);
  EXPECT_EQ(none.phi.size(), 0);
  EXPECT_EQ(none.tensors.size(), 0);
  const Material along = material("[[material]]\nphi = [0.5, 2.5]\nalong = \"y\"\n", domain);
  EXPECT_NEAR(along.phi.maxCoeff(), 2.5 - 2.0 / 12.0, 1e-12);
}

TEST(Materials, WrongTablesAreToldWithTheirPlace) {
  const Domain domain = strip();
  const auto error = [&](const std::string& text) -> std::string {
    try {
      material("[[material]]\n" + text, domain);
    } catch (const UsageError& caught) {
      return caught.what();
    }
    return "no error";
  };
  EXPECT_THAT(error("region = [0.0, 0.0, 1.0, 1.0]\n"), AllOf(HasSubstr("t.toml:1"), HasSubstr("expected phi")));
  EXPECT_THAT(error("phi = [1.0, 2.0, 3.0]\n"), AllOf(HasSubstr("t.toml:2"), HasSubstr("[low, high]")));
  EXPECT_THAT(error("phi = 1.0\nalong = \"x\"\n"), AllOf(HasSubstr("t.toml:3"), HasSubstr("needs phi")));
  EXPECT_THAT(error("phi = [1.0, 2.0]\nalong = \"w\"\n"), AllOf(HasSubstr("t.toml:3"), HasSubstr("\"z\"")));
  EXPECT_THAT(error("phi = [1.0, 2.0]\nalong = \"z\"\n"), AllOf(HasSubstr("t.toml:3"), HasSubstr("planar")));
  EXPECT_THAT(error("direction = [1.0, 0.0]\n"), AllOf(HasSubstr("t.toml:1"), HasSubstr("together")));
  EXPECT_THAT(error("direction = [0.0, 0.0]\nstiffness = 2.0\n"), AllOf(HasSubstr("t.toml:2"), HasSubstr("than 0")));
  EXPECT_THAT(error("direction = [nan, 0.0]\nstiffness = 2.0\n"), AllOf(HasSubstr("t.toml:2"), HasSubstr("than 0")));
  EXPECT_THAT(error("direction = [1.0, 0.0, 0.0]\nstiffness = 2.0\n"), HasSubstr("expected 2 numbers"));
  EXPECT_THAT(error("direction = [1.0, 0.0]\nstiffness = 0.0\n"), AllOf(HasSubstr("t.toml:3"), HasSubstr("positive")));
  EXPECT_THAT(error("phi = 1.0\nregion = [5.0, 5.0, 6.0, 6.0]\n"), AllOf(HasSubstr("t.toml:1"), HasSubstr("no cell")));
  EXPECT_THAT(error("phi = 1.0\nregion = [5.0, 5.0]\n"), AllOf(HasSubstr("t.toml:3"), HasSubstr("4 numbers")));
  EXPECT_THAT(error("phi = 1.0\ncolour = 2\n"), HasSubstr("colour"));
}

TEST(Materials, FillTheEnergyWhereTablesSayNothingItKeepsItsOwn) {
  const Domain domain = strip();
  const Config config = Config::parse("[energy]\ntype = \"phi\"\n", "t.toml", ".");
  const ConfigNode node = config.root().at("energy");
  std::unique_ptr<Energy> energy = make_vector_field_energy(Vector::Constant(1, 0.7));
  const Material made = material("[[material]]\nregion = [1.0, 0.0, 2.0, 1.0]\nphi = 1.0\n", domain);
  EXPECT_FALSE(apply_material(node, made, domain, false, energy)) << "nothing to carry along";
  const auto& field = dynamic_cast<const VectorFieldEnergy&>(*energy);
  EXPECT_NEAR(field.parameter().minCoeff(), 0.7, 1e-15);
  EXPECT_NEAR(field.parameter().sum(), 0.5 * (0.7 + 1.0) * domain.cell_count(), 1e-10);
  EXPECT_EQ(field.smoothness(), Smoothness::residual);

  const Material stiff = material("[[material]]\ndirection = [1.0, 0.0]\nstiffness = 10.0\n", domain);
  const auto carry = apply_material(node, stiff, domain, true, energy);
  ASSERT_TRUE(carry);
  EXPECT_EQ(dynamic_cast<const VectorFieldEnergy&>(*energy).smoothness(), Smoothness::gradient);
  const Matrix turned = domain.positions() * Eigen::Rotation2Dd(0.5 * pi).toRotationMatrix().transpose();
  carry(turned);  // the stiff direction is y now
  const Matrix& tensors = dynamic_cast<const VectorFieldEnergy&>(*energy).tensors();
  for (Index t = 0; t < domain.cell_count(); ++t) {
    EXPECT_LT((tensors.row(t) - Eigen::RowVector4d(1.0, 0.0, 0.0, 10.0)).norm(), 1e-12);
  }
}

TEST(Materials, AlphaIsForWeightsOfLengthOne) {
  const Domain domain = strip();
  const VectorFieldEnergy killing(VectorFieldKind::killing, Vector::Zero(1), {}, Smoothness::gradient);
  const VectorFieldEnergy metric(VectorFieldKind::metric, Vector::Zero(1), {}, Smoothness::gradient);
  EXPECT_NEAR(smoothing_beta(killing, domain, 0.25), 0.2, 1e-15);
  EXPECT_NEAR(smoothing_beta(metric, domain, 0.25 * std::sqrt(5.0)), 0.2, 1e-15);
}

TEST(SavedIntegration, ComesBackToTheLastBit) {
  SavedIntegration saved;
  OdeCheckpoint& at = saved.checkpoint;
  at.time = 1.0 / 3.0;
  at.step = std::nextafter(0.1, 1.0);
  at.state = Vector::LinSpaced(7, 0.0, 1.0 / 7.0);
  at.memory = {Vector(), Vector::Constant(2, std::nan("")), Vector::Constant(1, -0.0)};
  at.outputs = 3;
  at.report = {.backend = "abm3",
               .reason = "",
               .time = 0.3,
               .event = "",
               .steps = 4,
               .rejected = 1,
               .refused = 2,
               .restarts = 3,
               .evaluations = std::int64_t{1} << 40,
               .drift = 1e-300,
               .seconds = 2.5,
               .history = {}};
  at.report.history.push_back({.number = 1, .time = 0.1, .size = 0.1, .drift = 0.5, .evaluations = 9});
  saved.times = {0.0, 0.1};
  saved.states = {at.state, at.state};
  saved.turned = 270.0;
  saved.axis = {0.0, 0.0, 1.0};
  saved.seconds = 7.0;
  const std::string bytes = to_bytes(saved);
  const std::optional<SavedIntegration> back = integration_from(bytes);
  ASSERT_TRUE(back.has_value());
  EXPECT_EQ(to_bytes(*back), bytes);
  EXPECT_EQ(back->checkpoint.time, at.time);
  EXPECT_EQ(back->checkpoint.step, at.step);
  EXPECT_EQ(back->checkpoint.state, at.state);
  ASSERT_EQ(back->checkpoint.memory.size(), 3U);
  EXPECT_TRUE(back->checkpoint.memory[1].array().isNaN().all());
  EXPECT_TRUE(std::signbit(back->checkpoint.memory[2][0]));
  EXPECT_EQ(back->checkpoint.report.evaluations, at.report.evaluations);
  EXPECT_EQ(back->checkpoint.report.drift, 1e-300);
  EXPECT_EQ(back->checkpoint.report.restarts, 3);
  ASSERT_EQ(back->checkpoint.report.history.size(), 1U);
  EXPECT_TRUE(std::isnan(back->checkpoint.report.history[0].error));
  EXPECT_THAT(back->times, ElementsAre(0.0, 0.1));
  EXPECT_EQ(back->turned, 270.0);
  for (std::size_t cut = 0; cut < bytes.size(); cut += 7) {
    EXPECT_FALSE(integration_from(bytes.substr(0, cut)).has_value()) << cut;
  }
}

TEST(Segmentation, FeaturesDoNotDependOnTheBasisOfEqualModes) {
  EigenPairs modes;
  modes.values = Eigen::Vector4d(0.0, 2.0, 2.0, 5.0);
  modes.vectors = Eigen::MatrixXd::Random(6, 4);
  const Matrix features = mode_features(modes, 1, 2);
  ASSERT_EQ(features.cols(), 2);
  ASSERT_EQ(features.rows(), 3);
  EigenPairs turned = modes;
  const Eigen::MatrixXd pair = modes.vectors.middleCols(1, 2);
  turned.vectors.middleCols(1, 2) = pair * Eigen::Rotation2Dd(0.8).toRotationMatrix();
  EXPECT_LT((mode_features(turned, 1, 2) - features).norm(), 1e-12);
  EXPECT_NEAR(features(1, 1), modes.vectors.col(3).segment(2, 2).norm(), 1e-15);
  EXPECT_LT((stiffness_descriptor(features) - features.col(0) - features.col(1)).norm(), 1e-15);
}

TEST(Segmentation, AgreementIsThatOfTheBestMatch) {
  EXPECT_EQ(agreement({0, 0, 1, 1}, {1, 1, 0, 0}), 1.0);
  EXPECT_EQ(agreement({0, 0, 1, 1}, {1, 1, 0, -1}), 1.0);
  EXPECT_EQ(agreement({0, 1, 2, 2}, {0, 0, 1, 1}), 0.75) << "a segment without a partner is wrong";
  EXPECT_EQ(agreement({0, 0, 0, 0}, {0, 0, 0, 1}), 0.75);
  EXPECT_TRUE(std::isnan(agreement({0, 1}, {-1, -1})));
}

}  // namespace
}  // namespace variform
