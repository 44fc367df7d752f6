// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include <string>

#include "experiments/cli/progress_bar.h"

namespace variform {
namespace {

using ::testing::EndsWith;

TEST(ProgressBar, SaysWhatIsDoneFailedAndHowLongItTakes) {
  EXPECT_EQ(progress_text({.done = 0, .total = 40}, 3.0), "[" + std::string(40, '.') + "] 0/40, 3 s")
      << "before the first point nothing is known";
  EXPECT_EQ(progress_text({.done = 10, .total = 40, .failed = 2}, 20.0),
            "[" + std::string(10, '#') + std::string(30, '.') + "] 10/40, 2 failed, 20 s, 1:00 min left");
}

TEST(ProgressBar, PointsOfAnEarlierRunDoNotMakeTheRestLookQuick) {
  EXPECT_THAT(progress_text({.done = 30, .total = 40, .taken = 28}, 6.0), EndsWith("6 s, 30 s left"));
  EXPECT_THAT(progress_text({.done = 30, .total = 40, .taken = 30}, 6.0), EndsWith("30/40, 6 s"));
  EXPECT_EQ(progress_text({.done = 0, .total = 1, .running = 0.25}, 6.0),
            "[" + std::string(10, '#') + std::string(30, '.') + "] 0/1, 6 s, 18 s left")
      << "a point that says how far it is";
}

TEST(ProgressBar, DurationsAreInReadableUnits) {
  EXPECT_EQ(duration_text(0.0), "0 s");
  EXPECT_EQ(duration_text(59.0), "59 s");
  EXPECT_EQ(duration_text(61.0), "1:01 min");
  EXPECT_EQ(duration_text(3600.0 * 27.5), "27:30 h");
}

}  // namespace
}  // namespace variform
