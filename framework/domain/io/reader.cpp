// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/io/reader.h"

#include <fmt/format.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <system_error>

#include "framework/base/error.h"
#include "framework/domain/io/compression.h"

namespace variform::io {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

/// The token in quotes, short and printable whatever it is.
std::string quoted(std::string_view token) {
  constexpr std::size_t kMaxLength = 40;
  std::string text(token.substr(0, kMaxLength));
  for (char& c : text) {
    if (c < ' ' || c > '~') c = '?';
  }
  return fmt::format("'{}{}'", text, token.size() > kMaxLength ? "..." : "");
}

}  // namespace

template <class T>
bool parse_number(std::string_view text, T& value) {
  if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
  const char* const end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, value);
  if (text.empty() || result.ptr != end) return false;
  if constexpr (std::is_floating_point_v<T>) {
    // from_chars leaves the value alone when it is too small or too large; strtod gives 0 or infinity.
    if (result.ec == std::errc::result_out_of_range) {
      value = std::strtod(std::string(text).c_str(), nullptr);
      return true;
    }
  }
  return result.ec == std::errc();
}
template bool parse_number(std::string_view text, double& value);
template bool parse_number(std::string_view text, std::int64_t& value);

std::string load_file(const std::filesystem::path& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    throw DataError(fmt::format("{}: found a folder, expected a file", path.string()));
  }
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
  if (!file) {
    throw DataError(fmt::format("{}: cannot be read: {}", path.string(), std::generic_category().message(errno)));
  }

  std::string content;
  std::string chunk(std::size_t{1} << 20, '\0');
  while (const std::size_t size = std::fread(chunk.data(), 1, chunk.size(), file.get())) content.append(chunk, 0, size);
  if (std::ferror(file.get()) != 0) {
    throw DataError(fmt::format("{}: cannot be read: {}", path.string(), std::generic_category().message(errno)));
  }

  if (path.extension() == ".gz" && !content.empty()) {
    std::string unpacked;
    if (!decompress(content, Compression::gzip, unpacked)) {
      throw DataError(fmt::format("{}: found damaged or truncated data, expected a complete gzip file", path.string()));
    }
    content = std::move(unpacked);
  }
  if (content.empty()) throw DataError(fmt::format("{}: found an empty file, expected a mesh", path.string()));
  return content;
}

Reader::Reader(std::string name, std::string_view content, Syntax syntax)
    : name_(std::move(name)), content_(content), syntax_(syntax), end_(content.size()) {
  if (content_.starts_with(kByteOrderMark)) position_ = kByteOrderMark.size();
}

Reader Reader::part(std::size_t offset, std::size_t size, Syntax syntax) const {
  Reader reader(*this);
  reader.syntax_ = syntax;
  reader.position_ = reader.offset_ = std::min(offset, content_.size());
  reader.end_ = reader.position_ + std::min(size, content_.size() - reader.position_);
  return reader;
}

std::size_t Reader::continuation(std::size_t position) const {
  if (!syntax_.continuation) return 0;
  const std::string_view rest = content_.substr(position, std::min<std::size_t>(3, end_ - position));
  if (rest.starts_with("\\\n")) return 2;
  return rest == "\\\r\n" ? 3 : 0;
}

void Reader::skip_blank(bool across_lines) {
  while (position_ < end_) {
    const char c = content_[position_];
    if (is_blank(c) || (c == '\n' && across_lines)) {
      ++position_;
    } else if (c == syntax_.comment && syntax_.comment != '\0') {
      position_ = std::min(content_.find('\n', position_), end_);
    } else if (const std::size_t length = continuation(position_)) {
      position_ += length;
    } else {
      return;
    }
  }
}

bool Reader::next_line() {
  skip_blank(true);
  offset_ = position_;
  return position_ < end_;
}

void Reader::require_line(std::string_view expected) {
  if (!next_line()) fail("the end of the file", expected);
}

std::string_view Reader::skip_line() {
  const std::size_t start = position_;
  const std::size_t end = std::min(content_.find('\n', start), end_);
  position_ = std::min(end + 1, end_);
  return content_.substr(start, end - start);
}

void Reader::end_line() {
  skip_blank(false);
  if (position_ < end_ && content_[position_] != '\n') fail_token(token(), "the end of the line");
}

bool Reader::skip_past(std::string_view text) {
  const std::size_t found = content_.substr(0, end_).find(text, position_);
  if (found == std::string_view::npos) return false;
  position_ = found + text.size();
  return true;
}

std::string_view Reader::token() {
  skip_blank(syntax_.free_form);
  const std::size_t start = position_;
  while (position_ < end_) {
    const char c = content_[position_];
    if (is_blank(c) || c == '\n' || (c == syntax_.comment && c != '\0') || continuation(position_) > 0) break;
    ++position_;
  }
  offset_ = start;
  return content_.substr(start, position_ - start);
}

std::string_view Reader::peek() {
  const std::string_view next = token();
  position_ = offset_;
  return next;
}

void Reader::expect(std::string_view word) {
  const std::string_view found = token();
  if (found != word) fail_token(found, fmt::format("'{}'", word));
}

template <class T>
T Reader::number(std::string_view what) {
  const std::string_view text = token();
  T value{};
  if (!parse_number(text, value)) fail_token(text, what);
  return value;
}
template double Reader::number<double>(std::string_view what);
template std::int64_t Reader::number<std::int64_t>(std::string_view what);

Index Reader::count(std::string_view what, std::size_t bytes) {
  return checked_count(number<std::int64_t>(fmt::format("the number of {}", what)), what, bytes);
}

Index Reader::checked_count(std::int64_t n, std::string_view what, std::size_t bytes) const {
  // The last thing in a text file may lack its separator.
  const std::size_t fitting = std::min<std::size_t>((remaining() + 1) / bytes, std::numeric_limits<Index>::max());
  if (n < 0 || static_cast<std::uint64_t>(n) > fitting) {
    fail(fmt::format("{} {}", n, what), fmt::format("0 to {}, which the rest of the file can hold", fitting));
  }
  return static_cast<Index>(n);
}

std::string_view Reader::bytes(std::size_t n, std::string_view what) {
  offset_ = position_;
  if (n > remaining()) {
    fail(fmt::format("{} bytes before the end of the file", remaining()), fmt::format("{} of {}", n, what));
  }
  position_ += n;
  return content_.substr(offset_, n);
}

void Reader::fail_at(std::size_t offset, std::string_view found, std::string_view expected) const {
  const std::string_view before = content_.substr(0, std::min(offset, content_.size()));
  const std::string place = offset >= binary_from_
                                ? fmt::format("byte {}", offset)
                                : fmt::format("{}", 1 + std::count(before.begin(), before.end(), '\n'));
  throw DataError(fmt::format("{}:{}: found {}, expected {}", name_, place, found, expected));
}

void Reader::fail_token(std::string_view token, std::string_view expected) const {
  if (!token.empty()) fail(quoted(token), expected);
  fail(position_ < end_ ? "the end of the line" : "the end of the file", expected);
}

}  // namespace variform::io
