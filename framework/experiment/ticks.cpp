// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/ticks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

namespace variform {
namespace {

/// Room for rounding when a range ends at a mark.
constexpr double kSlack = 1e-9;
constexpr double kSmallestRange = 1e-300;
constexpr std::array<double, 3> kMultiples = {1.0, 2.0, 5.0};

/// Smallest of 1, 2, 5 times a power of ten that is not below the given step.
double round_step(double step) {
  const double power = std::pow(10.0, std::floor(std::log10(step)));
  for (const double multiple : kMultiples) {
    if (multiple * power >= step * (1.0 - kSlack)) return multiple * power;
  }
  return 10.0 * power;
}

std::string superscript(int exponent) {
  static constexpr std::array<std::string_view, 10> kDigits = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string text;
  for (const char c : fmt::to_string(exponent)) {
    text += c == '-' ? std::string_view("⁻") : kDigits[static_cast<std::size_t>(c - '0')];
  }
  return text;
}

std::vector<Tick> linear_ticks(double low, double high, int max_count) {
  const double step = round_step((high - low) / max_count);
  // As many digits as tell neighbours apart.
  const double largest = std::max(std::abs(low), std::abs(high));
  const int digits = std::clamp(static_cast<int>(std::ceil(std::log10(largest / step))) + 1, 2, 15);
  const double first = std::ceil(low / step - kSlack);
  const int count = static_cast<int>(std::floor(high / step + kSlack) - first) + 1;
  std::vector<Tick> ticks;
  for (int i = 0; i < count; ++i) {
    const double value = (first + i) * step + 0.0;  // no negative zero
    ticks.push_back({value, fmt::format("{:.{}g}", value, digits)});
  }
  return ticks;
}

std::vector<Tick> decade_ticks(int first, int last, int max_count) {
  const int stride = (last - first) / max_count + 1;
  const bool is_short = first >= -2 && last <= 3;
  std::vector<Tick> ticks;
  for (int exponent = first; exponent <= last; ++exponent) {
    if (exponent % stride != 0) continue;
    const double value = std::pow(10.0, exponent);
    ticks.push_back({value, is_short ? fmt::format("{:g}", value) : "10" + superscript(exponent)});
  }
  return ticks;
}

std::vector<Tick> multiple_ticks(double low, double high) {
  std::vector<Tick> ticks;
  for (int exponent = static_cast<int>(std::floor(std::log10(low))); std::pow(10.0, exponent) <= high; ++exponent) {
    for (const double multiple : kMultiples) {
      const double value = multiple * std::pow(10.0, exponent);
      if (value < low * (1.0 - kSlack) || value > high * (1.0 + kSlack)) continue;
      ticks.push_back({value, fmt::format("{:g}", value)});
    }
  }
  return ticks;
}

}  // namespace

std::vector<Tick> axis_ticks(double low, double high, bool logarithmic, int max_count) {
  const double range = high - low;
  if (!(range > kSmallestRange && std::isfinite(range))) return {{low, fmt::format("{:g}", low)}};
  if (!logarithmic) return linear_ticks(low, high, max_count);
  const int first = static_cast<int>(std::ceil(std::log10(low) - kSlack));
  const int last = static_cast<int>(std::floor(std::log10(high) + kSlack));
  if (last - first >= 2) return decade_ticks(first, last, max_count);
  const std::vector<Tick> ticks = multiple_ticks(low, high);
  return ticks.size() >= 3 ? ticks : linear_ticks(low, high, max_count);
}

}  // namespace variform
