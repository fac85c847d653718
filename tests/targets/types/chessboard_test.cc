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

const std::string kChess = "plenocal: 1\ntype: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n";

TEST(ChessboardTarget, LaysChessboardsAlongTheirColumns) {
  const Target target = Read(kChess);
  EXPECT_EQ(std::get<ChessboardLayout>(target.layout).columns, 4);
  EXPECT_EQ(std::get<ChessboardLayout>(target.layout).rows, 3);
  EXPECT_EQ(target.markers.size(), 12u);
  ExpectAt(target, 0, 0, 0, 0);
  ExpectAt(target, 3, 0.09, 0, 0);
  ExpectAt(target, 4, 0, 0.03, 0);
  ExpectAt(target, 11, 0.09, 0.06, 0);
}

TEST(ChessboardTarget, RefusesWrongSizesAndCounts) {
  const auto chess = [](const std::string& columns, const std::string& square) {
    return ErrorOf("plenocal: 1\ntype: chessboard\nrows: 3\ncolumns: " + columns +
                   "\nsquare: " + square + "\n");
  };
  EXPECT_THAT(
      chess("4", "0"),
      HasSubstr(".yaml:5:9: square: expected a length in metres or with its unit, got '0'"));
  EXPECT_THAT(chess("4", "-1"), HasSubstr("write a number above 0"));
  EXPECT_THAT(chess("4", ".nan"),
              HasSubstr("square: expected a length in metres or with its unit, got '.nan'"));
  EXPECT_EQ(chess("4", "30mm"), "no refusal");
  EXPECT_THAT(chess("1", "0.03"),
              HasSubstr(".yaml:4:10: columns: expected a number from 2 to 1000, got '1'"));
  EXPECT_THAT(chess("1001", "0.03"), HasSubstr("got '1001'"));
  EXPECT_THAT(chess("4.5", "0.03"), HasSubstr("expected a whole number"));
  EXPECT_THAT(ErrorOf(kChess + "tolerance: 0\n"), HasSubstr(".yaml:6:12: tolerance: expected"));
  EXPECT_THAT(ErrorOf(kChess + "tolerance: -1e-3\n"), HasSubstr("write a number above 0"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
