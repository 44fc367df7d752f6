// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "framework/base/error.h"
#include "framework/experiment/known_keys.h"

namespace variform {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(EditDistance, CountsInsertionsDeletionsAndReplacements) {
  EXPECT_EQ(edit_distance("", ""), 0u);
  EXPECT_EQ(edit_distance("beta", "beta"), 0u);
  EXPECT_EQ(edit_distance("", "beta"), 4u);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
  EXPECT_EQ(edit_distance("fliped", "flipped"), 1u);
  EXPECT_EQ(edit_distance("energy", "enegry"), 2u);
}

TEST(KnownKeys, AnUnknownKeyIsRefusedWithTheNearestAndAllAcceptedOnes) {
  const Config config = Config::parse("a = 1\nmetric = \"fliped\"\n", "study.toml", ".");
  const ConfigNode node = config.root().at("metric");
  KnownKeys known;
  known.add("swept keys", {"norm.beta"});
  known.add("nothing", {});
  known.add("metrics", {"energy", "flipped"});
  known.require(node, std::string("flipped"));
  known.require(node, Condition("flipped == 0 and norm.beta > 0"));
  const auto message = [&](const std::string& key) -> std::string {
    try {
      known.require(node, key);
    } catch (const UsageError& error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(message("fliped"),
            "study.toml:2: key 'metric': no row will have 'fliped' (did you mean 'flipped'?); accepted: swept keys: "
            "norm.beta; metrics: energy, flipped");
  EXPECT_THAT(message("xyz"), Not(HasSubstr("did you mean")));
  EXPECT_THROW(known.require(node, Condition("flipped == 0 and energie > 1")), UsageError);
}

}  // namespace
}  // namespace variform
