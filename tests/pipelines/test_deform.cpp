// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "experiments/pipelines.h"
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

}  // namespace
}  // namespace variform
