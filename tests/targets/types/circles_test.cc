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

const std::string kCircles =
    "plenocal: 1\ntype: circles\ncolumns: 4\nrows: 11\nspacing: 0.02\npattern: asymmetric\n";

TEST(CirclesTarget, ShiftsEverySecondRowOfAsymmetricCircles) {
  const Target target = Read(kCircles);
  EXPECT_TRUE(std::get<CirclesLayout>(target.layout).asymmetric);
  EXPECT_EQ(target.markers.size(), 44u);
  ExpectAt(target, 1, 0.04, 0, 0);
  ExpectAt(target, 4, 0.02, 0.02, 0);
  ExpectAt(target, 43, 0.12, 0.2, 0);
}

TEST(CirclesTarget, LaysSymmetricCirclesAsAChessboard) {
  const Target target =
      Read("plenocal: 1\ntype: circles\ncolumns: 4\nrows: 3\nspacing: 0.02\npattern: symmetric\n");
  ExpectAt(target, 5, 0.02, 0.02, 0);
}

TEST(CirclesTarget, RefusesUnknownCirclePatterns) {
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: circles\ncolumns: 4\nrows: 3\nspacing: 0.02\n"
                      "pattern: asymetric\n"),
              HasSubstr(".yaml:6:10: pattern: expected symmetric or asymmetric, got "
                        "'asymetric'; did you mean 'asymmetric'?"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
