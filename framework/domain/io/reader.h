// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>

#include "framework/base/types.h"

namespace variform::io {

/// What separates the tokens of a text format, besides white space.
struct Syntax {
  char comment = '\0';        ///< starts a comment that runs to the end of the line; '\0': there are none
  bool continuation = false;  ///< a backslash at the end of a line joins it with the next one
  bool free_form = false;     ///< a line end is white space like any other
};

/// True when all of the text is a number. T is double (out of range: 0 or infinity) or std::int64_t.
template <class T>
bool parse_number(std::string_view text, T& value);

/// All of a file, unpacked when its name ends in .gz. Throws DataError for missing, unreadable and empty files.
std::string load_file(const std::filesystem::path& path);

/// Cursor over the content of a file, text or binary. It knows where it is, so that every error reads
/// "FILE:LINE: found ..., expected ..." ("FILE:byte OFFSET" in binary parts).
class Reader {
 public:
  /// Refers to content, which must outlive the reader.
  Reader(std::string name, std::string_view content, Syntax syntax = {});

  /// A reader of the given part of the same file.
  Reader part(std::size_t offset, std::size_t size, Syntax syntax) const;

  const std::string& name() const { return name_; }
  std::string_view content() const { return content_; }
  void set_syntax(Syntax syntax) { syntax_ = syntax; }

  /// Bytes not yet read.
  std::size_t remaining() const { return end_ - position_; }
  /// Where the token or value read last starts: what fail() points at.
  std::size_t offset() const { return offset_; }

  /// Moves to the next token on whatever line. False when there is none.
  bool next_line();
  /// The same, fails naming what was expected when there is none.
  void require_line(std::string_view expected);
  /// Moves to the start of the next line. Returns what is skipped of this one.
  std::string_view skip_line();
  /// Fails when there are more tokens on this line.
  void end_line();
  /// Moves behind the next occurrence of text; false when there is none.
  bool skip_past(std::string_view text);

  /// The next token on this line (anywhere in free form); empty when there is none.
  std::string_view token();
  std::string_view peek();
  /// Reads a token that must be this word.
  void expect(std::string_view word);
  /// Reads a number, named by `what` in errors. T is double (may be NaN or infinite) or std::int64_t.
  template <class T>
  T number(std::string_view what);
  /// Reads the number of `what`, each of which takes at least `bytes` bytes of the rest of the file.
  Index count(std::string_view what, std::size_t bytes);
  /// Fails when the rest of the file cannot hold n things of at least `bytes` bytes, or n is no Index.
  Index checked_count(std::int64_t n, std::string_view what, std::size_t bytes) const;

  /// From here on the file is binary: errors tell byte offsets.
  void start_binary() { binary_from_ = std::min(binary_from_, position_); }
  /// Reads n bytes.
  std::string_view bytes(std::size_t n, std::string_view what);
  /// Reads a binary number.
  template <class T>
  T binary(std::endian order, std::string_view what) {
    std::array<char, sizeof(T)> raw{};
    const std::string_view source = bytes(raw.size(), what);
    std::copy(source.begin(), source.end(), raw.begin());
    if (order != std::endian::native) std::reverse(raw.begin(), raw.end());
    return std::bit_cast<T>(raw);
  }

  /// Throws DataError at the token or value read last.
  [[noreturn]] void fail(std::string_view found, std::string_view expected) const { fail_at(offset_, found, expected); }
  [[noreturn]] void fail_at(std::size_t offset, std::string_view found, std::string_view expected) const;
  /// The same for a token as found: quoted, or the end of line or file when it is empty.
  [[noreturn]] void fail_token(std::string_view token, std::string_view expected) const;

 private:
  void skip_blank(bool across_lines);
  bool is_blank(char c) const { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }
  /// Length of the line continuation at this position, 0 when there is none.
  std::size_t continuation(std::size_t position) const;

  std::string name_;
  std::string_view content_;
  Syntax syntax_;
  std::size_t position_ = 0;
  std::size_t offset_ = 0;
  std::size_t end_ = 0;
  std::size_t binary_from_ = std::numeric_limits<std::size_t>::max();
};

}  // namespace variform::io
