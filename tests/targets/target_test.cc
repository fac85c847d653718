// SPDX-License-Identifier: Apache-2.0
#include "targets/target.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <variant>

#include "calib/error.h"

namespace plenocal {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

// m. Files hold 12 digits, and the markers of these tests are less than 10 m away.
constexpr double kRounding = 1e-11;

class TargetFile {
 public:
  explicit TargetFile(const std::string& text) {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string("plenocal_") + info->name() + ".yaml";
    std::replace(name.begin(), name.end(), '/', '_');  // of tests with parameters
    path_ = std::filesystem::path(testing::TempDir()) / name;
    std::ofstream(path_) << text;
  }
  ~TargetFile() { std::filesystem::remove(path_); }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

Target Read(const std::string& text) { return ReadTarget(TargetFile(text).path()); }

std::string ErrorOf(const std::string& text) {
  try {
    Read(text);
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInput);
    EXPECT_THAT(error.what(), Not(HasSubstr("\n")));
    return error.what();
  }
  return "no error";
}

void ExpectAt(const Target& target, int marker, double x, double y, double z) {
  const auto found = target.markers.find(marker);
  ASSERT_NE(found, target.markers.end()) << "no marker " << marker;
  EXPECT_LT((found->second - Eigen::Vector3d(x, y, z)).norm(), kRounding)
      << "marker " << marker << " is at " << found->second.transpose();
}

const std::string kTag = "[[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]";
const std::string kTags =
    "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntolerance: 0.0005\ntags:\n"
    "  - {id: 7, corners: [[1, 0, 0], [1.1, 0, 0], [1.1, 0.1, 0], [1, 0.1, 0.01]]}\n"
    "  - {id: 2, corners: " +
    kTag + "}\n";
const std::string kGrid =
    "plenocal: 1\ntype: aprilgrid\ncolumns: 3\nrows: 2\nsize: 0.08\nspacing: 0.25\n";
const std::string kChess = "plenocal: 1\ntype: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n";
const std::string kCharuco =
    "plenocal: 1\ntype: charuco\ncolumns: 5\nrows: 7\nsquare: 0.04\nmarker: 0.03\n"
    "dictionary: DICT_5X5_100\n";
const std::string kCircles =
    "plenocal: 1\ntype: circles\ncolumns: 4\nrows: 11\nspacing: 0.02\npattern: asymmetric\n";
const std::string kMarkers =
    "plenocal: 1\ntype: markers\nmarkers:\n  0: [0, 0, 0]\n  12: [0.1, 0.2, 0.3]\n";
const std::string kKalibrGrid =
    "target_type: 'aprilgrid' #gridtype\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n";
const std::string kKalibrChess =
    "target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\n"
    "colSpacingMeters: 0.05\n";
const std::string kKalibrCircles =
    "target_type: 'circlegrid'\ntargetCols: 6\ntargetRows: 7\nspacingMeters: 0.02\n"
    "asymmetricGrid: False\n";

TEST(Target, ListsTypes) {
  EXPECT_THAT(TargetTypes(),
              ElementsAre("apriltag", "aprilgrid", "chessboard", "charuco", "circles", "markers"));
}

TEST(Target, NumbersTheCornersOfFreeTags) {
  const Target target = Read(kTags);
  const auto& layout = std::get<TagLayout>(target.layout);
  EXPECT_EQ(layout.family, "tag36h11");
  EXPECT_EQ(layout.border_bits, 1);
  EXPECT_FALSE(layout.black_corner_squares);
  EXPECT_THAT(layout.ids, ElementsAre(2, 7));
  EXPECT_EQ(target.markers.size(), 8u);
  ExpectAt(target, 8, 0, 0, 0);
  ExpectAt(target, 11, 0, 0.1, 0);
  ExpectAt(target, 29, 1.1, 0, 0);
  ExpectAt(target, 31, 1, 0.1, 0.01);
  EXPECT_EQ(target.tolerance, 0.0005);
}

TEST(Target, LaysTagGridsFromTheLowerLeft) {
  const Target target = Read(kGrid + "first_id: 10\n");
  const auto& layout = std::get<TagLayout>(target.layout);
  EXPECT_EQ(layout.family, "tag36h11");
  EXPECT_THAT(layout.ids, ElementsAre(10, 11, 12, 13, 14, 15));
  EXPECT_EQ(target.markers.size(), 24u);
  EXPECT_FALSE(target.tolerance.has_value());
  ExpectAt(target, 40, 0, 0, 0);
  ExpectAt(target, 45, 0.18, 0, 0);     // second tag, lower right
  ExpectAt(target, 4 * 13, 0, 0.1, 0);  // second row
  ExpectAt(target, 4 * 15 + 2, 0.28, 0.18, 0);
  ExpectAt(target, 4 * 15 + 3, 0.2, 0.18, 0);
}

TEST(Target, TakesTagGridsForKalibrsPrintUnlessTheySayOtherwise) {
  EXPECT_EQ(std::get<TagLayout>(Read(kGrid).layout).border_bits, 2);
  EXPECT_TRUE(std::get<TagLayout>(Read(kGrid).layout).black_corner_squares);
  const Target target = Read(kGrid + "border_bits: 1\nfamily: tag25h9\n");
  EXPECT_EQ(std::get<TagLayout>(target.layout).border_bits, 1);
  EXPECT_FALSE(std::get<TagLayout>(target.layout).black_corner_squares);
  EXPECT_EQ(std::get<TagLayout>(target.layout).family, "tag25h9");
}

TEST(Target, LaysChessboardsAlongTheirColumns) {
  const Target target = Read(kChess);
  EXPECT_EQ(std::get<ChessboardLayout>(target.layout).columns, 4);
  EXPECT_EQ(std::get<ChessboardLayout>(target.layout).rows, 3);
  EXPECT_EQ(target.markers.size(), 12u);
  ExpectAt(target, 0, 0, 0, 0);
  ExpectAt(target, 3, 0.09, 0, 0);
  ExpectAt(target, 4, 0, 0.03, 0);
  ExpectAt(target, 11, 0.09, 0.06, 0);
}

TEST(Target, NumbersTheInnerCornersOfCharucoBoards) {
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

TEST(Target, ShiftsEverySecondRowOfAsymmetricCircles) {
  const Target target = Read(kCircles);
  EXPECT_TRUE(std::get<CirclesLayout>(target.layout).asymmetric);
  EXPECT_EQ(target.markers.size(), 44u);
  ExpectAt(target, 1, 0.04, 0, 0);
  ExpectAt(target, 4, 0.02, 0.02, 0);
  ExpectAt(target, 43, 0.12, 0.2, 0);
}

TEST(Target, LaysSymmetricCirclesAsAChessboard) {
  const Target target =
      Read("plenocal: 1\ntype: circles\ncolumns: 4\nrows: 3\nspacing: 0.02\npattern: symmetric\n");
  ExpectAt(target, 5, 0.02, 0.02, 0);
}

TEST(Target, ReadsMarkersWithoutDetector) {
  const Target target = Read(kMarkers);
  EXPECT_TRUE(std::holds_alternative<MarkersLayout>(target.layout));
  EXPECT_EQ(target.markers.size(), 2u);
  ExpectAt(target, 12, 0.1, 0.2, 0.3);
}

TEST(Target, ReadsKalibrsAprilgrid) {
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

TEST(Target, ReadsKalibrsCheckerboardWithUnequalSpacings) {
  const Target target = Read(kKalibrChess);
  EXPECT_EQ(target.markers.size(), 42u);
  ExpectAt(target, 1, 0.05, 0, 0);
  ExpectAt(target, 6, 0, 0.06, 0);
}

TEST(Target, ReadsKalibrsCirclegrid) {
  EXPECT_FALSE(std::get<CirclesLayout>(Read(kKalibrCircles).layout).asymmetric);
  ExpectAt(Read(kKalibrCircles), 7, 0.02, 0.02, 0);
}

TEST(Target, KnowsKalibrsTypesAndKeysOnly) {
  EXPECT_THAT(ErrorOf("target_type: 'aprilgird'\n"), HasSubstr("did you mean 'aprilgrid'?"));
  EXPECT_THAT(ErrorOf(kKalibrGrid + "tagSpace: 1\n"),
              HasSubstr(".yaml:6:1: tagSpace: unknown key; did you mean 'tagSpacing'?"));
}

TEST(Target, RefinementReplacesPositionsInEveryType) {
  const Target target = Read(kChess + "markers: {5: [1, 2, 3]}\nsigma: {5: [1e-5, 1e-5, 0]}\n");
  EXPECT_EQ(target.markers.size(), 12u);
  ExpectAt(target, 5, 1, 2, 3);
  ExpectAt(target, 6, 0.06, 0.03, 0);
  EXPECT_THAT(target.nominal_yaml, Not(HasSubstr("markers")));
  EXPECT_THAT(target.nominal_yaml, Not(HasSubstr("sigma")));
}

class RefinedTarget : public testing::TestWithParam<std::string> {};

TEST_P(RefinedTarget, ReadsBackEqual) {
  const Target nominal = Read(GetParam());
  std::map<int, Eigen::Vector3d> positions, sigmas;
  for (const auto& [number, place] : nominal.markers) {
    positions[number] = place + Eigen::Vector3d(1.0 / 3000, -2.0 / 7000, 1e-7 * number);
    sigmas[number] = Eigen::Vector3d(1e-5, 2e-5, 3e-5);
  }
  const auto last = std::prev(nominal.markers.end());
  positions.erase(last->first);
  sigmas.erase(last->first);

  const std::string yaml = RefinedTargetYaml(nominal, positions, sigmas);
  EXPECT_THAT(yaml, testing::StartsWith("plenocal: 1\ntype: "));
  EXPECT_THAT(yaml, HasSubstr("\nmarkers:\n  "));
  EXPECT_THAT(yaml, HasSubstr(": [1e-05, 2e-05, 3e-05]\n"));
  const Target refined = Read(yaml);
  EXPECT_EQ(refined.layout.index(), nominal.layout.index());
  EXPECT_EQ(refined.nominal_yaml, nominal.nominal_yaml);
  EXPECT_EQ(refined.tolerance, nominal.tolerance);
  ASSERT_EQ(refined.markers.size(), nominal.markers.size());
  for (const auto& [number, p] : positions) ExpectAt(refined, number, p.x(), p.y(), p.z());
  // The marker that was not refined keeps its place, now and after the next calibration.
  const Eigen::Vector3d p = last->second;
  ExpectAt(refined, last->first, p.x(), p.y(), p.z());
  const Target again = Read(RefinedTargetYaml(refined, {}, {}));
  for (const auto& [number, q] : refined.markers) ExpectAt(again, number, q.x(), q.y(), q.z());
}

INSTANTIATE_TEST_SUITE_P(EveryType,
                         RefinedTarget,
                         testing::Values(kTags,
                                         kGrid + "first_id: 3\nborder_bits: 1\n",
                                         kChess + "tolerance: 1e-4\n",
                                         kCharuco + "legacy: false\n",
                                         kCircles,
                                         kMarkers,
                                         kKalibrGrid + "tolerance: 0.0003\n",
                                         kKalibrChess,
                                         kKalibrCircles),
                         [](const auto& param_info) {
                           return "Target" + std::to_string(param_info.index);
                         });

TEST(Target, NamesTheNearestType) {
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: chesboard\n"),
              HasSubstr(".yaml:2:7: type: expected a target type, got 'chesboard'; did you mean "
                        "'chessboard'?"));
}

TEST(Target, AsksForTheVersionAndTheType) {
  EXPECT_THAT(ErrorOf("type: chessboard\n"), HasSubstr("start it with 'plenocal: 1'"));
  EXPECT_THAT(ErrorOf("plenocal: 1\n"), HasSubstr(":1:1: type: this key is missing"));
}

TEST(Target, RefusesWrongSizesAndCounts) {
  const auto chess = [](const std::string& columns, const std::string& square) {
    return ErrorOf("plenocal: 1\ntype: chessboard\nrows: 3\ncolumns: " + columns +
                   "\nsquare: " + square + "\n");
  };
  EXPECT_THAT(chess("4", "0"),
              HasSubstr(".yaml:5:9: square: expected a length in metres, got '0'"));
  EXPECT_THAT(chess("4", "-1"), HasSubstr("write a number above 0"));
  EXPECT_THAT(chess("4", ".nan"), HasSubstr("square: expected a length in metres, got '.nan'"));
  EXPECT_THAT(chess("4", "30mm"), HasSubstr("got '30mm'; write 0.03"));
  EXPECT_THAT(chess("1", "0.03"),
              HasSubstr(".yaml:4:10: columns: expected a number from 2 to 1000, got '1'"));
  EXPECT_THAT(chess("1001", "0.03"), HasSubstr("got '1001'"));
  EXPECT_THAT(chess("4.5", "0.03"), HasSubstr("expected a whole number"));
  EXPECT_THAT(ErrorOf(kChess + "tolerance: 0\n"), HasSubstr(".yaml:6:12: tolerance: expected"));
  EXPECT_THAT(ErrorOf(kChess + "tolerance: -1e-3\n"), HasSubstr("write a number above 0"));
}

TEST(Target, RefusesUnknownKeysOfEveryType) {
  for (const std::string& text : {kTags, kGrid, kChess, kCharuco, kCircles, kMarkers}) {
    EXPECT_THAT(ErrorOf(text + "tolerence: 1\n"), HasSubstr("did you mean 'tolerance'?"));
  }
}

TEST(Target, RefusesWrongTags) {
  const auto tags = [](const std::string& more, const std::string& family = "tag36h11") {
    return ErrorOf("plenocal: 1\ntype: apriltag\nfamily: " + family +
                   "\ntags:\n  - {id: 5, corners: " + kTag + "}\n" + more);
  };
  EXPECT_THAT(tags("  - {id: 5, corners: " + kTag + "}\n"),
              HasSubstr(".yaml:6:10: tags[1].id: tag 5 stands in line 5 already; give"));
  EXPECT_THAT(tags("  - {id: 587, corners: " + kTag + "}\n"),
              HasSubstr("tags[1].id: expected an id of tag36h11, 0 to 586, got 587"));
  EXPECT_THAT(tags("  - {id: -1, corners: " + kTag + "}\n"), HasSubstr("got -1"));
  EXPECT_THAT(tags("  - {id: 6, corners: [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}\n"),
              HasSubstr("tags[1].corners: expected 4 corners, got 3"));
  EXPECT_THAT(tags("  - {id: 6, corners: [[0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}\n"),
              HasSubstr("tags[1].corners[0]: expected 3 numbers, got a list of 2"));
  EXPECT_THAT(tags("  - {id: 6, corners: [[0, 0, .inf], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}\n"),
              HasSubstr("tags[1].corners[0][2]: expected a finite number, got '.inf'"));
  EXPECT_THAT(tags("  - {id: 6, corner: " + kTag + "}\n"), HasSubstr("did you mean 'corners'?"));
  EXPECT_THAT(tags("", "tag36h111"),
              HasSubstr("family: expected an AprilTag family, got 'tag36h111'; "
                        "did you mean 'tag36h11'?"));
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: apriltag\nfamily: tag16h5\ntags: []\n"),
              HasSubstr("tags: expected at least one tag"));
}

TEST(Target, RefusesTagsThatAreNoQuadrangles) {
  const char* bad[] = {
      "[[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]",  // one point
      "[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]",  // a line
      "[[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]]",  // a corner twice
      "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]",  // crossed
  };
  for (const char* corners : bad) {
    EXPECT_THAT(ErrorOf("plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n  - {id: 0, "
                        "corners: " +
                        std::string(corners) + "}\n"),
                HasSubstr(".yaml:5:22: tags[0].corners: the corners of tag 0 coincide"))
        << corners;
  }
}

TEST(Target, RefusesWrongGrids) {
  EXPECT_THAT(ErrorOf(kGrid + "border_bits: 3\n"), HasSubstr("expected 1, or 2 as Kalibr prints"));
  EXPECT_THAT(ErrorOf(kGrid + "first_id: 582\n"),
              HasSubstr("first_id: expected an id of tag36h11, 0 to 586, got 587"));
  EXPECT_THAT(ErrorOf(kGrid + "first_id: -1\n"), HasSubstr("got -1"));
  EXPECT_THAT(ErrorOf(kGrid + "first_id: 2147483647\n"), HasSubstr("got 2147483647"));
}

TEST(Target, RefusesWrongCharucoBoards) {
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

TEST(Target, RefusesUnknownCirclePatterns) {
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: circles\ncolumns: 4\nrows: 3\nspacing: 0.02\n"
                      "pattern: asymetric\n"),
              HasSubstr(".yaml:6:10: pattern: expected symmetric or asymmetric, got 'asymetric'; "
                        "did you mean 'asymmetric'?"));
}

