// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/io/base64.h"

#include <algorithm>
#include <cstdint>

namespace variform::io {
namespace {

constexpr std::string_view kAlphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
constexpr std::string_view kWhiteSpace = " \t\r\n\v\f";
constexpr int kGroupSize = 4;

/// Value of a character, negative when it is not in the alphabet.
int value_of(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  if (c == '+') return 62;
  return c == '/' ? 63 : -1;
}

}  // namespace

std::string base64_encode(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * kGroupSize);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t size = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8 | (k < size ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (std::size_t k = 0; k < kGroupSize; ++k) {
      text += k <= size ? kAlphabet[group >> (18 - 6 * k) & 63u] : '=';
    }
  }
  return text;
}

bool Base64Decoder::decode_group() {
  std::uint32_t group = 0;
  int size = 0;
  int padding = 0;
  while (size < kGroupSize && !text_.empty()) {
    const char c = text_.front();
    text_.remove_prefix(1);
    if (kWhiteSpace.find(c) != std::string_view::npos) continue;
    const int value = value_of(c);
    if (c == '=') {
      ++padding;
    } else if (value < 0 || padding > 0) {
      return false;
    }
    group = group << 6 | static_cast<std::uint32_t>(std::max(value, 0));
    ++size;
  }
  if (size < kGroupSize || padding > 2) return false;
  for (int k = 0; k < 3 - padding; ++k) decoded_ += static_cast<char>(group >> (16 - 8 * k) & 255u);
  return true;
}

std::optional<std::string> Base64Decoder::read(std::size_t n) {
  while (decoded_.size() < n) {
    if (!decode_group()) return std::nullopt;
  }
  std::string bytes = decoded_.substr(0, n);
  decoded_.erase(0, n);
  return bytes;
}

bool Base64Decoder::at_end() const {
  return decoded_.empty() && text_.find_first_not_of(kWhiteSpace) == std::string_view::npos;
}

}  // namespace variform::io
