// SPDX-License-Identifier: Apache-2.0
#include "calib/base/number_text.h"

#include <gtest/gtest.h>

namespace plenocal::testing {
namespace TEST_FILE {

TEST(Counted, HasTheSingularForOneOnly) {
  EXPECT_EQ(Counted(0, "image"), "0 images");
  EXPECT_EQ(Counted(1, "image"), "1 image");
  EXPECT_EQ(Counted(2, "image"), "2 images");
  EXPECT_EQ(Counted(1, "micro lens", "micro lenses"), "1 micro lens");
  EXPECT_EQ(Counted(3, "micro lens", "micro lenses"), "3 micro lenses");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
