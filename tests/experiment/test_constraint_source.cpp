// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "framework/experiment/config.h"
#include "framework/experiment/constraint_source.h"

namespace variform {
namespace {

// A square of side 2 whose lower left corner is not the origin.
LoadedConstraints load(const std::string& table, const ConstraintSpace& space) {
  const Config config =
      Config::parse("[domain]\ngenerator = \"square\"\nh = 0.5\nscale = 2.0\n" + table, "t.toml", ".");
  LoadedDomain loaded = load_domain(config.root().at("domain"), ".");
  loaded.domain = Domain({loaded.domain.positions().rowwise() + Eigen::RowVector2d(5.0, 7.0), loaded.domain.cells()});
  return load_constraints(config.root().at("constraint").elements(), loaded, space);
}

TEST(ConstraintSource, ValuesOfLinearConstraintsArePointsOfMapsAndVelocitiesOfFields) {
  const std::string table =
      "[[constraint]]\nkind = \"linear\"\nvertices = [0, 1]\nweights = [0.5, 0.5]\nvalue = [0.25, 0.5]\n"
      "relative = true\n";
  EXPECT_EQ(load(table, {}).constraints.equalities().front().value, Eigen::RowVector2d(5.5, 8.0));
  EXPECT_EQ(load(table, {.velocities = true}).constraints.equalities().front().value, Eigen::RowVector2d(0.5, 1.0));
}

}  // namespace
}  // namespace variform
