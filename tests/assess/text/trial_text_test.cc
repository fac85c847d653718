// SPDX-License-Identifier: Apache-2.0
#include "assess/text/trial_text.h"

#include <gtest/gtest.h>

#include <string>

namespace plenocal {
namespace TEST_FILE {

TEST(StressText, HasTheFiguresOfEachTestOrItsReason) {
  EXPECT_EQ(StressText({}), "");
  const std::vector<StressTest> tests{
      {.camera = "left",
       .kind = StressKind::kTime,
       .what = "first/second",
       .difference = 0.25,
       .predicted = 0.125,
       .factor = 2.5,
       .probability = 0.001},
      {.camera = "left",
       .kind = StressKind::kNoise,
       .what = "odd/even",
       .difference = 0.0625,
       .predicted = 0.0312,
       .factor = 1,
       .probability = 0.5},
      {.camera = "right", .kind = StressKind::kRegion, .what = "border", .failure = "no points"}};
  EXPECT_EQ(StressText(tests),
            "\n"
            "  stress       of                    p  difference px  predicted px   factor\n"
            "* first/second left              0.001         0.2500        0.1250     2.50\n"
            "  odd/even     left                0.5         0.0625        0.0312     1.00\n"
            "  border       right          no points\n"
            "left: only the first and second half of the frames differ: the camera moved or "
            "warmed.\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal
