// SPDX-License-Identifier: Apache-2.0
#include "assess/pose_spread.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// A camera of 600 x 600 px, and a target of 2 x 2 points that each image shows anywhere.
class PoseSpreadOfImages : public ::testing::Test {
 protected:
  PoseSpreadOfImages() {
    CalibratedCamera camera;
    camera.name = "cam";
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {600, 600};
    camera.params = {500, 500, 299.5, 299.5};
    record_.cameras.push_back(camera);
    for (int k = 0; k < 4; ++k) {
      record_.markers[k].position = {
          0.2 * (k % 2) - 0.1, 0.2 * static_cast<double>(k / 2) - 0.1, 0};
    }
  }

  // An image with points at these ninths of the image, column and row.
  void AddImage(const RigidTransform& T_camera_target,
                const std::vector<std::array<int, 2>>& ninths,
                bool used = true) {
    const int frame = static_cast<int>(record_.frames.size());
    record_.frames.push_back({"frame", T_camera_target.Inverse()});
    for (const auto& [column, row] : ninths) {
      for (int k = 0; k < 4; ++k) {
        record_.cameras[0].residuals.push_back(
            {.frame = frame,
             .marker = k,
             .values = {200.0 * column + 50 + 100 * (k % 2), 200.0 * row + 50 + 100 * (k / 2)},
             .residual = {0, 0},
             .used = used});
      }
    }
  }

  [[nodiscard]] PoseSpread Measured() const { return MeasurePoseSpread(record_, 0); }

  static RigidTransform Facing(double distance, double degrees = 0) {
    return {ExpRotation({0, degrees * std::numbers::pi / 180, 0}), {0, 0, distance}};
  }

  CalibrationRecord record_;
};

const std::vector<std::array<int, 2>> kAll{
    {0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}, {0, 2}, {1, 2}, {2, 2}};

TEST_F(PoseSpreadOfImages, WithoutAUsedPointIsNone) {
  AddImage(Facing(1), kAll, false);
  EXPECT_FALSE(Measured().any);
}

TEST_F(PoseSpreadOfImages, NamesThePartsWithoutPoints) {
  AddImage(Facing(1), {{1, 0}, {0, 1}, {1, 1}});
  AddImage(Facing(1), kAll, false);
  EXPECT_THAT(Measured().empty,
              ElementsAre("upper left corner",
                          "upper right corner",
                          "right edge",
                          "lower left corner",
                          "lower edge",
                          "lower right corner"));
  AddImage(Facing(1), kAll);
  EXPECT_THAT(Measured().empty, IsEmpty());
}

TEST_F(PoseSpreadOfImages, LeavesOutWhatIsOutsideOfTheImageCircle) {
  AddImage(Facing(1), {{1, 0}, {0, 1}, {1, 1}, {2, 1}, {1, 2}});
  const double coverage = Measured().coverage;
  EXPECT_EQ(Measured().empty.size(), 4);
  record_.cameras[0].image_circle = ImageCircle{.centre = {299.5, 299.5}, .radii = {150, 150}};
  EXPECT_THAT(Measured().empty, IsEmpty());
  // 4 points in each ninth of 11.1 cells, of 100; in the circle 68 cells and the middle's points.
  EXPECT_NEAR(coverage, 0.2, 0.01);
}

TEST_F(PoseSpreadOfImages, CountsTheCellsWithPoints) {
  AddImage(Facing(1), kAll);
  EXPECT_NEAR(Measured().coverage, 0.36, 1e-12);  // 4 of 100 cells for each ninth
}