TEST(Target, RefusesWrongMarkersAndSigmas) {
  EXPECT_THAT(ErrorOf(kChess + "markers: {12: [0, 0, 0]}\n"),
              HasSubstr(".yaml:6:15: markers.12: this target has no such marker"));
  EXPECT_THAT(ErrorOf(kChess + "markers: {-1: [0, 0, 0]}\n"),
              HasSubstr("a marker's number as key"));
  EXPECT_THAT(ErrorOf(kChess + "markers: {x: [0, 0, 0]}\n"), HasSubstr("a marker's number as key"));
  EXPECT_THAT(ErrorOf(kChess + "markers:\n  1: [0, 0, 0]\n  01: [0, 0, 0]\n"),
              HasSubstr("marker 1 stands in line "));
  EXPECT_THAT(ErrorOf(kChess + "markers: {1: [0, 0]}\n"), HasSubstr("expected 3 numbers"));
  EXPECT_THAT(ErrorOf(kChess + "sigma: {1: [0, 0, 0]}\n"),
              HasSubstr(".yaml:6:12: sigma.1: a sigma needs its marker"));
  EXPECT_THAT(ErrorOf(kChess + "markers: {1: [0, 0, 0]}\nsigma: {1: [0, 0, -1]}\n"),
              HasSubstr("got a negative number"));
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: markers\n"), HasSubstr("markers: this key is missing"));
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: markers\nmarkers: {}\n"), HasSubstr("expected markers"));
}

TEST(Target, ReadsTheSimulatedTarget) {
  const std::filesystem::path path =
      std::filesystem::path(PLENOCAL_SHARED_DATA) / "sim_small" / "target.yaml";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is absent";
  const Target target = ReadTarget(path);
  EXPECT_EQ(std::get<TagLayout>(target.layout).ids.size(), 63u);
  EXPECT_EQ(target.markers.size(), 252u);
  EXPECT_EQ(target.tolerance, 0.0005);
  ExpectAt(target, 4 * 62 + 3, 0.190614, -0.001694, 0.224464);
}

}  // namespace
}  // namespace plenocal
