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

const std::string kKalibrGrid =
    "target_type: 'aprilgrid' #gridtype\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n";
const std::string kKalibrChess =
    "target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\n"
    "colSpacingMeters: 0.05\n";
const std::string kKalibrCircles =
    "target_type: 'circlegrid'\ntargetCols: 6\ntargetRows: 7\nspacingMeters: 0.02\n"
    "asymmetricGrid: False\n";

TEST(KalibrTarget, ReadsGridsOfTwoRows) {
  for (const char* rows : {"2", "7"}) {
    std::string text = kKalibrCircles;
    text.replace(text.find("targetRows: 7"), 13, std::string("targetRows: ") + rows);
    const auto circles = std::get<CirclesLayout>(Read(text).layout);
    EXPECT_EQ(circles.columns, 6);
    EXPECT_EQ(circles.rows, std::stoi(rows));
    EXPECT_EQ(circles.spacing, 0.02);
    EXPECT_FALSE(circles.asymmetric);
  }
}

TEST(KalibrTarget, ReadsKalibrsAprilgrid) {
  const Target target = Read(kKalibrGrid);
  const auto& layout = std::get<TagLayout>(target.layout);
  EXPECT_EQ(layout.family, "tag36h11");
  EXPECT_EQ(layout.border_bits, 2);
  EXPECT_TRUE(layout.black_corner_squares);
  EXPECT_EQ(layout.ids.size(), 30u);
  ExpectAt(target, 2, 0.088, 0.088, 0);
  ExpectAt(target, 4, 0.1144, 0, 0);
  ExpectAt(target, 24, 0, 0.1144, 0);
  EXPECT_EQ(std::get<TagLayout>(Read(kKalibrGrid + "codeOffset: 3\n").layout).ids.front(), 3);
}

TEST(KalibrTarget, ReadsKalibrsCheckerboardWithUnequalSpacings) {
  const Target target = Read(kKalibrChess);
  EXPECT_EQ(target.markers.size(), 42u);
  ExpectAt(target, 1, 0.05, 0, 0);
  ExpectAt(target, 6, 0, 0.06, 0);
  // The side of a square does not state them.
  EXPECT_EQ(NominalTarget(target).markers, target.markers);
  EXPECT_THAT(testing::RefusalOf([&] { DrawTarget(target); }), HasSubstr("unequal"));
}

TEST(KalibrTarget, ReadsKalibrsCirclegrid) {
  EXPECT_FALSE(std::get<CirclesLayout>(Read(kKalibrCircles).layout).asymmetric);
  ExpectAt(Read(kKalibrCircles), 7, 0.02, 0.02, 0);
}

TEST(KalibrTarget, RefusesUnknownTypesAndKeys) {
  EXPECT_THAT(ErrorOf("target_type: 'aprilgird'\n"), HasSubstr("did you mean 'aprilgrid'?"));
  EXPECT_THAT(ErrorOf(kKalibrGrid + "tagSpace: 1\n"),
              HasSubstr(".yaml:6:1: tagSpace: unknown key; did you mean 'tagSpacing'?"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
