// SPDX-License-Identifier: Apache-2.0
//
// Targets in one word.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "targets/target.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string MessageOf(const std::string& word) {
  return testing::RefusalOf([&] { TargetOfWord(word); });
}

TEST(TargetWord, DescribesAChessboard) {
  const auto board = std::get<ChessboardLayout>(TargetOfWord("chessboard:9x6:25mm").layout);
  EXPECT_EQ(board.columns, 9);
  EXPECT_EQ(board.rows, 6);
  EXPECT_EQ(board.square, 0.025);
  EXPECT_EQ(std::get<ChessboardLayout>(TargetOfWord("chessboard:9X6:1 in").layout).square, 0.0254);
}

TEST(TargetWord, DescribesAnAprilGrid) {
  const Target target = TargetOfWord("aprilgrid:6x5:88mm:0.3");
  const auto tags = std::get<TagLayout>(target.layout);
  EXPECT_EQ(tags.family, "tag36h11");
  EXPECT_EQ(tags.border_bits, 2);
  EXPECT_EQ(tags.ids.size(), 30U);
  EXPECT_NEAR(target.markers.at(4).x(), 1.3 * 0.088, 1e-12);
  // The gap as a length, and keys beyond the usual ones.
  const Target other =
      TargetOfWord("aprilgrid:6x5:88mm:26.4mm:tag25h9:border_bits=1:tolerance=0.2mm");
  EXPECT_NEAR(other.markers.at(4).x(), 1.3 * 0.088, 1e-12);
  EXPECT_EQ(std::get<TagLayout>(other.layout).family, "tag25h9");
  EXPECT_EQ(std::get<TagLayout>(other.layout).border_bits, 1);
  EXPECT_EQ(other.tolerance, 0.0002);
}

TEST(TargetWord, DescribesACharucoBoard) {
  for (const char* name : {"6X6_250", "DICT_6X6_250", "6x6_250", "dict_6x6_250"}) {
    const Target target = TargetOfWord(std::string("charuco:5x7:36mm:18mm:") + name);
    const auto board = std::get<CharucoLayout>(target.layout);
    EXPECT_EQ(board.dictionary, "DICT_6X6_250") << name;
    EXPECT_EQ(board.square, 0.036);
    EXPECT_EQ(board.marker, 0.018);
    EXPECT_EQ(target.markers.size(), 24U);
  }
}

TEST(TargetWord, DescribesCircles) {
  EXPECT_FALSE(std::get<CirclesLayout>(TargetOfWord("circles:10x7:25.4mm").layout).asymmetric);
  EXPECT_TRUE(
      std::get<CirclesLayout>(TargetOfWord("circles:4x11:20mm:asymmetric").layout).asymmetric);
}

TEST(TargetWord, ReadsBackAsAFile) {
  const Target target = TargetOfWord("charuco:5x7:36mm:18mm:6X6_250:legacy=true");
  const Target again = ReadTarget(YamlNode::Parse(target.nominal_yaml, "target.yaml"));
  EXPECT_EQ(again.markers, target.markers);
  EXPECT_EQ(std::get<CharucoLayout>(again.layout).legacy, true);
}

TEST(TargetWord, ThatIsWrongIsNamedWithItsForm) {
  EXPECT_THAT(MessageOf("chesboard:9x6:25mm"), HasSubstr("did you mean 'chessboard'?"));
  EXPECT_THAT(MessageOf("chessboard:9x6"),
              HasSubstr("'square' is missing; expected chessboard:COLUMNSxROWS:SQUARE"));
  EXPECT_THAT(MessageOf("chessboard"), HasSubstr("expected chessboard:COLUMNSxROWS:SQUARE"));
  EXPECT_THAT(MessageOf("chessboard:96:25mm"), HasSubstr("got '96' for columns and rows"));
  EXPECT_THAT(MessageOf("aprilgrid:6x6:88mm"),
              HasSubstr("expected aprilgrid:COLUMNSxROWS:SIZE:SPACING[:FAMILY]"));
  EXPECT_THAT(MessageOf("chessboard:9x6:25mm:1:2"), HasSubstr("expected chessboard:"));
  // Of the values the file's own messages, without a place in a file.
  EXPECT_THAT(MessageOf("chessboard:9x6:25"),
              StartsWith("chessboard:9x6:25: square: 25 m? if millimetres are meant, write 25 mm"));
  EXPECT_THAT(MessageOf("chessboard:1x6:25mm"), StartsWith("chessboard:1x6:25mm: columns: "));
  EXPECT_THAT(MessageOf("chessboard:9x6:SIZE"), HasSubstr("square: expected a length"));
  EXPECT_THAT(MessageOf("charuco:5x7:36mm:18mm:6X6_251"), HasSubstr("DICT_6X6_250"));
}

TEST(PrintedLength, WithItsUnitMayBeFromTenNanometresToAThousandMetres) {
  EXPECT_EQ(std::get<ChessboardLayout>(TargetOfWord("chessboard:9x6:3 m").layout).square, 3);
  EXPECT_EQ(std::get<ChessboardLayout>(TargetOfWord("chessboard:9x6:50um").layout).square, 5e-5);
  EXPECT_THAT(MessageOf("chessboard:9x6:3"), HasSubstr("if centimetres, 3 cm"));
  EXPECT_THAT(
      MessageOf("chessboard:9x6:0.000025"),
      HasSubstr("which is 0.025 mm? if 25 mm are meant, write 25 mm; if not, write 0.025 mm"));
  EXPECT_THAT(MessageOf("chessboard:9x6:1e100 m"), HasSubstr("expected a length from 10 nm to"));
  EXPECT_THAT(MessageOf("chessboard:9x6:1 nm"), HasSubstr("expected a length from 10 nm to"));
  EXPECT_THAT(MessageOf("aprilgrid:6x6:88mm:1e100"), HasSubstr("at most 1000 sizes of a tag"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
