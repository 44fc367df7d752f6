// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "experiments/pipelines.h"
#include "framework/base/error.h"
#include "framework/experiment/config.h"

namespace variform {
namespace {

// A body or a sheet held at its boundary, with another vertex drawn out.
PointResult run(const std::string& generator, const std::string& start) {
  const std::string text =
      "[domain]\ngenerator = \"" + generator + "\"\nh = 0.25\n[energy]\ntype = \"arap\"\n[norm]\nbeta = 0.2\n" +
      "[solver]\nnonlinear = \"gauss_newton\"\nstart = \"" + start + "\"\n" +
      "[[constraint]]\nkind = \"hard\"\nselect = { boundary = true }\n" +
      "[[constraint]]\nkind = \"soft\"\nselect = { near = [0.5, 0.5, 0.5] }\nmove = [0.1, 0.05, 0.1]\n";
  return pipelines().find("deform").run(Config::parse(text, "deform.toml", "."));
}

double number(const PointResult& result, const std::string& key) { return to_number(*result.metrics.find(key)); }

TEST(Deform, FindsTheSameFromEveryStartOnSurfacesAndTetrahedra) {
  for (const std::string generator : {"bump", "cube_tet"}) {
    const PointResult rest = run(generator, "rest");
    EXPECT_EQ(number(rest, "converged"), 1.0);
    EXPECT_GT(number(rest, "energy"), 0.0);
    const PointResult poisson = run(generator, "poisson");
    EXPECT_NEAR(number(poisson, "energy_W"), number(rest, "energy_W"), 1e-6 * number(rest, "energy_W")) << generator;
  }
}

// The handle goes far enough that the rest pose with the constraints put in is inverted.
std::string bent_strip(const std::string& solver) {
  return "[domain]\ngenerator = \"strip\"\nh = 0.125\n[energy]\ntype = \"symmetric_dirichlet\"\n[solver]\n" + solver +
         "[[constraint]]\nkind = \"hard\"\nselect = { box = [0.0, 0.0, 0.0, 1.0] }\n" +
         "[[constraint]]\nkind = \"hard\"\nselect = { near = [3.5, 0.5] }\nmove = [-1.5, 1.8]\n";
}

PointResult deform(const std::string& text) {
  return pipelines().find("deform").run(Config::parse(text, "deform.toml", "."));
}

TEST(Deform, BarrierEnergiesStartFromARegularizedSolutionByNewton) {
  const PointResult result = deform(bent_strip(""));
  EXPECT_EQ(number(result, "converged"), 1.0);
  EXPECT_EQ(number(result, "flipped"), 0.0);
  EXPECT_EQ(number(result, "energy_rises"), 0.0);
  EXPECT_EQ(to_text(*result.metrics.find("nonlinear")), "newton");
  const PointResult other =
      deform(bent_strip("start_energy = \"larap\"\nstart_beta = 0.6\nnonlinear = \"gauss_newton\"\n"));
  EXPECT_EQ(to_text(*other.metrics.find("nonlinear")), "gauss_newton");
  EXPECT_NEAR(number(other, "energy"), number(result, "energy"), 1e-6 * number(result, "energy"));
}

TEST(Deform, BarrierEnergiesRefuseInvertedStartsAndUnfitStartEnergies) {
  EXPECT_THROW(deform(bent_strip("start = \"rest\"\n")), DataError);
  EXPECT_THROW(deform(bent_strip("nonlinear = \"local_global\"\n")), UsageError);
  EXPECT_THROW(deform(bent_strip("start_energy = \"symmetric_dirichlet\"\n")), UsageError);
  EXPECT_THROW(deform(bent_strip("start_energy = \"akvf\"\n")), UsageError);
  EXPECT_THROW(deform(bent_strip("start_energy = \"arapp\"\n")), UsageError);
}

// Without constraints one vertex is held where the free conformal map has it, and the Tutte map is moved there.
TEST(Parametrize, BarrierEnergiesReachOneMinimumFromEveryStartWithoutFlips) {
  const auto map = [](const std::string& solver) {
    return pipelines()
        .find("parametrize")
        .run(Config::parse("[domain]\ngenerator = \"bump\"\nh = 0.125\n[energy]\ntype = "
                           "\"symmetric_dirichlet_parametrization\"\n[solver]\n" +
                               solver,
                           "map.toml", "."));
  };
  const PointResult tutte = map("");
  EXPECT_EQ(to_text(*tutte.metrics.find("nonlinear")), "newton");
  for (const std::string start : {"tutte", "regularized", "lscm", "initial"}) {
    const PointResult result = map("start = \"" + start + "\"\n");
    EXPECT_EQ(number(result, "converged"), 1.0) << start;
    EXPECT_EQ(number(result, "start_flipped"), 0.0) << start;
    EXPECT_EQ(number(result, "flipped"), 0.0) << start;
    EXPECT_EQ(number(result, "energy_rises"), 0.0) << start;
    EXPECT_NEAR(number(result, "energy"), number(tutte, "energy"), 1e-8 * number(tutte, "energy")) << start;
  }
}

}  // namespace
}  // namespace variform
