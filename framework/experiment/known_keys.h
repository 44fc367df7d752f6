// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "framework/experiment/claim.h"
#include "framework/experiment/config.h"

namespace variform {

/// The keys that the rows of a study will have, by where they come from: what claims, columns, rates and plots of its
/// config may name.
class KnownKeys {
 public:
  /// source: in words, for messages, for example "swept keys".
  void add(const std::string& source, const std::vector<std::string>& keys);

  bool has(const std::string& key) const;

  /// Throws UsageError at the node unless the key is known, naming the nearest known key and all accepted ones.
  void require(const ConfigNode& node, const std::string& key) const;
  /// The same without a place; what: how the message begins, for example "no row has".
  void require(const std::string& key, const std::string& what) const;
  /// The same for the keys of a condition.
  void require(const ConfigNode& node, const Condition& condition) const;

 private:
  std::string complaint(const std::string& key, const std::string& what) const;

  std::vector<std::pair<std::string, std::vector<std::string>>> groups_;
};

/// The fewest insertions, deletions and replacements of characters that turn one text into the other (Levenshtein).
std::size_t edit_distance(const std::string& a, const std::string& b);

}  // namespace variform
