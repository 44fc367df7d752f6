// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>

#include "experiments/pipelines.h"
#include "framework/experiment/config.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

// A square whose centre is moved: triangles flip there without regularization.
const std::string kSquare = R"(
[domain]
generator = "square"
h = 0.0625
jitter = 0.2
[energy]
type = "larap"
[norm]
beta = "auto"
[solver]
linear = "eigen.ldlt"
max_iterations = 2000
[[constraint]]
kind = "hard"
select = { boundary = true }
[[constraint]]
kind = "hard"
select = { near = [0.5, 0.5] }
move = [0.25, 0.0]
)";

PointResult run(const std::vector<std::string>& assignments) {
  Config config = Config::parse(kSquare, "square.toml", ".");
  for (const std::string& assignment : assignments) config.set(assignment);
  return pipelines().find("deform").run(config);
}

double number(const PointResult& result, const std::string& key) {
  const Value* value = result.metrics.find(key);
  return value == nullptr ? std::nan("") : to_number(*value);
}

TEST(BetaSearch, EndsOfTheBracketAreWhatRunsOfTheirOwnFind) {
  for (const std::string energy : {"larap", "arap"}) {
    for (const std::string weight : {"facet_measure", "finite_volume"}) {
      SCOPED_TRACE(energy + " " + weight);
      const std::vector<std::string> base = {"energy.type=" + energy, "norm.facet_weight=" + weight};
      const PointResult found = run(base);
      ASSERT_EQ(number(found, "beta_found"), 1.0);
      const double low = number(found, "beta_low");
      const double high = number(found, "beta_high");
      EXPECT_EQ(number(found, "beta"), high);
      EXPECT_LT(low, high);
      EXPECT_LE(high - low, 0.05 * high * (1 + 1e-12));
      const auto fixed = [&](double beta) {
        std::vector<std::string> assignments = base;
        assignments.push_back("norm.beta=" + to_text(Value(beta)));
        return run(assignments);
      };
      EXPECT_GT(number(fixed(low), "flipped"), 0.0);
      const PointResult at_high = fixed(high);
      EXPECT_EQ(number(at_high, "flipped"), 0.0);
      for (const std::string metric : {"energy", "energy_R", "energy_W", "min_det", "E_isom", "iterations"}) {
        EXPECT_NEAR(number(found, metric), number(at_high, metric), 1e-9 * std::abs(number(at_high, metric))) << metric;
      }
      EXPECT_LT((found.mesh.positions - at_high.mesh.positions).cwiseAbs().maxCoeff(), 1e-10);
    }
  }
}

// One pattern without couplings across facets (beta = 0), one with, however many values are tried.
TEST(BetaSearch, AnalyzesOncePerPattern) {
  const PointResult found = run({"norm.auto.tolerance=0.001"});
  EXPECT_GE(number(found, "beta_trials"), 10.0);
  EXPECT_LE(number(found, "analyses"), 2.0);
  // The first trial is beta = 0; every trial is recorded with what the condition needs.
  ASSERT_EQ(found.trials.size(), 1U);
  const Trials& trials = found.trials.front();
  ASSERT_EQ(static_cast<double>(trials.rows.size()), number(found, "beta_trials"));
  EXPECT_EQ(trials.key, "norm.beta");
  EXPECT_EQ(to_number(*trials.rows.front().find("norm.beta")), 0.0);
  for (const Row& row : trials.rows) {
    ASSERT_NE(row.find("flipped"), nullptr);
    EXPECT_EQ(to_number(*row.find("held")), to_number(*row.find("flipped")) == 0.0 ? 1.0 : 0.0);
  }
}

TEST(BetaSearch, TakesAnyConditionOnMetrics) {
  const PointResult bounded = run({"norm.auto.until=\"max_conf_ratio < 3 and flipped == 0\""});
  ASSERT_EQ(number(bounded, "beta_found"), 1.0);
  EXPECT_LT(number(bounded, "max_conf_ratio"), 3.0);
  EXPECT_GT(number(bounded, "beta"), number(run({}), "beta"));
}

TEST(BetaSearch, ZeroIsTheAnswerWhereNothingFlips) {
  const PointResult still = run({"constraint[1].move=[0.01, 0.0]"});
  EXPECT_EQ(number(still, "beta_found"), 1.0);
  EXPECT_EQ(number(still, "beta"), 0.0);
  EXPECT_EQ(number(still, "beta_trials"), 1.0);
}

