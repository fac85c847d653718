// SPDX-License-Identifier: Apache-2.0
#include "targets/target.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <filesystem>
#include <string>
#include <variant>

#include "tests/optional_data.h"
#include "tests/targets/target_texts.h"

namespace plenocal {
namespace TEST_FILE {

using testing::ErrorOf;
using testing::ExpectAt;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::Read;

const std::string kChess = "plenocal: 1\ntype: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n";

TEST(Target, RefinementReplacesPositionsInEveryType) {
  const Target target = Read(kChess + "markers: {5: [1, 2, 3]}\nsigma: {5: [1e-5, 1e-5, 0]}\n");
  EXPECT_EQ(target.markers.size(), 12u);
  ExpectAt(target, 5, 1, 2, 3);
  ExpectAt(target, 6, 0.06, 0.03, 0);
  EXPECT_THAT(target.nominal_yaml, Not(HasSubstr("markers")));
  EXPECT_THAT(target.nominal_yaml, Not(HasSubstr("sigma")));
}

TEST(Target, NamesTheNearestType) {
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: chesboard\n"),
              HasSubstr(".yaml:2:7: type: expected a target type, got 'chesboard'; did you mean "
                        "'chessboard'?"));
}

TEST(Target, RequiresTheVersionAndTheType) {
  EXPECT_THAT(ErrorOf("type: chessboard\n"), HasSubstr("start it with 'plenocal: 1'"));
  EXPECT_THAT(ErrorOf("plenocal: 1\n"), HasSubstr(":1:1: type: this key is missing"));
}

TEST(Target, RefusesWrongMarkersAndSigmas) {
  EXPECT_THAT(ErrorOf(kChess + "markers: {12: [0, 0, 0]}\n"),
              HasSubstr(".yaml:6:15: markers.12: this target has no such marker"));
  EXPECT_THAT(ErrorOf(kChess + "markers: {-1: [0, 0, 0]}\n"),
              HasSubstr("a marker's number as key"));
  EXPECT_THAT(ErrorOf(kChess + "markers: {x: [0, 0, 0]}\n"), HasSubstr("a marker's number as key"));
  EXPECT_THAT(ErrorOf(kChess + "markers:\n  1: [0, 0, 0]\n  01: [0, 0, 0]\n"),
              HasSubstr("marker 1 stands in line "));
  EXPECT_THAT(ErrorOf(kChess + "markers: {1: [0, 0]}\n"), HasSubstr("expected 3 lengths"));
  EXPECT_THAT(ErrorOf(kChess + "sigma: {1: [0, 0, 0]}\n"),
              HasSubstr(".yaml:6:12: sigma.1: a sigma needs its marker"));
  EXPECT_THAT(ErrorOf(kChess + "markers: {1: [0, 0, 0]}\nsigma: {1: [0, 0, -1]}\n"),
              HasSubstr("got a negative number"));
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: markers\n"), HasSubstr("markers: this key is missing"));
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: markers\nmarkers: {}\n"), HasSubstr("expected markers"));
}

TEST(Target, OfStatedUnitIsNotDoubtedInIt) {
  const std::string keys = "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\n";
  EXPECT_TRUE(DoubtsAbout(Read(keys + "square: 0.6 mm\n")).unit_is_stated);
  EXPECT_FALSE(DoubtsAbout(Read(keys + "square: 0.0006\n")).unit_is_stated);
}

TEST(Target, OfUnknownSizeHasItAsTheUnit) {
  const std::string keys =
      "plenocal: 1\ntype: charuco\ncolumns: 5\nrows: 7\ndictionary: DICT_4X4_50\n";
  const Target board = Read(keys + "square: unknown\nmarker: 0.5\n");
  EXPECT_EQ((board.markers.at(1) - board.markers.at(0)).norm(), 1);
  EXPECT_EQ(DoubtsAbout(board).unknown, "square");
  EXPECT_THAT(ErrorOf(keys + "square: unknown\nmarker: 18 mm\n"),
              HasSubstr("marker: 'square' is unknown; state this as a part of it"));
  EXPECT_EQ(DoubtsAbout(TargetOfWord("chessboard:9x6:unknown")).unknown, "square");
  EXPECT_EQ(DoubtsAbout(TargetOfWord("chessboard:9x6:25mm")).unknown, "");
}

TEST(Target, HasAsManyMarkersAsItsDictionary) {
  const auto board = [](int rows) {
    return fmt::format(
        "plenocal: 1\ntype: charuco\ncolumns: 10\nrows: {}\nsquare: 0.04\n"
        "marker: 0.03\ndictionary: DICT_4X4_50\n",
        rows);
  };
  EXPECT_EQ(Read(board(10)).markers.size(), 81U);
  EXPECT_THAT(ErrorOf(board(11)), HasSubstr("expected a dictionary with the 55 markers"));
}

// Peak memory of the process, MB.
double PeakMemory() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

// Sixty other lengths of the rows are possible; all their places at once would be 600 MB.
TEST(Target, KeepsNoPlacesOfLargeTargetsThatNobodyAskedFor) {
  const Target target =
      Read("plenocal: 1\ntype: chessboard\ncolumns: 300\nrows: 300\nsquare: 5 mm\n");
  const double before = PeakMemory();
  const TargetDoubts doubts = DoubtsAbout(target);
  EXPECT_GE(doubts.hypotheses.size(), 50u);
  EXPECT_EQ(doubts.hypotheses.back().places().size(), target.markers.size());
  EXPECT_LT(PeakMemory() - before, 100);
}

TEST(Target, ReadsTheSimulatedTarget) {
  const std::filesystem::path path = OptionalData("sim_small/target.yaml");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << Absent(path);
  const Target target = ReadTarget(path);
  EXPECT_EQ(std::get<TagLayout>(target.layout).ids.size(), 63u);
  EXPECT_EQ(target.markers.size(), 252u);
  EXPECT_EQ(target.tolerance, 0.0005);
  ExpectAt(target, 4 * 62 + 3, 0.190614, -0.001694, 0.224464);
}

}  // namespace TEST_FILE
}  // namespace plenocal
