// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace variform {

/// A mark on an axis.
struct Tick {
  double value;
  std::string label;
};

/// About max_count marks at round numbers in [low, high]. Logarithmic axes (0 < low) get powers of ten, or 1-2-5
/// multiples of them where that would leave fewer than three.
std::vector<Tick> axis_ticks(double low, double high, bool logarithmic, int max_count = 6);

}  // namespace variform
