// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string>
#include <utility>
#include <vector>

#include "framework/base/error.h"

namespace variform {

/// Named things of one kind (energies, backends, generators, ...) in the order of registration.
/// Entry needs a member `std::string name`.
template <class Entry>
class Registry {
 public:
  /// kind is the word for messages, for example "energy".
  Registry(std::string kind, std::vector<Entry> entries) : kind_(std::move(kind)), entries_(std::move(entries)) {
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (entries_[i].name == entries_[j].name) {
          throw UsageError(fmt::format("{} '{}' is registered twice", kind_, entries_[i].name));
        }
      }
    }
  }

  const std::vector<Entry>& entries() const { return entries_; }
  const std::string& kind() const { return kind_; }

  /// Throws UsageError listing the valid names.
  const Entry& find(const std::string& name) const {
    for (const Entry& entry : entries_) {
      if (entry.name == name) return entry;
    }
    throw UsageError(fmt::format("unknown {} '{}'; known: {}", kind_, name, fmt::join(names(), ", ")));
  }

  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const Entry& entry : entries_) names.push_back(entry.name);
    return names;
  }

 private:
  std::string kind_;
  std::vector<Entry> entries_;
};

}  // namespace variform
