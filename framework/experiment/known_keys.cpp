// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/known_keys.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>

#include "framework/base/error.h"

namespace variform {

void KnownKeys::add(const std::string& source, const std::vector<std::string>& keys) {
  if (!keys.empty()) groups_.emplace_back(source, keys);
}

bool KnownKeys::has(const std::string& key) const {
  return std::any_of(groups_.begin(), groups_.end(), [&key](const auto& group) {
    return std::find(group.second.begin(), group.second.end(), key) != group.second.end();
  });
}

void KnownKeys::require(const ConfigNode& node, const std::string& key) const {
  if (!has(key)) node.fail(complaint(key, "no row will have"));
}

void KnownKeys::require(const std::string& key, const std::string& what) const {
  if (!has(key)) throw UsageError(complaint(key, what));
}

std::string KnownKeys::complaint(const std::string& key, const std::string& what) const {
  std::string nearest;
  std::size_t least = std::numeric_limits<std::size_t>::max();
  std::vector<std::string> accepted;
  for (const auto& [source, keys] : groups_) {
    accepted.push_back(fmt::format("{}: {}", source, fmt::join(keys, ", ")));
    for (const std::string& known : keys) {
      const std::size_t distance = edit_distance(key, known);
      if (distance < least) {
        least = distance;
        nearest = known;
      }
    }
  }
  // A suggestion that shares less than half of its characters is none.
  const std::string suggestion =
      2 * least <= std::max(key.size(), nearest.size()) ? fmt::format(" (did you mean '{}'?)", nearest) : std::string();
  return fmt::format("{} '{}'{}; accepted: {}", what, key, suggestion, fmt::join(accepted, "; "));
}

void KnownKeys::require(const ConfigNode& node, const Condition& condition) const {
  for (const std::string& key : condition.keys()) require(node, key);
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

}  // namespace variform