// Tikhonov regularization knows nothing of the residual: it removes none of these flips, at any weight.
TEST(BetaSearch, SaysWhenNoValueWillDo) {
  EXPECT_EQ(number(run({"norm.regularizer=tikhonov"}), "beta_found"), 0.0);
  const PointResult none = run({"norm.auto.until=\"E_isom < 0\""});
  EXPECT_EQ(number(none, "beta_found"), 0.0);
  ASSERT_FALSE(none.warnings.empty());
  EXPECT_THAT(none.warnings.front(), HasSubstr("fulfils 'E_isom < 0'"));
}

TEST(BetaSearch, WarmStartsEndInABracketOfTheSameWidth) {
  const PointResult warm = run({"energy.type=arap", "norm.auto.warm_start=true"});
  const PointResult cold = run({"energy.type=arap"});
  ASSERT_EQ(number(warm, "beta_found"), 1.0);
  EXPECT_EQ(number(warm, "flipped"), 0.0);
  // The path may lead elsewhere, but not far.
  EXPECT_NEAR(number(warm, "beta"), number(cold, "beta"), 0.5 * number(cold, "beta"));
}

// Along beta the plain energy of the minimizer rises and its variation falls, exactly for linear energies: no remarks,
// and the corner lies inside the grid.
TEST(BetaSearch, LCurveOfALinearEnergyIsMonotoneAndHasACorner) {
  const PointResult corner = run({"norm.auto.method=l_curve", "norm.auto.high=0.99"});
  ASSERT_EQ(number(corner, "beta_found"), 1.0);
  EXPECT_TRUE(corner.warnings.empty()) << corner.warnings.front();
  EXPECT_GT(number(corner, "beta"), 1e-3);
  EXPECT_LT(number(corner, "beta"), 0.99);
  EXPECT_EQ(number(corner, "beta_trials"), 13.0);
  EXPECT_EQ(number(corner, "analyses"), 1.0);
}

// At rest all energies are rounding: no corner may be read from that.
TEST(BetaSearch, LCurveOfRoundingHasNoCorner) {
  for (const std::string energy : {"larap", "arap"}) {
    const PointResult still =
        run({"energy.type=" + energy, "norm.auto.method=l_curve", "constraint[1].move=[0.0, 0.0]"});
    EXPECT_EQ(number(still, "beta_found"), 0.0) << energy;
    EXPECT_EQ(number(still, "beta"), 0.0) << energy;
    ASSERT_FALSE(still.warnings.empty());
    EXPECT_THAT(still.warnings.front(), HasSubstr("no corner"));
  }
}

TEST(BetaSearch, SaysWhichTrialsEndedAtTheIterationLimit) {
  const PointResult limited = run({"energy.type=arap", "solver.max_iterations=3"});
  EXPECT_THAT(limited.warnings, ::testing::Contains(HasSubstr("runs ended at the iteration limit")));
  EXPECT_THAT(limited.trials.front().metrics, ::testing::Contains("converged"));
}

// The alternation would turn the map about its only pin for ever.
TEST(Parametrize, ConvergesWithTheDefaultPinAndBackend) {
  const Config config = Config::parse(R"(
[domain]
generator = "sphere"
h = 0.3
[domain.cut]
to_disk = true
[parametrization]
initial = "tutte"
[energy]
type = "arap_parametrization"
[norm]
beta = 0.3
)",
                                      "sphere.toml", ".");
  const PointResult result = pipelines().find("parametrize").run(config);
  EXPECT_EQ(number(result, "converged"), 1.0);
  EXPECT_EQ(number(result, "flipped"), 0.0);
  EXPECT_EQ(to_text(*result.metrics.find("nonlinear")), "gauss_newton");
}

// Identified vertices and linear equalities hold from the start on, whatever the start.
TEST(Deform, GaussNewtonStartsFeasibleUnderEveryKindOfConstraint) {
  for (const std::string start : {"rest", "larap"}) {
    const PointResult result =
        run({"norm.beta=0.2", "energy.type=arap", "solver.nonlinear=gauss_newton", "solver.linear=eigen.lu",
             "solver.start=" + start, "constraint[1]={ kind = \"identify\", vertices = [40, 60] }",
             "constraint[0].select={ box = [0.0, 0.0, 0.0, 1.0] }"});
    EXPECT_EQ(number(result, "converged"), 1.0) << start;
    EXPECT_LT((result.mesh.positions.row(40) - result.mesh.positions.row(60)).norm(), 1e-10) << start;
  }
}

}  // namespace
}  // namespace variform
