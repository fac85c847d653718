// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "calib/io/yaml.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"
#include "tests/targets/pattern.h"

namespace plenocal::internal {
namespace TEST_FILE {

const cv::Mat kNoImage;

/// A view of the target's plane z = 0, with perspective: px of the image by metres of the target.
Eigen::Matrix3d Camera() {
  Eigen::Matrix3d H;
  H << 900, 60, 300, -40, 950, 200, 0.3, 0.2, 1;
  return H;
}

/// The markers of a target as an image shows them.
std::vector<Observation> Seen(const Target& target) {
  std::vector<Observation> found;
  for (const auto& [number, at] : target.markers) {
    const Eigen::Vector2d image = (Camera() * Eigen::Vector3d(at.x(), at.y(), 1)).hnormalized();
    found.push_back({.marker = number, .values = {image.x(), image.y()}});
  }
  return found;
}

Target TargetOf(const std::string& keys) {
  return ReadTarget(YamlNode::Parse(std::string("plenocal: 1\n").append(keys), "target.yaml"));
}

/// Cells of a template at a point of the target.
Eigen::Vector2d Cells(const MarkerTemplate& marker, const Eigen::Vector2d& on_target) {
  const Eigen::Vector2d image =
      (Camera() * Eigen::Vector3d(on_target.x(), on_target.y(), 1)).hnormalized();
  return (marker.cells_by_image * image.homogeneous()).hnormalized();
}

/// Value of a template without blur at a point of its cells, -1 black to 1 white.
float Value(const MarkerTemplate& marker, const Eigen::Vector2d& cells) {
  CellTemplate drawing = std::get<CellTemplate>(marker.pattern);
  Lanes x{}, y{};
  x[0] = static_cast<float>(cells.x());
  y[0] = static_cast<float>(cells.y());
  CellTemplate::Drawn drawn;
  drawing.Draw(Eigen::Matrix3f::Identity(), 0.05f, 0, x, y, &drawn);
  return drawn.value[0];
}

TEST(MakeMarkerTemplates, HaveTheSquaresOfAChessboardAroundEachCorner) {
  constexpr double kSquare = 0.03;
  const Target target = TargetOf("type: chessboard\ncolumns: 7\nrows: 5\nsquare: 0.03\n");
  const auto templates = MakeMarkerTemplates(target, Seen(target), kNoImage);
  ASSERT_EQ(templates.size(), 35u);
  float colour = 0;  // of the square to the lower right of the first corner
  for (const MarkerTemplate& marker : templates) {
    const Eigen::Vector2d corner = target.markers.at(marker.marker).head<2>();
    EXPECT_LT((Cells(marker, corner) - Eigen::Vector2d(3, 3)).norm(), 1e-9);
    EXPECT_LT(
        (Cells(marker, corner + Eigen::Vector2d(kSquare, -kSquare)) - Eigen::Vector2d(4, 2)).norm(),
        1e-5);
    for (const double dx : {-0.5, 0.5}) {
      for (const double dy : {-0.5, 0.5}) {
        const float value =
            Value(marker, Cells(marker, corner + kSquare * Eigen::Vector2d(dx, dy)));
        EXPECT_NEAR(std::abs(value), 1, 1e-3);
        if (colour == 0) colour = value;
        EXPECT_NEAR(value, dx * dy > 0 ? colour : -colour, 1e-3);
      }
    }
  }
}

TEST(MakeMarkerTemplates, LeaveOutMarkersWithoutNeighbours) {
  const Target target = TargetOf("type: chessboard\ncolumns: 7\nrows: 5\nsquare: 0.03\n");
  std::vector<Observation> found = Seen(target);
  found.resize(3);  // of one row: no homography
  EXPECT_TRUE(MakeMarkerTemplates(target, found, kNoImage).empty());
}

TEST(MakeMarkerTemplates, TakeOnlyWholeTags) {
  const Target target =
      TargetOf("type: aprilgrid\ncolumns: 2\nrows: 2\nsize: 0.05\nspacing: 0.3\n");
  std::vector<Observation> found = Seen(target);
  ASSERT_EQ(found.size(), 16u);
  std::erase_if(found, [](const Observation& seen) { return seen.marker == 6; });
  const auto templates = MakeMarkerTemplates(target, found, kNoImage);
  ASSERT_EQ(templates.size(), 12u);
  for (const MarkerTemplate& marker : templates) {
    EXPECT_NE(marker.marker / 4, 1);
    EXPECT_EQ(marker.part, marker.marker / 4);
    EXPECT_GT(marker.margin, 0);
    // The tag's corners are `margin` cells inside of its pattern.
    const Eigen::Vector2d cells = Cells(marker, target.markers.at(marker.marker).head<2>());
    const int size = std::get<CellTemplate>(marker.pattern).size();
    for (const double place : cells) {
      EXPECT_LT(std::min(std::abs(place - marker.margin), std::abs(size - marker.margin - place)),
                1e-6);
    }
  }
}

// Against the drawing of the target that is printed.
TEST(MakeMarkerTemplates, ArePartsOfTheTargetAsItIsPrinted) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (
      const char* keys :
      {"type: charuco\ncolumns: 5\nrows: 4\nsquare: 0.03\nmarker: 0.02\ndictionary: DICT_4X4_50\n",
       "type: charuco\ncolumns: 4\nrows: 6\nsquare: 0.03\nmarker: 0.024\ndictionary: DICT_6X6_250\n",
       "type: aprilgrid\ncolumns: 3\nrows: 2\nsize: 0.05\nspacing: 0.3\n"}) {
    const Target target = TargetOf(keys);
    const std::vector<TargetPart> parts = DrawTarget(target);
    ASSERT_EQ(parts.size(), 1U);
    const RigidTransform T_target_part = parts[0].T_target_part;
    const auto templates = MakeMarkerTemplates(target, Seen(target), kNoImage);
    EXPECT_EQ(templates.size(), target.markers.size());
    for (const MarkerTemplate& marker : templates) {
      const CellTemplate& pattern = std::get<CellTemplate>(marker.pattern);
      // In units of its lines; of tags without the margin, whose brightness is not known.
      const double first = marker.margin, last = marker.margin > 0 ? pattern.size() - first : 4;
      const Eigen::Matrix3d image_by_cells = marker.cells_by_image.inverse();
      int black = 0, compared = 0;
      for (int i = 0; i < 200; ++i) {
        const double u = first + (last - first) * uniform(random),
                     v = first + (last - first) * uniform(random);
        const float value = Value(marker, {u, v});
        if (std::abs(value) < 0.99F) continue;  // near an edge
        const Eigen::Vector2d image = (image_by_cells * Eigen::Vector3d(u, v, 1)).hnormalized(),
                              on_target = (Camera().inverse() * image.homogeneous()).hnormalized();
        const Eigen::Vector3d on_part =
            T_target_part.Inverse() * Eigen::Vector3d(on_target.x(), on_target.y(), 0);
        EXPECT_EQ(value < 0, plenocal::testing::IsBlack(parts[0], on_part.head<2>()))
            << marker.marker;
        black += value < 0 ? 1 : 0;
        ++compared;
      }
      EXPECT_GT(compared, 50);
      EXPECT_GT(black, 15);
    }
  }
}

TEST(MakeMarkerTemplates, HaveTheRadiusOfCirclesAsUnit) {
  const Target target =
      TargetOf("type: circles\ncolumns: 5\nrows: 4\nspacing: 0.03\npattern: symmetric\n");
  const auto templates = MakeMarkerTemplates(target, Seen(target), kNoImage);
  ASSERT_EQ(templates.size(), 20u);
  double unit = 0;
  for (const MarkerTemplate& marker : templates) {
    EXPECT_TRUE(std::holds_alternative<DiscTemplate>(marker.pattern));
    const Eigen::Vector2d middle = target.markers.at(marker.marker).head<2>();
    EXPECT_LT(Cells(marker, middle).norm(), 1e-9);
    const double radii = Cells(marker, middle + Eigen::Vector2d(0.03, 0)).norm();
    if (unit == 0) unit = radii;
    EXPECT_NEAR(radii, unit, 1e-6 * unit);
  }
  EXPECT_GT(unit, 2);  // discs do not touch
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
