// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "framework/experiment/config.h"

namespace variform {

/// Points of a study: the values that keys of its config take. As TOML:
///
///   [sweep]                                  # a grid: every combination, the last key fastest
///   "norm.beta" = [0.0, 0.2, 0.4]
///   "energy.type" = ["asap", "arap"]
///
///   [sweep]                                  # zip: first values, second values, ...; lists of equal length
///   kind = "zip"
///
///   [sweep]                                  # random, or latin_hypercube: stratified in every key
///   kind = "random"
///   samples = 50
///   seed = 7                                 # default 0
///   seed_key = "domain.degrade.seed"         # of any kind: a key, or a list, that gets a seed of the point
///   "norm.beta" = { min = 1e-3, max = 0.9, scale = "log" }
///   "domain.degrade.refinements" = { min = 0, max = 3, integer = true }    # both ends included
///   "energy.type" = ["asap", "arap"]         # one of the list
///
/// Random values depend on the seed, the place of the key and the number of the point alone, by a counter-based
/// generator of our own: the same on every machine, and a random sweep with more samples begins with the same points. A
/// Latin hypercube (McKay, Beckman, Conover 1979) has in each of `samples` equal strata of each key exactly one point.
class Sweep {
 public:
  /// One point, nothing swept.
  Sweep() = default;
  /// Reads [sweep]; throws UsageError with file, line and key when it makes no sense or has too many points.
  explicit Sweep(const ConfigNode& node);

  static constexpr int kMaxPoints = 100000;

  bool is_empty() const { return keys_.empty() && seed_keys_.empty(); }
  int point_count() const { return point_count_; }
  /// Swept keys in the order of the config; keys of seeds are not among them.
  std::vector<std::string> keys() const;
  bool has(const std::string& key) const;
  const std::vector<std::string>& seed_keys() const { return seed_keys_; }

  /// The values of the swept keys at a point.
  std::vector<std::pair<std::string, ConfigValue>> values(int point) const;
  /// The seed of a point, in [0, 2^31): made of the sweep's seed and the number of the point.
  std::int64_t seed(int point) const;

 private:
  enum class Kind { grid, zip, random, latin_hypercube };
  struct Key {
    std::string name;
    std::vector<ConfigValue> choices = {};  // empty: a range
    double min = 0.0;
    double max = 0.0;
    bool logarithmic = false;
    bool integer = false;
    std::vector<int> strata = {};  // Latin hypercube: that of each point
    int line = 0;
  };

  void read_keys(const ConfigNode& node, const std::string& prefix);
  Key read_key(const ConfigNode& node, const std::string& name) const;
  void count_points(const ConfigNode& node);
  bool is_sampled() const { return kind_ == Kind::random || kind_ == Kind::latin_hypercube; }
  ConfigValue sample(std::size_t key, int point) const;

  Kind kind_ = Kind::grid;
  std::vector<Key> keys_;
  std::vector<std::string> seed_keys_;
  std::uint64_t seed_ = 0;
  int point_count_ = 1;
};

/// 64 random bits for a counter in a stream of a seed: three rounds of the finalizer of SplitMix64 (Steele, Lea, Flood,
/// "Fast splittable pseudorandom number generators", 2014).
std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t counter);

}  // namespace variform
