// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "framework/base/error.h"
#include "framework/experiment/sweep.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Sweep sweep_of(const std::string& text) {
  const Config config = Config::parse("[sweep]\n" + text, "study.toml", ".");
  return Sweep(config.root().at("sweep"));
}

std::string error_of(const std::string& text) {
  try {
    sweep_of(text);
  } catch (const UsageError& error) {
    return error.what();
  }
  ADD_FAILURE() << "accepted: " << text;
  return {};
}

/// The numbers of a key at all points.
std::vector<double> numbers(const Sweep& sweep, std::size_t key) {
  std::vector<double> numbers;
  for (int point = 0; point < sweep.point_count(); ++point) {
    const ConfigValue value = sweep.values(point).at(key).second;
    if (const auto* integer = std::get_if<std::int64_t>(&value.data))
      numbers.push_back(static_cast<double>(*integer));
    else
      numbers.push_back(std::get<double>(value.data));
  }
  return numbers;
}

TEST(Sweep, WithoutAKindItIsAGrid) {
  const Sweep sweep = sweep_of("\"m.a\" = [1, 2]\n\"m.b\" = [3.0, 4.0, 5.0]\n");
  EXPECT_EQ(sweep.point_count(), 6);
  EXPECT_THAT(sweep.keys(), ElementsAre("m.a", "m.b"));
  EXPECT_THAT(numbers(sweep, 0), ElementsAre(1, 1, 1, 2, 2, 2));
  EXPECT_THAT(numbers(sweep, 1), ElementsAre(3, 4, 5, 3, 4, 5));
}

TEST(Sweep, ZipTakesListsSideBySide) {
  const Sweep sweep = sweep_of("kind = \"zip\"\n\"m.a\" = [1, 2, 7]\n\"m.b\" = [3.0, 4.0, 5.0]\n");
  EXPECT_EQ(sweep.point_count(), 3);
  EXPECT_THAT(numbers(sweep, 0), ElementsAre(1, 2, 7));
  EXPECT_THAT(numbers(sweep, 1), ElementsAre(3, 4, 5));
}

TEST(Sweep, RandomValuesAreTheSameOnEveryMachine) {
  // By an independent implementation; the numbers must never change, or records would not run to the same tables.
  const Sweep sweep = sweep_of("kind = \"random\"\nsamples = 3\nseed = 7\n\"m.a\" = { min = 0, max = 1 }\n");
  EXPECT_THAT(numbers(sweep, 0), ElementsAre(0.609394524568175, 0.9633517225922468, 0.2926433306793348));
  EXPECT_EQ(sweep.seed(0), 443491293);
}

TEST(Sweep, MoreRandomSamplesBeginWithTheSamePointsAndAnotherSeedGivesOthers) {
  const std::string range = "\"m.a\" = { min = 0, max = 1 }\n";
  const std::vector<double> few = numbers(sweep_of("kind = \"random\"\nsamples = 5\n" + range), 0);
  std::vector<double> many = numbers(sweep_of("kind = \"random\"\nsamples = 50\n" + range), 0);
  EXPECT_EQ(std::set<double>(many.begin(), many.end()).size(), 50u);
  many.resize(5);
  EXPECT_EQ(many, few);
  EXPECT_NE(numbers(sweep_of("kind = \"random\"\nsamples = 5\nseed = 1\n" + range), 0), few);
}

TEST(Sweep, RandomValuesFillTheirRangeEvenly) {
  const Sweep sweep = sweep_of(
      "kind = \"random\"\nsamples = 10000\n\"m.a\" = { min = -2, max = 6 }\n\"m.b\" = { min = 0.001, max = 10, scale = "
      "\"log\" }\n\"m.c\" = { min = 3, max = 5, integer = true }\n\"m.d\" = [10, 20]\n");
  const std::vector<double> a = numbers(sweep, 0);
  const std::vector<double> b = numbers(sweep, 1);
  const std::vector<double> c = numbers(sweep, 2);
  const std::vector<double> d = numbers(sweep, 3);
  std::map<int, int> quarters, decades, integers, choices;
  double correlation = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_TRUE(a[i] >= -2.0 && a[i] <= 6.0 && b[i] >= 0.001 && b[i] <= 10.0);
    ++quarters[static_cast<int>(std::floor((a[i] + 2.0) / 2.0))];
    ++decades[static_cast<int>(std::floor(std::log10(b[i])))];
    ++integers[static_cast<int>(c[i])];
    ++choices[static_cast<int>(d[i])];
    correlation += (a[i] - 2.0) * (d[i] - 15.0) / (2.31 * 5.0 * 10000.0);
  }
  // Five standard deviations of a binomial count.
  const auto near = [](int count, double p) {
    return std::abs(count - 1e4 * p) < 5.0 * std::sqrt(1e4 * p * (1.0 - p));
  };
  EXPECT_EQ(quarters.size(), 4u);
  EXPECT_EQ(decades.size(), 4u);
  EXPECT_EQ(integers.size(), 3u);
  EXPECT_EQ(choices.size(), 2u);
  for (const auto& [quarter, count] : quarters) EXPECT_TRUE(near(count, 0.25)) << quarter << ": " << count;
  for (const auto& [decade, count] : decades) EXPECT_TRUE(near(count, 0.25)) << decade << ": " << count;
  for (const auto& [integer, count] : integers) EXPECT_TRUE(near(count, 1.0 / 3.0)) << integer << ": " << count;
  for (const auto& [choice, count] : choices) EXPECT_TRUE(near(count, 0.5)) << choice << ": " << count;
  EXPECT_LT(std::abs(correlation), 0.05) << "keys are independent";
}

