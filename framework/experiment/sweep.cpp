// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "framework/experiment/config_keys.h"

namespace variform {
namespace {

std::uint64_t mixed(std::uint64_t bits) {
  bits += 0x9e3779b97f4a7c15ULL;
  bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9ULL;
  bits = (bits ^ (bits >> 27)) * 0x94d049bb133111ebULL;
  return bits ^ (bits >> 31);
}

// Streams: the place of a key, and above all places
constexpr std::uint64_t kSeedStream = 1ULL << 32;
constexpr std::uint64_t kShuffleStream = 1ULL << 33;

// In [0, 1).
double unit(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

bool is_number(const ConfigNode& node) {
  return std::holds_alternative<std::int64_t>(node.value().data) || std::holds_alternative<double>(node.value().data);
}

// A table with two numbers min and max; in a table of keys they would be lists.
bool is_range(const ConfigNode& node) {
  return node.value().is_table() && node.has("min") && node.has("max") && is_number(node.at("min")) &&
         is_number(node.at("max"));
}

}  // namespace

std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t counter) {
  return mixed(mixed(mixed(seed) ^ stream) ^ counter);
}

Sweep::Sweep(const ConfigNode& node) {
  const std::string kind = node.string_or("kind", "grid");
  if (kind == "zip") {
    kind_ = Kind::zip;
  } else if (kind == "random") {
    kind_ = Kind::random;
  } else if (kind == "latin_hypercube") {
    kind_ = Kind::latin_hypercube;
  } else if (kind != "grid") {
    node.at("kind").fail("expected \"grid\", \"zip\", \"random\" or \"latin_hypercube\"");
  }
  if (node.has("seed")) {
    const std::int64_t seed = node.at("seed").integer();
    if (seed < 0) node.at("seed").fail("expected an integer of at least 0");
    seed_ = static_cast<std::uint64_t>(seed);
  }
  read_keys(node, "");
  if (node.has("seed_key")) {
    for (const ConfigNode& key : node.at("seed_key").elements(true)) {
      const std::string name = key.string();
      if (has(name)) key.fail(fmt::format("'{}' is swept already", name));
      seed_keys_.push_back(name);
    }
  }
  count_points(node);
  if (kind_ != Kind::latin_hypercube) return;
  for (std::size_t k = 0; k < keys_.size(); ++k) {
    std::vector<int>& strata = keys_[k].strata;
    strata.resize(static_cast<std::size_t>(point_count_));
    std::iota(strata.begin(), strata.end(), 0);
    for (std::size_t i = strata.size(); i > 1; --i) {  // Fisher and Yates
      const double u = unit(random_bits(seed_, kShuffleStream + k, i));
      std::swap(strata[i - 1], strata[static_cast<std::size_t>(u * static_cast<double>(i))]);
    }
  }
}

void Sweep::read_keys(const ConfigNode& node, const std::string& prefix) {
  const std::vector<std::string> reserved = config_section("[sweep]").names();
  for (const ConfigNode& child : node.children()) {
    // The last part of the path as it stands: keys such as "energy.type" may be quoted or nested tables.
    const std::string name = child.path().substr(node.path().size() + 1);
    if (prefix.empty() && std::find(reserved.begin(), reserved.end(), name) != reserved.end()) continue;
    const std::string key = prefix.empty() ? name : prefix + "." + name;
    if (child.value().is_table() && !is_range(child)) {
      read_keys(child, key);
    } else {
      if (has(key)) child.fail(fmt::format("'{}' is swept already", key));
      keys_.push_back(read_key(child, key));
    }
  }
}

Sweep::Key Sweep::read_key(const ConfigNode& node, const std::string& name) const {
  Key key{.name = name, .line = node.value().line};
  if (!is_range(node)) {
    for (const ConfigNode& element : node.elements()) key.choices.push_back(element.value());
    if (key.choices.empty()) node.fail("expected at least one value");
    return key;
  }
  if (!is_sampled()) node.fail("a range needs kind = \"random\" or \"latin_hypercube\"");
  node.accept_keys(config_section("[sweep] range").names());
  key.min = node.at("min").number();
  key.max = node.at("max").number();
  key.integer = node.boolean_or("integer", false);
  const std::string scale = node.string_or("scale", "linear");
  if (scale != "linear" && scale != "log") node.at("scale").fail("expected \"linear\" or \"log\"");
  key.logarithmic = scale == "log";
  if (!(key.min < key.max && std::isfinite(key.max - key.min))) node.fail("expected min < max");
  if (key.logarithmic && !(key.min > 0.0)) node.at("min").fail("expected a positive number on a logarithmic scale");
  if (key.integer) {
    for (const char* const end : {"min", "max"}) node.at(end).integer();
    if (std::max(std::abs(key.min), std::abs(key.max)) > 0x1p52) node.fail("integers of at most 2^52 can be sampled");
  }
  return key;
}

void Sweep::count_points(const ConfigNode& node) {
  if (is_sampled()) {
    const std::int64_t samples = node.at("samples").integer();
    if (samples < 1 || samples > kMaxPoints) {
      node.at("samples").fail(fmt::format("expected an integer from 1 to {}", kMaxPoints));
    }
    if (is_empty()) node.fail("expected a key to sample, or seed_key");
    point_count_ = static_cast<int>(samples);
    return;
  }
  if (node.has("samples")) node.at("samples").fail("only for kind = \"random\" and \"latin_hypercube\"");
  if (node.has("seed") && seed_keys_.empty()) node.at("seed").fail("without seed_key nothing of this kind is random");
  for (const Key& key : keys_) {
    const std::size_t count = key.choices.size();
    if (kind_ == Kind::zip) {
      if (&key != &keys_.front() && count != static_cast<std::size_t>(point_count_)) {
        node.fail(fmt::format("lists of a zip have equal length: '{}' has {} values, '{}' {}", keys_.front().name,
                              point_count_, key.name, count));
      }
      if (count > static_cast<std::size_t>(kMaxPoints)) {
        node.fail(fmt::format("the sweep has more than {} points", kMaxPoints));
      }
      point_count_ = static_cast<int>(count);
    } else {
      if (count > static_cast<std::size_t>(kMaxPoints / point_count_)) {
        node.fail(fmt::format("the sweep has more than {} points", kMaxPoints));
      }
      point_count_ *= static_cast<int>(count);
    }
  }
}

std::vector<std::string> Sweep::keys() const {
  std::vector<std::string> names;
  for (const Key& key : keys_) names.push_back(key.name);
  return names;
}

bool Sweep::has(const std::string& key) const {
  return std::any_of(keys_.begin(), keys_.end(), [&](const Key& known) { return known.name == key; });
}

ConfigValue Sweep::sample(std::size_t k, int point) const {
  const Key& key = keys_[k];
  double u = unit(random_bits(seed_, k, static_cast<std::uint64_t>(point)));
  if (kind_ == Kind::latin_hypercube) u = (key.strata[static_cast<std::size_t>(point)] + u) / point_count_;
  if (!key.choices.empty()) {
    const auto count = key.choices.size();
    return key.choices[std::min(count - 1, static_cast<std::size_t>(u * static_cast<double>(count)))];
  }
  // Integers have an interval of length 1 each, which begins with them.
  const double max = key.integer ? key.max + 1.0 : key.max;
  double value = key.logarithmic ? std::exp(std::log(key.min) + u * (std::log(max) - std::log(key.min)))
                                 : key.min + u * (max - key.min);
  if (key.integer) value = std::floor(value);
  value = std::clamp(value, key.min, key.max);  // against rounding
  if (key.integer) return {static_cast<std::int64_t>(value), key.line};
  return {value, key.line};
}

std::vector<std::pair<std::string, ConfigValue>> Sweep::values(int point) const {
  std::vector<std::pair<std::string, ConfigValue>> values;
  int rest = point;
  int block = point_count_;
  for (std::size_t k = 0; k < keys_.size(); ++k) {
    const Key& key = keys_[k];
    if (is_sampled()) {
      values.emplace_back(key.name, sample(k, point));
    } else if (kind_ == Kind::zip) {
      values.emplace_back(key.name, key.choices[static_cast<std::size_t>(point)]);
    } else {
      block /= static_cast<int>(key.choices.size());
      values.emplace_back(key.name, key.choices[static_cast<std::size_t>(rest / block)]);
      rest %= block;
    }
  }
  return values;
}

std::int64_t Sweep::seed(int point) const {
  return static_cast<std::int64_t>(random_bits(seed_, kSeedStream, static_cast<std::uint64_t>(point)) >> 33);
}

}  // namespace variform
