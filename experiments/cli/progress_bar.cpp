// SPDX-License-Identifier: BSD-3-Clause
#include "experiments/cli/progress_bar.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>

namespace variform {

std::string duration_text(double seconds) {
  const auto whole = static_cast<long>(std::ceil(seconds));
  if (whole < 60) return fmt::format("{} s", whole);
  if (whole < 3600) return fmt::format("{}:{:02} min", whole / 60, whole % 60);
  return fmt::format("{}:{:02} h", whole / 3600, whole / 60 % 60);
}

std::string progress_text(const Progress& progress, double seconds) {
  constexpr int kWidth = 40;
  const double done = progress.done + progress.running;
  const int filled = progress.total > 0 ? static_cast<int>(kWidth * done / progress.total) : 0;
  std::string text =
      fmt::format("[{}{}] {}/{}", std::string(static_cast<std::size_t>(filled), '#'),
                  std::string(static_cast<std::size_t>(kWidth - filled), '.'), progress.done, progress.total);
  if (progress.failed > 0) text += fmt::format(", {} failed", progress.failed);
  text += fmt::format(", {}", duration_text(seconds));
  if (const double ran = done - progress.taken; ran > 0.0) {
    text += fmt::format(", {} left", duration_text(seconds / ran * (progress.total - done)));
  }
  return text;
}

void ProgressBar::show(const Progress& progress) const {
  if (!shown_ || progress.total == 0) return;
  constexpr double kPause = 0.2;
  const double now = watch_.seconds();
  if (progress.done == done_ && now < written_at_ + kPause) return;
  written_at_ = now;
  done_ = progress.done;
  const bool is_end = progress.done == progress.total;
  // To the begin of the line; what was longer there is cleared.
  fmt::print(stderr, "\r{}\x1b[K", is_end ? std::string() : progress_text(progress, now));
  std::fflush(stderr);
}

}  // namespace variform
