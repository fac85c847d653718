// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/live_look.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::workbench {
namespace TEST_FILE {

using plenocal::testing::RefusalOf;

constexpr const char* kWrongSizes = "pictures: expected CAMERA:BYTES,... as long as the body";

std::string Refusal(const std::string& sizes, const std::string& pictures) {
  const plenocal::testing::TemporaryFolder without_run;
  return RefusalOf([&] { LiveLook().Weigh(without_run.Path(), sizes, pictures); });
}

TEST(LiveLook, RefusesSizesThatAreNotThoseOfThePictures) {
  for (const char* sizes : {"",
                            "left",
                            "left:",
                            "left:0",
                            "left:-6",
                            "left:5",
                            "left:7",
                            "left:6 ",
                            "left:6x",
                            "left: 6",
                            "left:2,right:3",
                            "left:2,right:5",
                            "left:6,right:0",
                            "left:6,right",
                            "left:99999999999999999999"}) {
    EXPECT_EQ(Refusal(sizes, "abcdef"), kWrongSizes) << sizes;
  }
  EXPECT_EQ(Refusal("left:1", ""), kWrongSizes);
}

TEST(LiveLook, ReadsTheRunAfterSizesThatAreRight) {
  for (const char* sizes : {"left:6", "left:2,right:4", "a:b:6", "left:1,middle:2,right:3"}) {
    EXPECT_NE(Refusal(sizes, "abcdef").find("no such file"), std::string::npos) << sizes;
  }
}

TEST(LiveLook, KeepsNothingBeforeAPictureIsWeighed) {
  EXPECT_TRUE(LiveLook().Keep("frame").is_null());
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
