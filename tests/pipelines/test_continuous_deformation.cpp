// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>

#include "experiments/pipelines.h"
#include "framework/base/error.h"
#include "framework/domain/generators.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/config.h"
#include "integrators/ode/ode_backends.h"
#include "tests/experiment/temporary_folder.h"
#include "tests/support.h"

namespace variform {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;

Config config_of(const std::string& text) { return Config::parse(text, "study.toml", "."); }

PointResult run(const std::string& pipeline, const std::string& text, const Workspace& workspace = {}) {
  const Config config = config_of(text);
  const PipelineEntry& entry = pipelines().find(pipeline);
  entry.check(config);
  return entry.run(config, workspace);
}

PointResult deform(const std::string& text, const Workspace& workspace = {}) {
  return run("continuous_deformation", text, workspace);
}

double number(const PointResult& result, const std::string& key) {
  const Value* const value = result.metrics.find(key);
  return value == nullptr ? std::nan("") : to_number(*value);
}

std::string text_of(const PointResult& result, const std::string& key) { return to_text(*result.metrics.find(key)); }

std::string error_of(const std::string& pipeline, const std::string& text) {
  try {
    run(pipeline, text);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

// The strip of the specification with both ends held and its middle lifted (methods: continuous deformation, 9.1).
std::string lift(const std::string& energy, const std::string& norm, const std::string& more = "") {
  return "[domain]\ngenerator = \"strip\"\nwidth = 5.0\nheight = 1.0\nh = 0.125\ntessellation = \"alternating\"\n"
         "[energy]\n" +
         energy + "\n[norm]\n" + norm +
         "\n[[handle]]\nselect = { box = [-0.01, -0.01, 0.01, 1.01] }\nfixed = true\n"
         "[[handle]]\nselect = { box = [4.99, -0.01, 5.01, 1.01] }\nfixed = true\n"
         "[[handle]]\nselect = { box = [2.49, -0.01, 2.51, 1.01] }\nvelocity = [0.0, 1.5]\n"
         "[trajectory]\nframes = 0\n" +
         more;
}

// A coarse strip whose right end turns.
std::string turn(const std::string& integrator, const std::string& more = "") {
  return "[domain]\ngenerator = \"strip\"\nwidth = 2.0\nh = 0.25\njitter = 0.2\n[energy]\ntype = \"metr\"\n"
         "[[handle]]\nselect = { box = [-0.01, -0.01, 0.01, 1.01] }\nfixed = true\n"
         "[[handle]]\nname = \"end\"\nselect = { box = [1.99, -0.01, 2.01, 1.01] }\nrotate = { degrees = 100 }\n"
         "[integrator]\n" +
         integrator + "\n" + more;
}

// Reference values of an independent prototype; "expect agreement to 2-3 %" (methods: continuous deformation, 9.2).
TEST(ContinuousDeformation, TheLiftedStripHasTheReferenceErrors) {
  struct Reference {
    std::string energy, norm;
    double metr, conf, auth;
  };
  const std::string akvf = "type = \"akvf\"", metr = "type = \"metr\"", conf = "type = \"conf\"",
                    auth = "type = \"auth\"\nshear = 0.001953125";
  const std::vector<Reference> references = {
      {akvf, "alpha = 0.0", .0473, .0414, .0506},   {akvf, "alpha = 0.01", .0473, .0468, .0437},
      {akvf, "alpha = 0.1", .0590, .0891, .0183},   {metr, "alpha = 0.0", .0424, .0565, .0210},
      {metr, "alpha = 0.01", .0431, .0587, .0203},  {metr, "alpha = 0.1", .0522, .0820, .0133},
      {conf, "alpha = 0.01", .1457, .0106, .3862},  {conf, "alpha = 0.1", .0685, .0394, .1066},
      {auth, "alpha = 0.0", .0502, .0968, -1.0},    {auth, "alpha = 0.1", .0507, .0977, -1.0},
      {akvf, "alpha = 0.001", .0473, .0419, .0498}, {akvf, "beta = 0.05", .0473, .0432, .0482},
      {akvf, "beta = 0.3", .0485, .0558, .0352},    {metr, "beta = 0.05", .0429, .0575, .0211},
      {metr, "beta = 0.3", .0472, .0689, .0175},    {conf, "beta = 0.3", .0794, .0281, .1535}};
  for (const Reference& expected : references) {
    SCOPED_TRACE(expected.energy + " " + expected.norm);
    const PointResult result = deform(lift(expected.energy, expected.norm));
    EXPECT_NEAR(number(result, "E_metr"), expected.metr, 0.025 * expected.metr);
    EXPECT_NEAR(number(result, "E_conf"), expected.conf, 0.025 * expected.conf);
    if (expected.auth > 0.0) {
      EXPECT_NEAR(number(result, "E_auth"), expected.auth, 0.025 * expected.auth);
    } else {
      EXPECT_LT(number(result, "E_auth"), 1e-5);
    }
    EXPECT_EQ(number(result, "flipped"), 0.0);
    EXPECT_EQ(number(result, "completed"), 1.0);
    EXPECT_LE(number(result, "analyses"), 2.0) << "entries that cancel at rest come";
    EXPECT_LT(number(result, "evaluations_per_step"), 3.3);
  }
}

// alpha weighs squares of M, W_n those of its root: one factor between them where M has one eigenvalue.
TEST(ContinuousDeformation, AlphaIsBetaWhereTheEnergyHasOneStiffness) {
  struct Pair {
    std::string energy;
    double stiffness;  // 4 sin(phi)
  };
  for (const Pair& pair : {Pair{"akvf", 4.0}, Pair{"conf", 4.0 / std::sqrt(5.0)}}) {
    const double ratio = 4.0 * pair.stiffness * 0.1;
    const std::string type = "type = \"" + pair.energy + "\"";
    const PointResult by_alpha = deform(lift(type, "alpha = 0.1"));
    const PointResult by_beta = deform(lift(type, fmt::format("beta = {:.17g}", ratio / (1.0 + ratio))));
    EXPECT_LT((by_alpha.mesh.positions - by_beta.mesh.positions).cwiseAbs().maxCoeff(), 1e-8) << pair.energy;
    EXPECT_NEAR(number(by_alpha, "alpha"), 0.1, 1e-15);
    EXPECT_TRUE(std::isnan(number(by_beta, "alpha")));
    // The scaling of the weights does not matter: sin and cos, or 1 and those of the named energy.
    const double phi = pair.energy == "akvf" ? 0.5 * std::numbers::pi : std::numbers::pi - std::atan(0.5);
    const PointResult by_phi = deform(lift(fmt::format("type = \"phi\"\nphi = {:.17g}", phi), "alpha = 0.1"));
    EXPECT_LT((by_alpha.mesh.positions - by_phi.mesh.positions).cwiseAbs().maxCoeff(), 1e-8) << pair.energy;
  }
}

TEST(ContinuousDeformation, RelativeAlphaDoesNotDependOnUnits) {
  const auto study = [](double scale) {
    return fmt::format(
        "[domain]\ngenerator = \"strip\"\nwidth = 4.0\nh = 0.25\nscale = {0}\n[energy]\ntype = \"metr\"\n"
        "[norm]\nalpha_relative = 0.01\n[trajectory]\nframes = 0\n"
        "[[handle]]\nrelative = true\nselect = {{ box = [-0.01, -0.01, 0.01, 1.01] }}\nfixed = true\n"
        "[[handle]]\nrelative = true\nselect = {{ box = [0.99, -0.01, 1.01, 1.01] }}\nrotate = {{ degrees = 60 }}\n",
        scale);
  };
  const PointResult one = deform(study(1.0));
  const PointResult hundred = deform(study(100.0));
  EXPECT_LT((100.0 * one.mesh.positions - hundred.mesh.positions).cwiseAbs().maxCoeff(), 1e-7);
  EXPECT_NEAR(number(one, "alpha"), 0.01 * std::sqrt(17.0), 1e-12);
  EXPECT_NEAR(number(hundred, "alpha"), std::sqrt(17.0), 1e-10);
}

TEST(ContinuousDeformation, FramesAndCurvesAreThoseOfTheMotion) {
  const PointResult result = deform(turn("type = \"abm3\"", "[trajectory]\nframes = 4\n"));
  ASSERT_THAT(result.trajectory.frames, SizeIs(5));
  for (std::size_t k = 0; k < 5; ++k) EXPECT_DOUBLE_EQ(result.trajectory.frames[k].time, 0.25 * k);
  EXPECT_EQ(result.trajectory.frames.back().mesh.positions, result.mesh.positions);
  EXPECT_NEAR(number(result, "handle_turn"), 100.0, 1e-9);
  EXPECT_EQ(number(result, "handle_error"), 0.0);
  EXPECT_GT(number(result, "drift"), 0.0);
  std::map<std::string, Curve> curves;
  for (const Curve& curve : result.trajectory.curves) curves[curve.label] = curve;
  const Curve& isometric = curves.at("E_isom");
  ASSERT_THAT(isometric.y, SizeIs(5));
  EXPECT_NEAR(isometric.y.front(), 0.0, 1e-15);
  EXPECT_DOUBLE_EQ(isometric.y.back(), number(result, "E_isom"));
  const Curve& sizes = curves.at("step size");
  EXPECT_EQ(static_cast<double>(sizes.y.size()), number(result, "steps"));
  double sum = 0.0;
  for (const double size : sizes.y) sum += size;
  EXPECT_NEAR(sum, 1.0, 1e-12);
  // The handle in the frame in the middle: turned by 50 degrees about its own middle.
  const Matrix& middle = result.trajectory.frames[2].mesh.positions;
  const Matrix& start = result.trajectory.frames[0].mesh.positions;
  int found = 0;
  for (Index v = 0; v < static_cast<Index>(start.rows()); ++v) {
    if (start(v, 0) < 1.99) continue;
    const double angle = 50.0 / 180.0 * std::numbers::pi;
    EXPECT_NEAR(middle(v, 0), 2.0 - std::sin(angle) * (start(v, 1) - 0.5), 1e-12);
    EXPECT_NEAR(middle(v, 1), 0.5 + std::cos(angle) * (start(v, 1) - 0.5), 1e-12);
    ++found;
  }
  EXPECT_EQ(found, 5);
}

TEST(ContinuousDeformation, AnEventIsAWarningAndTheRunKeepsItsLastGoodShape) {
  // The handle goes through the end that is held.
  const PointResult result = deform(
      "[domain]\ngenerator = \"strip\"\nwidth = 2.0\nh = 0.25\n[energy]\ntype = \"metr\"\n"
      "[[handle]]\nselect = { box = [-0.01, -0.01, 0.01, 1.01] }\nfixed = true\n"
      "[[handle]]\nselect = { box = [1.99, -0.01, 2.01, 1.01] }\nvelocity = [-4.0, 0.0]\n"
      "[trajectory]\nframes = 4\n[integrator]\ntype = \"rk4\"\n");
  EXPECT_EQ(number(result, "completed"), 0.0);
  EXPECT_EQ(number(result, "flipped"), 0.0);
  EXPECT_THAT(text_of(result, "event"), HasSubstr("cell"));
  EXPECT_GT(number(result, "refused"), 0.0);
  EXPECT_NEAR(number(result, "time_reached"), 0.5, 0.01);
  ASSERT_THAT(result.warnings, SizeIs(1));
  EXPECT_THAT(result.warnings.front(), AllOf(HasSubstr("ended at t = 0."), HasSubstr("cell")));
  ASSERT_FALSE(result.trajectory.frames.empty());
  EXPECT_DOUBLE_EQ(result.trajectory.frames.back().time, number(result, "time_reached"));
}

TEST(ContinuousDeformation, ASoftHandleMissesItsPathByWhatIsMeasured) {
  const std::string strip =
      "[domain]\ngenerator = \"strip\"\nwidth = 2.0\nh = 0.25\n[energy]\ntype = \"akvf\"\n"
      "[[handle]]\nselect = { box = [-0.01, -0.01, 0.01, 1.01] }\nfixed = true\n"
      "[[handle]]\nselect = { box = [1.99, -0.01, 2.01, 1.01] }\nvelocity = [0.0, 0.5]\n[trajectory]\nframes = 0\n";
  const PointResult soft = deform(strip + "[baseline]\nsoft_weight = 0.1\n");
  double largest = 0.0;
  const PointResult hard = deform(strip);
  for (Index v = 0; v < static_cast<Index>(hard.mesh.positions.rows()); ++v) {
    const double x = hard.mesh.positions(v, 0);
    if (x > 0.001 && x < 1.999) continue;
    largest = std::max(largest, (soft.mesh.positions.row(v) - hard.mesh.positions.row(v)).norm());
  }
  EXPECT_EQ(number(hard, "handle_error"), 0.0);
  EXPECT_NEAR(number(soft, "handle_error"), largest, 1e-12);
  EXPECT_GT(largest, 0.01);
  EXPECT_EQ(number(soft, "drift"), 0.0);
}

TEST(ContinuousDeformation, EnergiesOfMapsGoThereInOneStep) {
  const std::string sheet =
      "[domain]\ngenerator = \"bump\"\nh = 0.125\n[trajectory]\nframes = 3\n"
      "[[handle]]\nselect = { box = [-0.01, -0.01, -1.0, 0.01, 1.01, 1.0] }\nfixed = true\n"
      "[[handle]]\nselect = { box = [0.99, -0.01, -1.0, 1.01, 1.01, 1.0] }\n"
      "rotate = { degrees = 45, axis = [0.0, 1.0, 0.0] }\n[energy]\n";
  const PointResult map = deform(sheet + "type = \"arap\"\n");
  EXPECT_EQ(text_of(map, "integrator"), "single_step");
  EXPECT_EQ(number(map, "completed"), 1.0);
  EXPECT_THAT(map.trajectory.frames, SizeIs(0));
  EXPECT_EQ(map.metrics.find("steps"), nullptr);
  const PointResult flow = deform(sheet + "type = \"near_isometric\"\n[norm]\nbeta = 0.3333\n");
  EXPECT_EQ(text_of(flow, "integrator"), "abm3");
  ASSERT_EQ(map.mesh.positions.rows(), flow.mesh.positions.rows());
  int held = 0;
  for (Index v = 0; v < static_cast<Index>(map.mesh.positions.rows()); ++v) {
    const double x = flow.trajectory.frames.front().mesh.positions(v, 0);
    if (x > 0.01 && x < 0.99) continue;
    EXPECT_LT((map.mesh.positions.row(v) - flow.mesh.positions.row(v)).norm(), 1e-12) << v;
    ++held;
  }
  EXPECT_EQ(held, 18);
}

TEST(ContinuousDeformation, WrongConfigsAreToldWithTheirPlace) {
  const std::string strip = "[domain]\ngenerator = \"strip\"\nh = 0.5\n";  // 4 x 1
  const std::string left = "[[handle]]\nname = \"left\"\nselect = { box = [-0.1, -0.1, 0.1, 1.1] }\nfixed = true\n";
  const std::string right = "[[handle]]\nselect = { box = [3.9, -0.1, 4.1, 1.1] }\nvelocity = [0.1, 0.0]\n";
  const std::string akvf = "[energy]\ntype = \"akvf\"\n";
  const std::string sheet = "[domain]\ngenerator = \"bump\"\nh = 0.25\n[energy]\ntype = \"near_isometric\"\n";
  const std::string rim = "[[handle]]\nselect = { boundary = true }\nfixed = true\n";
  const auto error = [](const std::string& text) { return error_of("continuous_deformation", text); };
  EXPECT_EQ(error(strip + akvf + left + right), "no error");
  struct Bad {
    std::string text, place, what;
  };
  const std::string good = strip + akvf;  // 5 lines
  for (const Bad& bad : {
           Bad{good + "[norm]\nalpha = 0.1\nbeta = 0.1\n" + left + right, "study.toml:6", "one of beta, alpha"},
           Bad{good + "[norm]\nalpha = 0.1\nalpha_relative = 0.1\n" + left + right, "study.toml:6", "one of beta"},
           Bad{good + "[norm]\nalpha = -0.1\n" + left + right, "study.toml:7", "alpha"},
           Bad{good + "[norm]\nbeta = 1.5\n" + left + right, "study.toml:7", "beta"},
           Bad{sheet + "[norm]\nalpha = 0.1\n" + rim, "study.toml:5", "alpha and [[material]] are for akvf"},
           Bad{sheet + "[[material]]\ndirection = [1.0, 0.0, 0.0]\nstiffness = 2.0\n" + rim, "study.toml:5",
               "alpha and [[material]] are for akvf"},
           Bad{strip + "[energy]\ntype = \"arap\"\n[norm]\nalpha = 0.1\n" + left + right, "study.toml:5",
               "alpha and [[material]] are for akvf"},
           Bad{strip + "[energy]\ntype = \"arap\"\n[baseline]\nsoft_weight = 1.0\n" + left + right, "study.toml:6",
               "energies of velocity fields"},
           Bad{good + left + right + "[[material]]\nphi = 1.0\n", "study.toml:5", "needs type = \"phi\""},
           Bad{strip + "[energy]\ntype = \"phi\"\n" + left + right + "[[material]]\nphi = 3.0\n", "study.toml:5",
               "cell"},
           Bad{strip + "[energy]\ntype = \"phi\"\n" + left + right + "[[material]]\nphi = nan\n", "study.toml:14",
               "finite"},
           Bad{good + left + right + "[integrator]\ntype = \"abm4\"\n", "study.toml:14", "abm4"},
           Bad{good + left + right + "[integrator]\ntolerance = 0.0\n", "study.toml:14", "tolerance"},
           Bad{good + left + right + "[integrator]\nend = nan\n", "study.toml:14", "end"},
           Bad{good + left + right + "[integrator]\nsmallest_step = 0.0\n", "study.toml:14", "smallest_step"},
           Bad{good + left + right + "[integrator]\nsmallest_step = 0.1\n", "study.toml:13", "longer than the first"},
           Bad{good + left + right + "[integrator.options]\nuncontrolled = true\n", "study.toml:14", "uncontrolled"},
           Bad{good + left + right + "[measure]\nregion = [0.0, 0.0, 1.0]\n", "study.toml:14", "expected 4 numbers"},
           Bad{good + left + right + "[measure]\nregion = [9.0, 0.0, 9.5, 1.0]\n", "study.toml:14", "no cell"},
           Bad{good + left + right + "[measure]\nline = [0.0, 0.0, 0.0, 0.0]\n", "study.toml:14", "two vertices"},
           Bad{good + left + right + "[measure]\nline = [0.1, 0.1, 0.1, 0.9]\n", "study.toml:14", "two vertices"},
           Bad{good + left + right + "[measure]\ndirection = [0.0, 0.0]\n", "study.toml:14", "other than 0"},
           Bad{good + left + right + "[measure]\naxis = [0.0, 0.0, 1.0]\n", "study.toml:14", "needs measure.line"},
           Bad{good + left + right + "[measure]\nmirror = \"z\"\n", "study.toml:14", "planar"},
           Bad{sheet + rim + "[measure]\nlattice = 9\n", "study.toml:10", "xy-plane"},
           Bad{good + left + left + right, "study.toml", "no error"},
           Bad{good + left + right + "[[handle]]\nselect = { near = [4.0, 0.5] }\nfixed = true\n", "study.toml:13",
               "move it differently"},
           Bad{good + left + "[[handle]]\nselect = { box = [8.0, 0.0, 9.0, 1.0] }\nfixed = true\n", "study.toml:11",
               "no vertex"},
           Bad{good + left + "held = [\"x\"]\n" + right + "[baseline]\nsoft_weight = 1.0\n", "study.toml:10",
               "hold all components"},
           Bad{strip + "[energy]\ntype = \"arap\"\n" + left + "held = [\"x\"]\n" + right, "study.toml:10",
               "each coordinate separately"},
           Bad{good, "continuous_deformation", "[[handle]]"},
           Bad{good + "[[handle]]\nselect = { near = [0.0, 0.0] }\nfixed = true\n", "", "constrained"},
           Bad{sheet + rim + "[norm]\nfacet_weight = \"big\"\n", "study.toml:10", "big"},
       }) {
    if (bad.what == "no error") {
      EXPECT_EQ(error(bad.text), bad.what);
    } else {
      EXPECT_THAT(error(bad.text), AllOf(HasSubstr(bad.place), HasSubstr(bad.what))) << bad.text;
    }
  }
  EXPECT_THAT(error("[domain]\ngenerator = \"strip\"\n[energy]\ntype = \"near_isometric\"\n" + left + right),
              HasSubstr("study.toml:4"));
}

// All metrics but times, to the last bit.
void expect_same(const PointResult& a, const PointResult& b) {
  std::map<std::string, std::string> texts[2];
  for (const auto& [result, of] : {std::pair(&a, 0), std::pair(&b, 1)}) {
    for (const auto& [key, value] : result->metrics.entries()) {
      if (key.find("seconds") == std::string::npos) texts[of][key] = to_text(value);
    }
  }
  EXPECT_EQ(texts[0], texts[1]);
  EXPECT_GT(texts[0].size(), 20U);
  EXPECT_EQ(a.mesh.positions, b.mesh.positions);
  ASSERT_EQ(a.trajectory.frames.size(), b.trajectory.frames.size());
  for (std::size_t k = 0; k < a.trajectory.frames.size(); ++k) {
    EXPECT_EQ(a.trajectory.frames[k].time, b.trajectory.frames[k].time);
    EXPECT_EQ(a.trajectory.frames[k].mesh.positions, b.trajectory.frames[k].mesh.positions) << k;
  }
  ASSERT_EQ(a.trajectory.curves.size(), b.trajectory.curves.size());
  for (std::size_t k = 0; k < a.trajectory.curves.size(); ++k) {
    EXPECT_EQ(a.trajectory.curves[k].x, b.trajectory.curves[k].x);
    EXPECT_EQ(a.trajectory.curves[k].y, b.trajectory.curves[k].y);
  }
}

class Resumed : public ::testing::TestWithParam<std::string> {};
// One of each kind, as far as they are compiled in.
std::vector<std::string> resumed_backends() {
  std::vector<std::string> names = {"abm3", "rk4", "odeint.dopri5", "cvode.adams", "arkode.erk"};
  std::erase_if(names, [](const std::string& name) { return !ode_backends().find(name).available; });
  return names;
}
INSTANTIATE_TEST_SUITE_P(ContinuousDeformation, Resumed, ::testing::ValuesIn(resumed_backends()), testing::test_name);

TEST_P(Resumed, GivesTheNumbersOfARunThatWasNotInterrupted) {
  const TemporaryFolder folder;
  // Few checkpoints for the method that loses its order at each.
  const std::string rest = GetParam() == "cvode.adams" ? "tolerance = 1e-5\ncheckpoint_steps = 15\n"
                                                       : "tolerance = 1e-7\ncheckpoint_steps = 3\n";
  const std::string type = "type = \"" + GetParam() + "\"\n" + rest;
  const std::string frames = "[trajectory]\nframes = 7\n";
  const PointResult whole = deform(turn(type, frames), Workspace(folder / "whole", "key", false));
  const double steps = number(whole, "steps");
  ASSERT_GT(steps, 9.0);
  for (const int at : {GetParam() == "cvode.adams" ? 20 : 4, static_cast<int>(steps) - 1}) {
    const std::filesystem::path file = folder / ("part" + std::to_string(at));
    // The first run ends after some steps; what it saved last is of a step before.
    const PointResult part =
        deform(turn(type + "max_steps = " + std::to_string(at) + "\n", frames), Workspace(file, "key", false));
    EXPECT_EQ(number(part, "completed"), 0.0);
    EXPECT_EQ(number(part, "steps"), at);
    EXPECT_GT(Workspace::progress_of(file), 0.0);
    EXPECT_LT(Workspace::progress_of(file), 1.0);
    ASSERT_TRUE(Workspace(file, "key", true).load().has_value());
    const PointResult resumed = deform(turn(type, frames), Workspace(file, "key", true));
    expect_same(resumed, whole);
    EXPECT_EQ(number(resumed, "completed"), 1.0);
  }
}

TEST(ContinuousDeformation, BytesOfOthersAreNotGoneOnWith) {
  const TemporaryFolder folder;
  const PointResult expected = deform(turn("type = \"abm3\""));
  for (const std::string bytes : {"", "nothing of the kind", "\xa1\x61\x61\x01"}) {
    const Workspace workspace(folder / "work", "key", true);
    workspace.save(bytes);
    expect_same(deform(turn("type = \"abm3\""), workspace), expected);
  }
}

TEST(Modes, AFreeSurfaceHasSixOfNoEnergyTheRigidMotions) {
  const PointResult result = run("modes",
                                 "[domain]\ngenerator = \"box_car\"\nh = 0.2\n[energy]\ntype = \"near_isometric\"\n"
                                 "[norm]\nbeta = 0.3333\n[modes]\ncount = 12\n");
  EXPECT_EQ(number(result, "zero_modes"), 6.0);
  EXPECT_LT(number(result, "rigid_residual"), 1e-8);
  EXPECT_GT(number(result, "gap"), 1e-8);
  EXPECT_LT(number(result, "eigen_residual"), 1e-6);
  for (int i = 2; i <= 12; ++i) {
    const double bound = 1e-10 * number(result, "lambda_max");
    EXPECT_GE(number(result, fmt::format("lambda_{}", i)), number(result, fmt::format("lambda_{}", i - 1)) - bound);
  }
  const PointResult solid = run("modes",
                                "[domain]\ngenerator = \"bar_tet\"\nlength = 1.0\nh = 0.5\n[energy]\ntype = \"metr\"\n"
                                "[modes]\ncount = 9\nmass = \"consistent\"\n");
  EXPECT_EQ(number(solid, "zero_modes"), 6.0);
  EXPECT_LT(number(solid, "rigid_residual"), 1e-8);
  const PointResult conformal = run("modes", "[domain]\ngenerator = \"square\"\nh = 0.25\n[energy]\ntype = \"conf\"\n");
  EXPECT_EQ(number(conformal, "zero_modes"), 4.0);
  EXPECT_LT(number(conformal, "rigid_residual"), 1e-8);
}

// Two squares joined by a narrow bridge.
Mesh dumbbell() {
  const Mesh grid = rectangle_mesh({.width = 3.0, .h = 0.1, .tessellation = Tessellation::alternating});
  std::vector<Index> kept;
  for (Index t = 0; t < static_cast<Index>(grid.cells.rows()); ++t) {
    Eigen::RowVector2d centre = Eigen::RowVector2d::Zero();
    for (int i = 0; i < 3; ++i) centre += grid.positions.row(grid.cells(t, i)) / 3.0;
    if (centre[0] < 1.0 || centre[0] > 2.0 || std::abs(centre[1] - 0.5) < 0.1) kept.push_back(t);
  }
  std::vector<Index> number(static_cast<std::size_t>(grid.positions.rows()), -1);
  Mesh mesh{Matrix(grid.positions.rows(), 2), IndexMatrix(static_cast<Index>(kept.size()), 3)};
  Index vertices = 0;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    for (int i = 0; i < 3; ++i) {
      const Index v = grid.cells(kept[k], i);
      Index& n = number[static_cast<std::size_t>(v)];
      if (n < 0) {
        n = vertices++;
        mesh.positions.row(n) = grid.positions.row(v);
      }
      mesh.cells(static_cast<Index>(k), i) = n;
    }
  }
  mesh.positions.conservativeResize(vertices, 2);
  return mesh;
}

TEST(Modes, SegmentsOfADumbbellAreItsParts) {
  const TemporaryFolder folder;
  write_mesh(folder / "dumbbell.obj", dumbbell());
  const std::string domain = "[domain]\nmesh = \"" + (folder / "dumbbell.obj").string() + "\"\n";
  const std::string rest = "[energy]\ntype = \"akvf\"\n[modes]\ncount = 7\nsegments = 4\ngraph = \"edges\"\n";
  const std::string lumps =
      "[[segment]]\nregion = [-0.01, -0.01, 0.99, 1.01]\n[[segment]]\nregion = [2.01, -0.01, 3.01, 1.01]\n";
  const PointResult result = run("modes", domain + rest + lumps);
  EXPECT_EQ(number(result, "zero_modes"), 3.0);
  EXPECT_GE(number(result, "segments"), 2.0);
  EXPECT_LE(number(result, "segments"), 3.0);
  EXPECT_GT(number(result, "agreement"), 0.9);
  EXPECT_NEAR(number(result, "descriptor_ratio"), 1.0, 0.05) << "mirror symmetric but for diagonals";
  ASSERT_THAT(result.history, SizeIs(1));
  EXPECT_THAT(result.history.front().x, ::testing::ElementsAre(2.0, 3.0, 4.0));
  const auto error = [&](const std::string& more) { return error_of("modes", domain + more); };
  EXPECT_THAT(error(rest + "[[segment]]\nregion = [8.0, 8.0, 9.0, 9.0]\n"), HasSubstr("no vertex"));
  EXPECT_THAT(error(rest + "[[segment]]\nregion = [8.0, 8.0, 9.0]\n"), HasSubstr("expected 4 numbers"));
  EXPECT_THAT(error("[energy]\ntype = \"akvf\"\n[modes]\nsegments = 1\n"), HasSubstr("2 and more"));
  EXPECT_THAT(error("[energy]\ntype = \"akvf\"\n[modes]\nbackend = \"x\"\n"), HasSubstr("modes.backend"));
  EXPECT_THAT(error("[energy]\ntype = \"arap\"\n"), HasSubstr("energy.type"));
  std::string many;
  for (int k = 0; k < 10; ++k) many += "[[segment]]\nregion = [0.0, 0.0, 3.0, 1.0]\n";
  EXPECT_THAT(error(rest + many), HasSubstr("at most 9"));
}

// Energy of the normal field times the number of triangles (methods: continuous deformation, 5.6 and 9).
TEST(FieldEnergy, OfTheNormalsOfGeodesicSpheresHasTheReferenceValues) {
  std::string text = "[energy]\ntype = \"near_isometric\"\n";
  for (const int n : {4, 8, 16}) {
    text += fmt::format("[[tessellation]]\ngenerator = \"sphere\"\nh = {:.12g}\n", 1.1071487 / n);
  }
  const PointResult result = run("field_energy", text);
  EXPECT_EQ(number(result, "tessellations"), 3.0);
  double values[3];
  const double expected[] = {29.8, 30.6, 30.9};
  for (int k = 0; k < 3; ++k) {
    values[k] = number(result, fmt::format("energy_{}", k + 1));
    EXPECT_NEAR(values[k], expected[k], 0.02 * expected[k]);
  }
  const double mean = (values[0] + values[1] + values[2]) / 3.0;
  double squares = 0.0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  EXPECT_NEAR(number(result, "variation"), std::sqrt(squares / 2.0) / mean, 1e-12);
  EXPECT_NEAR(number(result, "max_by_min"),
              *std::max_element(values, values + 3) / *std::min_element(values, values + 3), 1e-12);
  EXPECT_THAT(error_of("field_energy", "[energy]\ntype = \"near_isometric\"\n"), HasSubstr("two [[tessellation]]"));
  const std::string square = "[[tessellation]]\ngenerator = \"square\"\nh = 0.5\n";
  EXPECT_THAT(error_of("field_energy", "[energy]\ntype = \"near_isometric\"\n" + square + square),
              AllOf(HasSubstr("study.toml:"), HasSubstr("surface")));
}

}  // namespace
}  // namespace variform
