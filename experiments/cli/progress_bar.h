// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "framework/base/stopwatch.h"
#include "framework/experiment/runner.h"

namespace variform {

/// The text of a progress bar: points done of all, those without result, time gone and time left. The time left is that
/// of the points to come at the rate of those that ran (points of an earlier run took none); unknown before the first.
std::string progress_text(const Progress& progress, double seconds);

/// Seconds in a form for people: "8 s", "2:05 min", "3:20 h".
std::string duration_text(double seconds);

/// A progress bar on standard error, in one line that is written anew a few times a second.
class ProgressBar {
 public:
  explicit ProgressBar(bool shown) : shown_(shown) {}
  void show(const Progress& progress) const;

 private:
  bool shown_;
  Stopwatch watch_;
  mutable double written_at_ = -1.0;
  mutable int done_ = -1;
};

}  // namespace variform
