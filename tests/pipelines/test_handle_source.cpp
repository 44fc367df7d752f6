// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "experiments/continuous_deformations/handle_source.h"
#include "framework/base/error.h"

namespace variform {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kSquare = "generator = \"square\"\nh = 0.5\n";                           // 3 x 3 vertices
const std::string kBar = "generator = \"bar_tet\"\nh = 0.5\nlength = 2.0\nscale = 2.0\n";  // [0, 4] x [0, 2]^2
const std::string kRight = "select = { box = [1.0, 0.0, 1.0, 1.0] }\n";
const std::string kEnd = "select = { box = [4.0, 0.0, 0.0, 4.0, 2.0, 2.0] }\n";

std::vector<Handle> load(const std::string& domain, const std::string& tables, const TimeInterval& time = {}) {
  const Config config = Config::parse("[domain]\n" + domain + tables, "t.toml", ".");
  const LoadedDomain loaded = load_domain(config.root().at("domain"), ".");
  return load_handles(config.root().at("handle").elements(), loaded, time);
}

Handle one(const std::string& domain, const std::string& keys, const TimeInterval& time = {}) {
  return load(domain, "[[handle]]\n" + keys, time).front();
}

SpacePoint point(std::initializer_list<double> x) {
  return Eigen::Map<const Vector>(x.begin(), static_cast<Eigen::Index>(x.size()));
}

std::string error_of(const std::string& keys, const std::string& domain = kSquare) {
  try {
    one(domain, keys);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

/// The errors that need no mesh.
std::string table_error_of(const std::string& keys) {
  const Config config = Config::parse("[[handle]]\n" + keys, "t.toml", ".");
  try {
    check_handle_tables(config.root().at("handle").elements());
  } catch (const UsageError& error) {
    return error.what();
  }
  return "no error";
}

TEST(HandleSource, FixedHandlesStay) {
  const Handle handle = one(kSquare, "name = \"rim\"\nvertices = [4, 2, 2]\nfixed = true\n");
  EXPECT_EQ(handle.name, "handle 0 (rim)");
  EXPECT_EQ(handle.motion, nullptr);
  EXPECT_THAT(handle.vertices, ElementsAre(2, 4));
  EXPECT_THAT(handle.held, ElementsAre(true, true, true));
}

TEST(HandleSource, TimeIsTheIntervalOrGiven) {
  const Handle all = one(kSquare, kRight + "velocity = [1.0, 2.0]\n", {0.0, 3.0});
  EXPECT_LT((all.motion->position(0.0, point({1.0, 0.0}), 9.0) - point({4.0, 6.0})).norm(), 1e-14);
  const Handle part = one(kSquare, kRight + "velocity = [1.0, 2.0]\ntime = [0.5, 1.0]\n", {0.0, 3.0});
  EXPECT_LT((part.motion->position(0.0, point({1.0, 0.0}), 9.0) - point({1.5, 1.0})).norm(), 1e-14);
}

TEST(HandleSource, PathsFollowTheirCurves) {
  const SpacePoint corner = point({1.0, 1.0});
  const auto end = [&](const std::string& path) {
    return SpacePoint(one(kSquare, kRight + "path = " + path + "\n").motion->position(0.0, corner, 1.0) - corner);
  };
  EXPECT_LT((end("{ line = [[5, 5], [6, 7]] }") - point({1.0, 2.0})).norm(), 1e-14);
  EXPECT_LT((end("{ spline = [[0, 0], [1, 0], [1, 1]] }") - point({1.0, 1.0})).norm(), 1e-14);
  EXPECT_LT((end("{ parabola = [[0, 0], [1, 1], [2, 0]] }") - point({2.0, 0.0})).norm(), 1e-14);
  EXPECT_LT((end("{ polynomial = [[7, 7], [1, 0], [0, 2]] }") - point({1.0, 2.0})).norm(), 1e-14);
  // A quarter about the origin from the mean of the region, (1, 1/2): it goes to (-1/2, 1), and is turned if oriented.
  EXPECT_LT((end("{ circle = { degrees = 90, centre = [0, 0] } }") - point({-1.5, 0.5})).norm(), 1e-14);
  EXPECT_LT((end("{ circle = { degrees = 90, centre = [0, 0], from = [2, 0] } }") - point({-2.0, 2.0})).norm(), 1e-14);
  EXPECT_LT((end("{ circle = { degrees = 90, centre = [0, 0] }, orient = true }") - point({-2.0, 0.0})).norm(), 1e-13);
}

TEST(HandleSource, RotationsBendsAndLinearFields) {
  const Handle twist = one(kBar, kEnd + "rotate = { degrees = 90, axis = [2, 0, 0] }\n");
  // About the mean of the region, (4, 1, 1), which was scaled with the mesh.
  EXPECT_LT((twist.motion->position(0.0, point({4.0, 2.0, 1.0}), 1.0) - point({4.0, 1.0, 2.0})).norm(), 1e-14);
  const Handle about = one(kSquare, kRight + "rotate = { degrees = 180, about = [0, 0] }\ntime = [0.0, 2.0]\n");
  EXPECT_LT((about.motion->position(0.0, point({1.0, 0.0}), 1.0) - point({0.0, 1.0})).norm(), 1e-14);
  const Handle bend = one(kBar, kEnd + "bend = { degrees = 180, from = [0, 1, 1], axis = [0, -1, 0] }\n");
  EXPECT_LT((bend.motion->position(0.0, point({4.0, 1.0, 1.0}), 1.0) - point({0.0, 1.0, 1.0 + 8.0 / std::numbers::pi}))
                .norm(),
            1e-14);
  const Handle linear = one(kSquare, kRight + "linear = { A = [[1, 0], [0, 0]], b = [0, 2], about = [0.5, 0] }\n");
  EXPECT_LT((linear.motion->velocity(0.3, point({1.0, 0.0})) - point({0.5, 2.0})).norm(), 1e-15);
  EXPECT_TRUE(linear.closed_form(2));
  const Handle growing = one(kSquare, kRight +
                                          "linear = { A = [[[0, 0], [0, 0]], [[1, 0], [0, 0]]], b = [[0, 1], [0, 0], "
                                          "[0, 3]] }\ntime = [1.0, 2.0]\n");
  EXPECT_LT((growing.motion->velocity(1.5, point({1.0, 0.0})) - point({0.5, 1.75})).norm(), 1e-15);
  EXPECT_FALSE(growing.closed_form(2));
}

TEST(HandleSource, SegmentsWeightsAndRollers) {
  const Handle both =
      one(kSquare, kRight +
                       "segments = [{ time = [0.0, 0.25], velocity = [4, 0] }, { time = [0.5, 1.0], back = "
                       "true }]\nheld = [\"x\"]\n");
  EXPECT_LT((both.motion->position(0.0, point({1.0, 0.0}), 0.3) - point({2.0, 0.0})).norm(), 1e-14);
  EXPECT_LT((both.motion->position(0.0, point({1.0, 0.0}), 0.75) - point({1.5, 0.0})).norm(), 1e-14);
  EXPECT_LT((both.motion->position(0.0, point({1.0, 0.0}), 1.0) - point({1.0, 0.0})).norm(), 1e-14);
  EXPECT_THAT(both.held, ElementsAre(true, false, false));
  const Handle eased = one(kSquare, kRight + "velocity = [1, 0]\nweight = [[0, 0], [0.5, 2], [1, 0]]\n");
  EXPECT_LT((eased.motion->velocity(0.25, point({1.0, 0.0})) - point({1.0, 0.0})).norm(), 1e-15);
  EXPECT_LT((eased.motion->position(0.0, point({1.0, 0.0}), 0.25) - point({1.125, 0.0})).norm(), 1e-15);
}

TEST(HandleSource, RelativeCoordinatesAreThoseOfTheBoundingBox) {
  const Handle handle = one(kBar, "relative = true\nselect = { box = [1, 0, 0, 1, 1, 1] }\nvelocity = [0.5, 0, 0]\n");
  EXPECT_EQ(handle.vertices.size(), 9U);
  EXPECT_EQ(handle.motion->velocity(0.0, point({4.0, 0.0, 0.0})), point({2.0, 0.0, 0.0}));
  const Handle turned = one(kBar,
                            "relative = true\nselect = { box = [1, 0, 0, 1, 1, 1] }\n"
                            "rotate = { degrees = 90, axis = [0, 0, 1], about = [0.5, 0.5, 0.5] }\n");
  EXPECT_LT(turned.motion->velocity(0.0, point({2.0, 1.0, 7.0})).norm(), 1e-15);
}

TEST(HandleSource, BadTablesAreToldWithPlaceAndName) {
  const std::string kTip = "name = \"tip\"\nvertices = [1]\n";
  EXPECT_THAT(table_error_of(kTip), AllOf(HasSubstr("t.toml:1"), HasSubstr("exactly one of fixed, path"),
                                          HasSubstr("(in handle 0, \"tip\")")));
  EXPECT_THAT(table_error_of(kTip + "fixed = true\nvelocity = [1, 0]\n"), HasSubstr("got fixed, velocity"));
  EXPECT_THAT(table_error_of(kTip + "fixed = false\n"), AllOf(HasSubstr("t.toml:4"), HasSubstr("expected true")));
  EXPECT_THAT(table_error_of(kTip + "fixed = true\ntime = [0, 1]\n"), HasSubstr("a fixed handle has none"));
  EXPECT_THAT(table_error_of(kTip + "speed = 3\n"), AllOf(HasSubstr("speed"), HasSubstr("velocity")));
  EXPECT_THAT(table_error_of("fixed = true\n"), HasSubstr("either 'vertices' or 'select'"));
  EXPECT_THAT(table_error_of("vertices = []\nfixed = true\n"), HasSubstr("at least one vertex"));
  EXPECT_THAT(table_error_of("name = 3\nvertices = [1]\nfixed = true\n"), HasSubstr("name"));
  EXPECT_THAT(table_error_of(kTip + "velocity = [1]\n"), HasSubstr("2 or 3 coordinates"));
  EXPECT_THAT(table_error_of(kTip + "velocity = [nan, 0]\n"), HasSubstr("finite"));
  for (const std::string time : {"[1, 0]", "[0, 0]", "[0]", "[0, inf]"}) {
    EXPECT_THAT(table_error_of(kTip + "velocity = [1, 0]\ntime = " + time + "\n"),
                AllOf(HasSubstr("t.toml:5"), HasSubstr("time")));
  }
  EXPECT_THAT(table_error_of(kTip + "velocity = [1, 0]\nweight = [[0, 1], [1, -1]]\n"),
              AllOf(HasSubstr("weight knot 1"), HasSubstr("at least 0")));
  EXPECT_THAT(table_error_of(kTip + "velocity = [1, 0]\nweight = [0, 1]\n"), HasSubstr("weight"));
  EXPECT_THAT(table_error_of(kTip + "velocity = [1, 0]\nheld = [\"w\"]\n"), HasSubstr("\"x\", \"y\" or \"z\""));
  EXPECT_THAT(table_error_of(kTip + "velocity = [1, 0]\nheld = []\n"), HasSubstr("at least one component"));
  EXPECT_THAT(table_error_of(kTip + "velocity = [1, 0]\nheld = [\"x\", \"x\"]\n"), HasSubstr("already"));
}

TEST(HandleSource, BadMotionsAreToldWithPlaceAndName) {
  const std::string kTip = "vertices = [1]\n";
  EXPECT_THAT(table_error_of(kTip + "path = { spline = [[0, 0], [1, 1], [1, 1]] }\n"),
              AllOf(HasSubstr("t.toml:3"), HasSubstr("path.spline"), HasSubstr("point 2"), HasSubstr("coincides"),
                    HasSubstr("(in handle 0)")));
  EXPECT_THAT(table_error_of(kTip + "path = { spline = [[0, 0]] }\n"), HasSubstr("at least 2 points, got 1"));
  EXPECT_THAT(table_error_of(kTip + "path = { spline = [[0, 0], [1, 1, 1]] }\n"), HasSubstr("2 coordinates as before"));
  EXPECT_THAT(table_error_of(kTip + "path = { spline = [[0, 0], [1, inf]] }\n"), HasSubstr("finite"));
  EXPECT_THAT(table_error_of(kTip + "path = { orient = true }\n"), HasSubstr("exactly one of line, circle"));
  EXPECT_THAT(table_error_of(kTip + "path = { lines = [[0, 0], [1, 1]] }\n"), HasSubstr("lines"));
  EXPECT_THAT(table_error_of(kTip + "path = { circle = { centre = [0, 0] } }\n"), HasSubstr("degrees"));
  EXPECT_THAT(table_error_of(kTip + "path = { circle = { centre = [0, 0], degrees = 0 } }\n"), HasSubstr("an angle"));
  EXPECT_THAT(table_error_of(kTip + "rotate = { about = [0, 0] }\n"), HasSubstr("degrees"));
  EXPECT_THAT(table_error_of(kTip + "rotate = { degrees = inf }\n"), HasSubstr("finite"));
  EXPECT_THAT(table_error_of(kTip + "bend = { degrees = 90 }\n"), HasSubstr("from"));
  EXPECT_THAT(table_error_of(kTip + "linear = { about = [0, 0] }\n"), HasSubstr("'A', 'b' or both"));
  EXPECT_THAT(table_error_of(kTip + "linear = { A = [1, 0] }\n"), HasSubstr("list of rows"));
  EXPECT_THAT(table_error_of(kTip + "segments = []\n"), HasSubstr("at least one segment"));
  EXPECT_THAT(table_error_of(kTip + "segments = [{ velocity = [1, 0] }]\n"), HasSubstr("time"));
  EXPECT_THAT(table_error_of(kTip + "segments = [{ time = [0, 1], back = true }]\n"), HasSubstr("no segment before"));
  EXPECT_THAT(table_error_of(kTip + "segments = [{ time = [0, 1] }]\n"), HasSubstr("exactly one of path"));
  EXPECT_THAT(table_error_of(kTip + "time = [0, 1]\nsegments = [{ time = [0, 1], velocity = [1, 0] }]\n"),
              HasSubstr("its own"));
  EXPECT_THAT(table_error_of(kTip + "segments = [{ time = [0, 0.6], velocity = [1, 0] }, { time = [0.5, 1], back = "
                                    "true }]\n"),
              AllOf(HasSubstr("segments"), HasSubstr("segment 1 starts at t = 0.5")));
  // With a mesh.
  EXPECT_THAT(error_of(kTip + "velocity = [1, 0, 0]\n"), HasSubstr("expected 2 coordinates, got 3"));
  EXPECT_THAT(error_of(kTip + "rotate = { degrees = 3, axis = [0, 0, 1] }\n"), HasSubstr("in space"));
  EXPECT_THAT(error_of(kEnd + "rotate = { degrees = 3 }\n", kBar), HasSubstr("axis"));
  EXPECT_THAT(error_of(kTip + "linear = { A = [[1, 0, 0], [0, 1, 0]] }\n"), HasSubstr("a 2 x 2 matrix, got 2 x 3"));
  EXPECT_THAT(error_of(kTip + "path = { parabola = [[0, 0], [1, 1], [0, 0]], orient = true }\n"),
              AllOf(HasSubstr("key 'handle[0].path'"), HasSubstr("t = 0.5")));
  EXPECT_THAT(error_of(kEnd + "bend = { degrees = 3, from = [0, 1, 1], axis = [1, 0, 0] }\n", kBar),
              HasSubstr("right angle"));
  EXPECT_THAT(error_of(kTip + "velocity = [1, 0]\nheld = [\"z\"]\n"), HasSubstr("has no z"));
}

TEST(HandleSource, RegionsThatDoNotFitAreToldWithPlaceAndName) {
  EXPECT_THAT(error_of("name = \"far\"\nselect = { box = [5, 5, 6, 6] }\nfixed = true\n"),
              AllOf(HasSubstr("no vertex is selected"), HasSubstr("far")));
  EXPECT_THAT(error_of("vertices = [1000]\nfixed = true\n"), HasSubstr("vertex 1000 does not exist"));
  try {
    load(kSquare,
         "[[handle]]\nname = \"a\"\nvertices = [3, 4]\nfixed = true\n[[handle]]\nname = \"b\"\nvertices = [4]\n"
         "velocity = [1, 0]\n");
    ADD_FAILURE() << "no error";
  } catch (const DataError& error) {
    EXPECT_THAT(error.what(),
                AllOf(HasSubstr("t.toml:8"), HasSubstr("vertex 4 is in handle 0 (a) and in handle 1 (b)")));
  }
}

}  // namespace
}  // namespace variform
