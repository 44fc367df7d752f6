// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "framework/base/error.h"
#include "framework/base/parallel.h"
#include "framework/base/parameters.h"
#include "framework/base/registry.h"

namespace variform {
namespace {

using ::testing::HasSubstr;

std::vector<Parameter> declared() {
  return {{.name = "beta", .value = 0.25, .doc = "", .min = 0.0, .max = 1.0, .max_open = true},
          {.name = "count", .value = std::int64_t{3}, .doc = "", .min = 1.0},
          {.name = "mode", .value = std::string("a"), .doc = "", .choices = {"a", "b"}}};
}

template <class Action>
std::string message_of(const Action& action) {
  try {
    action();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "no error";
}

TEST(Parameters, DefaultsHoldUntilSet) {
  Parameters parameters(declared());
  EXPECT_EQ(parameters.number("beta"), 0.25);
  parameters.set("beta", std::int64_t{0});
  EXPECT_EQ(parameters.number("beta"), 0.0);
  EXPECT_EQ(parameters.integer("count"), 3);
}

TEST(Parameters, ErrorsNameKeyValueAndWhatIsAccepted) {
  Parameters parameters(declared());
  EXPECT_THAT(message_of([&] { parameters.set("beta", 1.0); }), HasSubstr("'beta' = 1: expected a value in [0, 1)"));
  EXPECT_THAT(message_of([&] { parameters.set("count", 1.5); }), HasSubstr("expected integer, got number"));
  EXPECT_THAT(message_of([&] { parameters.set("mode", std::string("c")); }), HasSubstr("expected one of a, b"));
  EXPECT_THAT(message_of([&] { parameters.set("bta", 0.5); }), HasSubstr("accepted: beta, count, mode"));
}

TEST(Registry, FindsByNameAndListsKnownNames) {
  struct Entry {
    std::string name;
  };
  const Registry<Entry> registry("energy", {{"asap"}, {"arap"}});
  EXPECT_EQ(registry.find("arap").name, "arap");
  EXPECT_THAT(message_of([&] { registry.find("ara"); }), HasSubstr("unknown energy 'ara'; known: asap, arap"));
  EXPECT_THROW(Registry<Entry>("energy", {{"asap"}, {"asap"}}), UsageError);
}

TEST(Parallel, SumHasTheSameBitsEveryTime) {
  const auto term = [](Index i) { return 1.0 / (1.0 + i); };
  const double first = parallel_sum(100000, term);
  for (int repeat = 0; repeat < 20; ++repeat) EXPECT_EQ(parallel_sum(100000, term), first);
  EXPECT_NEAR(first, 12.090146, 1e-6);
}

}  // namespace
}  // namespace variform
