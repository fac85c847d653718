// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/view_target.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "calib/io/yaml.h"
#include "targets/target.h"

namespace plenocal {
namespace TEST_FILE {

TEST(MakeViewTarget, OfABoardHasItsPaperAndAThirdOfASquare) {
  const Target target = TargetOfWord("chessboard:9x6:30mm");
  const ViewTarget board = MakeViewTarget(target);
  EXPECT_EQ(board.markers.size(), 54U);
  EXPECT_EQ(board.normals.size(), 54U);
  EXPECT_NEAR(board.finest, 0.01, 1e-12);
  EXPECT_FALSE(board.found_in_part);
  ASSERT_EQ(board.outlines.size(), 1U);
  ASSERT_EQ(board.outlines[0].size(), 4U);
  // Around all corners of its squares, by a square and more.
  Eigen::AlignedBox3d paper, corners;
  for (const Eigen::Vector3d& p : board.outlines[0]) paper.extend(p);
  for (const auto& [number, p] : target.markers) corners.extend(p);
  EXPECT_TRUE((corners.min().head<2>() - paper.min().head<2>()).minCoeff() >= 0.03 - 1e-9);
  EXPECT_TRUE((paper.max().head<2>() - corners.max().head<2>()).minCoeff() >= 0.03 - 1e-9);
}

TEST(MakeViewTarget, IsFoundInPartByTags) {
  const ViewTarget tags = MakeViewTarget(TargetOfWord("aprilgrid:6x6:80mm:0.3"));
  EXPECT_TRUE(tags.found_in_part);
  // Six bits to a side of tag36h11, and a border of two around them.
  EXPECT_NEAR(tags.finest, 0.08 / 10, 1e-9);
  const ViewTarget charuco = MakeViewTarget(TargetOfWord("charuco:5x7:36mm:22mm:6X6_250"));
  EXPECT_TRUE(charuco.found_in_part);
  EXPECT_LT(charuco.finest, 0.022 / 6 + 1e-9);
  const ViewTarget circles = MakeViewTarget(TargetOfWord("circles:8x6:25mm"));
  EXPECT_FALSE(circles.found_in_part);
  EXPECT_LT(circles.finest, 0.025 / 6);
}

TEST(MakeViewTarget, OfMarkersAloneHasNoPaper) {
  const ViewTarget markers = MakeViewTarget(ReadTarget(YamlNode::Parse(
      "plenocal: 1\ntype: markers\nmarkers:\n  1: [0, 0, 0]\n  2: [1, 0, 0]\n  3: [0, 1, 0]\n",
      "target.yaml")));
  EXPECT_EQ(markers.markers.size(), 3U);
  EXPECT_TRUE(markers.outlines.empty());
  EXPECT_EQ(markers.finest, 0);
  EXPECT_EQ(markers.normals.at(2), Eigen::Vector3d::Zero()) << "visible from everywhere";
}

}  // namespace TEST_FILE
}  // namespace plenocal
