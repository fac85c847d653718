// SPDX-License-Identifier: Apache-2.0
//
// Drawings against the positions of markers, which come from another formula: a corner is where
// black and white meet, a circle's marker its centre.
#include "targets/target_drawing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "targets/target.h"
#include "tests/refusal.h"
#include "tests/targets/pattern.h"
#include "tests/targets/target_texts.h"

namespace plenocal {
namespace TEST_FILE {

using testing::IsBlack;
using testing::Read;

constexpr double kExact = 1e-9;  // m, far above rounding, far below the finest shape

// Colours along a small circle around a point.
struct Surroundings {
  int changes = 0;   // between black and white
  double black = 0;  // share
};

Surroundings Around(const TargetPart& part, const Eigen::Vector2d& p) {
  constexpr int kSteps = 120;
  Surroundings around;
  const auto is_black = [&](int step) {
    // Not along the edges of a pattern that is parallel to the axes.
    const double angle = 2 * std::numbers::pi * (step + 0.5) / kSteps;
    const double radius = part.finest / 4;
    return IsBlack(part, p + radius * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
  };
  for (int step = 0; step < kSteps; ++step) {
    around.changes += is_black(step) != is_black(step + 1) ? 1 : 0;
    around.black += is_black(step) ? 1.0 / kSteps : 0;
  }
  return around;
}

// The part on whose plane and paper a marker lies, and where.
struct Placed {
  const TargetPart* part = nullptr;
  Eigen::Vector2d at{0, 0};
};

Placed Find(const std::vector<TargetPart>& parts, const Eigen::Vector3d& position) {
  for (const TargetPart& part : parts) {
    const Eigen::Vector3d p = part.T_target_part.Inverse() * position;
    if (std::abs(p.z()) < kExact && part.paper.contains(Eigen::Vector2d(p.head<2>()))) {
      return {&part, p.head<2>()};
    }
  }
  return {};
}

// A corner in a quarter of black or of white, two opposite black quarters, or a disc's centre.
void ExpectMarkersInThePattern(const std::string& text) {
  SCOPED_TRACE(text);
  const Target target = Read(text);
  const std::vector<TargetPart> parts = DrawTarget(target);
  for (const auto& marker : target.markers) {
    const int number = marker.first;
    const Placed placed = Find(parts, marker.second);
    ASSERT_NE(placed.part, nullptr) << "no paper under marker " << number;
    const auto& discs = placed.part->black_discs;
    const auto disc =
        std::find_if(discs.begin(), discs.end(), [&](const Disc& d) { return d.marker == number; });
    if (disc != discs.end()) {
      EXPECT_LT((disc->centre - placed.at).norm(), kExact) << "marker " << number;
      EXPECT_GT(disc->radius, 0);
      continue;
    }
    const Surroundings around = Around(*placed.part, placed.at);
    constexpr double kShare = 0.02;  // two of 120 steps
    if (around.changes == 4) {
      EXPECT_NEAR(around.black, 0.5, kShare) << "marker " << number;
    } else {
      EXPECT_EQ(around.changes, 2) << "marker " << number;
      EXPECT_NEAR(std::abs(around.black - 0.5), 0.25, kShare) << "marker " << number;
    }
  }
}

TEST(TargetDrawing, HasEveryMarkerInThePattern) {
  int drawn = 0;
  for (const TargetType& type : TargetTypes()) {
    const std::string text =
        "plenocal: 1\ntype: " + std::string(type.name) + "\n" + std::string(type.example);
    if (type.name == "markers") continue;  // has no pattern
    ExpectMarkersInThePattern(text);
    ++drawn;
  }
  EXPECT_GE(drawn, 5);
}

TEST(TargetDrawing, HasEveryMarkerInThePatternOfVariants) {
  const std::string start = "plenocal: 1\ntype: ";
  ExpectMarkersInThePattern(start +
                            "circles\ncolumns: 4\nrows: 3\nspacing: 0.02\npattern: symmetric\n");
  const std::string charuco =
      start + "charuco\ncolumns: 6\nrows: 4\nsquare: 0.04\nmarker: 0.03\ndictionary: DICT_4X4_50\n";
  ExpectMarkersInThePattern(charuco);
  ExpectMarkersInThePattern(charuco + "legacy: true\n");
  for (const std::string family : {"tag16h5", "tag25h9", "tagStandard41h12", "tagCircle21h7"}) {
    ExpectMarkersInThePattern(
        start +
        "aprilgrid\ncolumns: 3\nrows: 2\nsize: 0.08\nspacing: 0.5\nborder_bits: 1\nfamily: " +
        family + "\n");
  }
}

TEST(TargetDrawing, ListsTagsAndSquares) {
  const auto parts_of = [](const std::string& keys) {
    return DrawTarget(Read("plenocal: 1\ntype: " + keys));
  };
  const auto boards = {parts_of("chessboard\ncolumns: 6\nrows: 5\nsquare: 0.03\n"),
                       parts_of("charuco\ncolumns: 7\nrows: 6\nsquare: 0.03\nmarker: 0.02\n"
                                "dictionary: DICT_4X4_50\n")};
  double first = 0;  // of the chessboard; of the ChArUco board one square
  for (const auto& board : boards) {
    ASSERT_EQ(board.size(), 1u);
    ASSERT_TRUE(board[0].squares.has_value());
    EXPECT_EQ(board[0].squares->columns, 6);
    EXPECT_EQ(board[0].squares->rows, 5);
    EXPECT_EQ(board[0].squares->pitch, 0.03);
    EXPECT_EQ(board[0].squares->first, first);
    EXPECT_TRUE(board[0].one_sheet);
    first += 0.03;
  }
  // The outlines of tags, apart or together, are where the markers are.
  const Target grid =
      Read("plenocal: 1\ntype: aprilgrid\ncolumns: 2\nrows: 2\nsize: 0.08\nspacing: 0.3\n");
  const std::vector<TargetPart> together = DrawTarget(grid);
  ASSERT_EQ(together.size(), 1u);
  EXPECT_EQ(together[0].label, "tag36h11");
  ASSERT_EQ(together[0].tags.size(), 4u);
  const std::vector<TargetPart> apart = DrawTarget(grid, Pieces::kApart);
  ASSERT_EQ(apart.size(), 4u);
  for (const std::vector<TargetPart>& parts : {together, apart}) {
    for (const TargetPart& part : parts) {
      for (const DrawnTag& tag : part.tags) {
        for (int k = 0; k < 4; ++k) {
          Eigen::Vector3d p(0, 0, 0);
          p.head<2>() = tag.outline[static_cast<size_t>(k)];
          EXPECT_LT((part.T_target_part * p - grid.markers.at(4 * tag.id + k)).norm(), kExact);
        }
      }
    }
  }
}

// Their side is the gap to the nearest tag, or 0.3 of the tag's side where there is no other.
TEST(TargetDrawing, FillsTheGapsBetweenTagsWithSquares) {
  constexpr double kSide = 0.1;
  const auto black_to = [&](const std::vector<double>& places) {
    Target target;
    TagLayout layout{
        .family = "tag36h11", .border_bits = 2, .black_corner_squares = true, .ids = {}};
    for (size_t i = 0; i < places.size(); ++i) {
      const int id = static_cast<int>(i);
      layout.ids.push_back(id);
      const Eigen::Vector3d corner(places[i], 0, 0);
      target.markers[4 * id] = corner;
      target.markers[4 * id + 1] = corner + Eigen::Vector3d(kSide, 0, 0);
      target.markers[4 * id + 2] = corner + Eigen::Vector3d(kSide, kSide, 0);
      target.markers[4 * id + 3] = corner + Eigen::Vector3d(0, kSide, 0);
    }
    target.layout = layout;
    const std::vector<TargetPart> parts = DrawTarget(target);
    // Beyond the lower left corner of the first tag.
    double last = 0;
    for (double away = 0.0005; away < kSide; away += 0.001) {
      const Placed at = Find(parts, {places[0] - away, -away, 0});
      if (at.part != nullptr && IsBlack(*at.part, at.at)) last = away;
    }
    return last;
  };
  EXPECT_NEAR(black_to({0}), 0.3 * kSide, 0.001);
  EXPECT_NEAR(black_to({0, 0.12}), 0.02, 0.001);
  EXPECT_NEAR(black_to({0, 0.25, 0.14}), 0.04, 0.001);
}

TEST(TargetDrawing, PutsTagsOfEachPlaneOnAPart) {
  // Two in the plane z = 0, one across.
  const Target target = Read(
      "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n"
      "  - {id: 0, corners: [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]}\n"
      "  - {id: 1, corners: [[0.2, 0, 0], [0.3, 0, 0], [0.3, 0.1, 0], [0.2, 0.1, 0]]}\n"
      "  - {id: 5, corners: [[1, 0, 0], [1.1, 0, 0], [1.1, 0, 0.1], [1, 0, 0.1]]}\n");
  const std::vector<TargetPart> parts = DrawTarget(target);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].tags.size(), 2u);
  ASSERT_EQ(parts[1].tags.size(), 1u);
  EXPECT_EQ(parts[1].tags[0].id, 5);
  EXPECT_FALSE(parts[0].one_sheet);
  // z points away from the viewer, who sees the corners counterclockwise: towards -y here.
  EXPECT_NEAR(parts[1].T_target_part.R.col(2).y(), 1, kExact);
}

TEST(TargetDrawing, RefusesPointsWithoutAPattern) {
  const Target target = Read("plenocal: 1\ntype: markers\nmarkers: {0: [0, 0, 0]}\n");
  EXPECT_THAT(testing::RefusalOf([&] { DrawTarget(target); }),
              ::testing::HasSubstr("cannot be drawn"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
