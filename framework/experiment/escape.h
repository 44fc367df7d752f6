// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace variform {

/// The text with characters replaced, each by what the list says.
inline std::string escape(std::string_view text,
                          std::initializer_list<std::pair<char, std::string_view>> replacements) {
  std::string escaped;
  escaped.reserve(text.size());
  for (const char c : text) {
    std::string_view piece(&c, 1);
    for (const auto& [character, replacement] : replacements) {
      if (c == character) piece = replacement;
    }
    escaped += piece;
  }
  return escaped;
}

}  // namespace variform
