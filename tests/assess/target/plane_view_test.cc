// SPDX-License-Identifier: Apache-2.0
#include "assess/target/plane_view.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <map>
#include <string>
#include <vector>

#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

/// A board of 4 x 3 points, 10 px apart in the image, less those from `count` on.
View BoardView(const std::string& frame, int count) {
  View view{.frame = frame, .observations = {}};
  for (int i = 0; i < count; ++i) {
    view.observations.push_back(
        {.marker = i, .values = {50.0 + 10 * (i % 4), 30.0 + 10 * (i / 4)}});
  }
  return view;
}

TEST(PlaneViews, AreThoseWithMostPoints) {
  CameraInput camera;
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.image_size = {101, 81};
  for (const auto& [frame, count] :
       {std::pair("a", 7), {"b", 12}, {"c", 5}, {"d", 12}, {"e", 10}}) {
    camera.views.push_back(BoardView(frame, count));
  }
  const std::vector<PlaneView> views = MakePlaneViews(camera, 4, 7);
  ASSERT_EQ(views.size(), 4U) << "five points are too few";
  std::vector<size_t> counts;
  for (const PlaneView& view : views) counts.push_back(view.points.size());
  EXPECT_EQ(counts, (std::vector<size_t>{12, 12, 10, 7}));
  EXPECT_EQ(MakePlaneViews(camera, 3, 7).size(), 3U);
  EXPECT_EQ(views[0].points[5].marker, 5);
  EXPECT_EQ(views[0].points[5].image, Eigen::Vector2d(60, 40));
  EXPECT_EQ(views[0].spacing, 10);
  EXPECT_EQ(views[0].centre, Eigen::Vector2d(50, 40));
  EXPECT_DOUBLE_EQ(views[0].radius, std::hypot(50, 40));
}

TEST(PlaneViews, OfAPlenopticCameraHaveVirtualImagePoints) {
  const Eigen::Vector2d p(207, 153);
  CameraInput camera;
  camera.model = FindModel(CameraModels(), "focused-plenoptic");
  camera.image_size = {400, 300};
  // Markers 1 to 3 at virtual depths 3, -4 and 60, which is too far away; 4 in two micro images.
  View view{.frame = "a", .observations = {}};
  const std::vector<Eigen::Vector2d> centres{{200, 150}, {220, 150}, {210, 167}, {190, 167}};
  for (int marker = 1; marker <= 4; ++marker) {
    const double v = marker == 1 ? 3 : marker == 2 ? -4 : marker == 3 ? 60 : 3;
    for (size_t i = 0; i < (marker == 4 ? 2U : centres.size()); ++i) {
      const Eigen::Vector2d x = centres[i] + (p - centres[i]) / v;
      view.observations.push_back(
          {.marker = marker, .values = {x.x(), x.y(), centres[i].x(), centres[i].y()}});
    }
  }
  camera.views = {view};
  const std::vector<PlaneView> views = MakePlaneViews(camera, 5, 1);
  ASSERT_EQ(views.size(), 1U);
  ASSERT_EQ(views[0].points.size(), 2U);
  for (const PlanePoint& point : views[0].points) {
    EXPECT_LE(point.marker, 2);
    EXPECT_LT((point.image - p).norm(), 1e-9);
  }
}

TEST(MarkerPlane, IsThroughTheMarkers) {
  const RigidTransform T{Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 0.5).normalized()).matrix(),
                         {0.3, -0.2, 1}};
  std::map<int, Eigen::Vector3d> markers;
  for (int i = 0; i < 20; ++i) {
    // Bent by a hundredth of its width.
    const double x = 0.05 * (i % 5), y = 0.04 * (i / 5);
    markers[3 * i] = T * Eigen::Vector3d(x, y, 0.002 * (i % 2));
  }
  const std::optional<MarkerPlane> plane = FindPlane(markers);
  ASSERT_TRUE(plane);
  EXPECT_NEAR(plane->extent, std::hypot(0.1, 0.06), 1e-4);
  EXPECT_LT(((*plane)(plane->middle)).norm(), 1e-12);
  for (const auto& [a, p] : markers) {
    for (const auto& [b, q] : markers) {
      EXPECT_NEAR(((*plane)(p) - (*plane)(q)).norm(), (p - q).norm(), 1e-4) << "lengths stay";
    }
  }
  // Its first axis is along the longer side.
  EXPECT_GT(std::abs(plane->x.dot(T.R.col(0))), 0.99);
  markers[99] = T * Eigen::Vector3d(0.1, 0.06, 0.1);
  EXPECT_FALSE(FindPlane(markers)) << "a marker stands out";
}

TEST(MarkerPlane, NeedsFourMarkersThatAreOnNoLine) {
  std::map<int, Eigen::Vector3d> markers{{1, {0, 0, 0}}, {2, {1, 0, 0}}, {3, {0, 1, 0}}};
  EXPECT_FALSE(FindPlane(markers));
  markers[4] = {1, 1, 0};
  EXPECT_TRUE(FindPlane(markers));
  EXPECT_FALSE(FindPlane({{1, {0, 0, 0}}, {2, {1, 0, 0}}, {3, {2, 0, 0}}, {4, {3, 0, 0}}}));
}

}  // namespace TEST_FILE
}  // namespace plenocal
