// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace variform::io {

std::string base64_encode(std::string_view bytes);

/// Decodes base64 text piece by piece. White space is skipped; padding may end any group of four characters, so that
/// texts put one after the other read as one.
class Base64Decoder {
 public:
  explicit Base64Decoder(std::string_view text) : text_(text) {}

  /// The next n bytes; nothing when the text ends before or is no base64.
  std::optional<std::string> read(std::size_t n);
  /// True when only white space is left.
  bool at_end() const;

 private:
  bool decode_group();

  std::string_view text_;
  std::string decoded_;
};

}  // namespace variform::io
