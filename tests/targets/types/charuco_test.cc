// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <variant>

#include "targets/target.h"
#include "tests/targets/target_texts.h"

namespace plenocal {
namespace TEST_FILE {

using testing::ErrorOf;
using testing::ExpectAt;
using ::testing::HasSubstr;
using testing::Read;

const std::string kCharuco =
    "plenocal: 1\ntype: charuco\ncolumns: 5\nrows: 7\nsquare: 0.04\nmarker: 0.03\n"
    "dictionary: DICT_5X5_100\n";

TEST(CharucoTarget, NumbersTheInnerCornersOfCharucoBoards) {
  const Target target = Read(kCharuco);
  EXPECT_EQ(std::get<CharucoLayout>(target.layout).dictionary, "DICT_5X5_100");
  EXPECT_FALSE(std::get<CharucoLayout>(target.layout).legacy.has_value());
  EXPECT_EQ(target.markers.size(), 24u);
  ExpectAt(target, 0, 0.04, 0.04, 0);
  ExpectAt(target, 3, 0.16, 0.04, 0);
  ExpectAt(target, 4, 0.04, 0.08, 0);
  ExpectAt(target, 23, 0.16, 0.24, 0);
  EXPECT_EQ(std::get<CharucoLayout>(Read(kCharuco + "legacy: true\n").layout).legacy, true);
}

TEST(CharucoTarget, RefusesWrongCharucoBoards) {
  const auto charuco = [](const std::string& marker, const std::string& dictionary) {
    return ErrorOf("plenocal: 1\ntype: charuco\ncolumns: 10\nrows: 14\nsquare: 0.04\nmarker: " +
                   marker + "\ndictionary: " + dictionary + "\n");
  };
  EXPECT_THAT(charuco("0.04", "DICT_4X4_250"),
              HasSubstr(".yaml:6:9: marker: expected less than the square's 0.04, got '0.04'"));
  EXPECT_THAT(charuco("0.03", "DICT_4X4_25"), HasSubstr("did you mean 'DICT_4X4_250'?"));
  EXPECT_THAT(charuco("0.03", "DICT_4X4_50"),
              HasSubstr("expected a dictionary with the 70 markers of the board"));
  EXPECT_THAT(ErrorOf(kCharuco + "legacy: maybe\n"), HasSubstr("expected true or false"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