TEST_F(PoseSpreadOfImages, IsOfThePartOfTheImage) {
  AddImage(Facing(1), {{0, 0}});
  PoseSpread spread = Measured();
  EXPECT_NEAR(spread.left, 50.5 / 600, 1e-9);
  EXPECT_NEAR(spread.right, 150.5 / 600, 1e-9);
  EXPECT_EQ(spread.Region(), "the upper left corner");
  EXPECT_NEAR(spread.Margin(), 1 - 150.5 / 600, 1e-9);
  AddImage(Facing(1), {{0, 2}});
  EXPECT_EQ(Measured().Region(), "the left half");
  AddImage(Facing(1), {{2, 2}});
  EXPECT_EQ(Measured().Region(), "");
  EXPECT_NEAR(Measured().Margin(), 50.5 / 600, 1e-3);
  record_.cameras[0].residuals.clear();
  AddImage(Facing(1), {{2, 2}});
  EXPECT_EQ(Measured().Region(), "the lower right corner");
  AddImage(Facing(1), {{0, 2}});
  EXPECT_EQ(Measured().Region(), "the lower half");
  record_.cameras[0].residuals.clear();
  AddImage(Facing(1), {{2, 0}, {2, 2}});
  EXPECT_EQ(Measured().Region(), "the right half");
  record_.cameras[0].residuals.clear();
  AddImage(Facing(1), {{0, 0}, {2, 0}});
  EXPECT_EQ(Measured().Region(), "the upper half");
  record_.cameras[0].residuals.clear();
  AddImage(Facing(1), {{1, 1}});
  EXPECT_EQ(Measured().Region(), "the middle");
}

TEST_F(PoseSpreadOfImages, HasTheNearestAndFarthestImage) {
  AddImage(Facing(2), kAll);
  AddImage(Facing(1), kAll);
  AddImage(Facing(3), kAll);
  const double beside = 0.1 * 0.1 + 0.1 * 0.1;  // of each point
  EXPECT_NEAR(Measured().nearest, std::sqrt(1 + beside), 1e-9);
  EXPECT_NEAR(Measured().farthest, std::sqrt(9 + beside), 1e-9);
}

TEST_F(PoseSpreadOfImages, OfOneDepthIsOneDistance) {
  // The same plane beside the axis is farther away.
  for (const double x : {0.0, 2.0}) AddImage({Eigen::Matrix3d::Identity(), {x, 0, 1}}, kAll);
  EXPECT_NEAR(Measured().nearest, 1, 1e-9);
  EXPECT_NEAR(Measured().farthest, 1, 1e-9);
  // On a sphere about the camera it is one distance at several depths.
  record_.frames.clear();
  record_.cameras[0].residuals.clear();
  for (const double angle : {0.0, 1.0}) {
    AddImage({ExpRotation({0, angle, 0}), ExpRotation({0, angle, 0}) * Eigen::Vector3d(0, 0, 2)},
             kAll);
  }
  EXPECT_NEAR(Measured().farthest / Measured().nearest, 1, 1e-6);
}

TEST_F(PoseSpreadOfImages, HasTheLargestTiltBetweenTwoImages) {
  for (const double degrees : {-20.0, 5.0, 30.0}) AddImage(Facing(1, degrees), kAll);
  const PoseSpread spread = Measured();
  EXPECT_TRUE(spread.is_plane);
  EXPECT_NEAR(spread.tilt, 50, 1e-6);
  // The mean of the three normals leans by about 5 degrees.
  EXPECT_NEAR(spread.lean, 5, 0.3);
  // Seen from behind it is the same face: its normal leads away from the camera.
  AddImage({ExpRotation({0, std::numbers::pi, 0}), {0, 0, 1}}, kAll);
  EXPECT_NEAR(Measured().tilt, 50, 1e-6);
}

TEST_F(PoseSpreadOfImages, OfATargetInSpaceIsThatOfTheDirectionsFromWhichItIsSeen) {
  record_.markers[0].position.z() = 0.2;
  for (const double degrees : {0.0, 90.0, 180.0}) AddImage(Facing(1, degrees), kAll);
  EXPECT_FALSE(Measured().is_plane);
  EXPECT_NEAR(Measured().tilt, 180, 1e-6);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
