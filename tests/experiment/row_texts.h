// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "framework/experiment/record.h"

namespace variform {

/// A metric of all rows; "-" where a row has none.
inline std::vector<std::string> texts(const Record& record, const std::string& key) {
  std::vector<std::string> texts;
  for (const Row& row : record.rows) {
    const Value* const value = row.find(key);
    texts.push_back(value == nullptr ? "-" : to_text(*value));
  }
  return texts;
}

}  // namespace variform
