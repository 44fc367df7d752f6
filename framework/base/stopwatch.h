// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>

namespace variform {

/// Wall-clock seconds since construction or the last restart().
class Stopwatch {
 public:
  /// Returns the seconds up to now.
  double restart() {
    const double elapsed = seconds();
    start_ = Clock::now();
    return elapsed;
  }
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

}  // namespace variform