TEST(Sweep, ALatinHypercubeHasOnePointInEveryStratumOfEveryKey) {
  const int n = 40;
  const Sweep sweep = sweep_of(
      "kind = \"latin_hypercube\"\nsamples = 40\n\"m.a\" = { min = 0, max = 1 }\n\"m.b\" = { min = 1, max = 1e4, scale "
      "= "
      "\"log\" }\n\"m.c\" = [1, 2, 3, 4]\n\"m.d\" = { min = 1, max = 20, integer = true }\n");
  const std::vector<double> a = numbers(sweep, 0);
  const std::vector<double> b = numbers(sweep, 1);
  std::set<int> of_a, of_b, pairs;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const int first = static_cast<int>(a[i] * n);
    const int second = static_cast<int>(std::log10(b[i]) / 4.0 * n);
    of_a.insert(first);
    of_b.insert(second);
    pairs.insert(first - second);
  }
  EXPECT_EQ(of_a.size(), 40u);
  EXPECT_EQ(of_b.size(), 40u);
  EXPECT_GT(pairs.size(), 10u) << "strata of two keys are not paired in order";
  std::map<double, int> counts;
  for (const double c : numbers(sweep, 2)) ++counts[c];
  for (const auto& [choice, count] : counts) EXPECT_EQ(count, 10) << choice;
  counts.clear();
  for (const double d : numbers(sweep, 3)) ++counts[d];
  EXPECT_EQ(counts.size(), 20u);
  for (const auto& [integer, count] : counts) EXPECT_EQ(count, 2) << integer;
}

TEST(Sweep, EveryPointHasASeedOfItsOwn) {
  const Sweep sweep = sweep_of("kind = \"random\"\nsamples = 1000\nseed_key = [\"m.seed\", \"n.seed\"]\n");
  EXPECT_THAT(sweep.seed_keys(), ElementsAre("m.seed", "n.seed"));
  EXPECT_TRUE(sweep.keys().empty());
  EXPECT_FALSE(sweep.is_empty());
  std::set<std::int64_t> seeds;
  for (int point = 0; point < 1000; ++point) seeds.insert(sweep.seed(point));
  EXPECT_EQ(seeds.size(), 1000u);
  EXPECT_GE(*seeds.begin(), 0);
  EXPECT_LT(*seeds.rbegin(), std::int64_t{1} << 31);
  EXPECT_NE(sweep_of("seed = 1\nseed_key = \"m.seed\"\n\"m.a\" = [1]\n").seed(0), sweep.seed(0));
}

TEST(Sweep, WhatMakesNoSenseIsRefusedWithItsPlace) {
  EXPECT_THAT(error_of("kind = \"cube\"\n"), HasSubstr("study.toml:2: key 'sweep.kind': expected \"grid\", \"zip\""));
  EXPECT_THAT(error_of("kind = \"zip\"\n\"m.a\" = [1, 2]\n\"m.b\" = [1]\n"),
              HasSubstr("lists of a zip have equal length: 'm.a' has 2 values, 'm.b' 1"));
  EXPECT_THAT(error_of("\"m.a\" = { min = 0, max = 1 }\n"), HasSubstr("key 'sweep.m.a': a range needs kind"));
  EXPECT_THAT(error_of("\"m.a\" = []\n"), HasSubstr("expected at least one value"));
  EXPECT_THAT(error_of("\"m.a\" = 3\n"), HasSubstr("expected an array"));
  EXPECT_THAT(error_of("samples = 3\n\"m.a\" = [1]\n"), HasSubstr("key 'sweep.samples': only for"));
  EXPECT_THAT(error_of("seed = 3\n\"m.a\" = [1]\n"), HasSubstr("without seed_key nothing"));
  EXPECT_THAT(error_of("seed_key = \"m.a\"\n\"m.a\" = [1]\n"), HasSubstr("'m.a' is swept already"));
  EXPECT_THAT(error_of("\"m.a\" = [1]\n[sweep.m]\na = [2]\n"), HasSubstr("'m.a' is swept already"));
  const std::string random = "kind = \"random\"\n";
  EXPECT_THAT(error_of(random + "\"m.a\" = [1, 2]\n"), HasSubstr("'samples' is missing"));
  EXPECT_THAT(error_of(random + "samples = 0\n\"m.a\" = [1, 2]\n"), HasSubstr("expected an integer from 1 to 100000"));
  EXPECT_THAT(error_of(random + "samples = 4\n"), HasSubstr("expected a key to sample"));
  EXPECT_THAT(error_of(random + "seed = -1\nsamples = 4\n"), HasSubstr("at least 0"));
  const std::string samples = random + "samples = 4\n";
  EXPECT_THAT(error_of(samples + "\"m.a\" = { min = 1, max = 1 }\n"), HasSubstr("expected min < max"));
  EXPECT_THAT(error_of(samples + "\"m.a\" = { min = 0, max = 1, scale = \"log\" }\n"),
              HasSubstr("key 'sweep.m.a.min': expected a positive number"));
  EXPECT_THAT(error_of(samples + "\"m.a\" = { min = 0, max = 1, scale = \"square\" }\n"),
              HasSubstr("expected \"linear\" or \"log\""));
  EXPECT_THAT(error_of(samples + "\"m.a\" = { min = 0, max = 1, step = 2 }\n"), HasSubstr("unknown key"));
  EXPECT_THAT(error_of(samples + "\"m.a\" = { min = 0.5, max = 3, integer = true }\n"),
              HasSubstr("expected an integer"));
  std::string many = "1";
  for (int i = 2; i <= 1000; ++i) many += ", " + std::to_string(i);
  EXPECT_THAT(error_of("\"m.a\" = [" + many + "]\n\"m.b\" = [" + many + "]\n"), HasSubstr("more than 100000 points"));
}

}  // namespace
}  // namespace variform
