// SPDX-License-Identifier: Apache-2.0
#include "assess/space/points_before_image.h"

#include <gmock/gmock.h>

#include <vector>

#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

// A pair of pinhole cameras 0.2 m apart.
SpaceRig Pair() {
  SpaceRig rig;
  for (const double x : {0.0, -0.2}) {
    rig.cameras.push_back({.name = x == 0 ? "left" : "right",
                           .image_size = {640, 480},
                           .model = FindModel(CameraModels(), "pinhole"),
                           .config = {},
                           .params = {400, 400, 320, 240},
                           .fixed = std::vector<bool>(4, true),
                           .T_camera_rig = {Eigen::Matrix3d::Identity(), {x, 0, 0}}});
  }
  return rig;
}

TEST(PointsBeforeImage, LieOnTheRayAndAreSeenByBoth) {
  const SpaceRig rig = Pair();
  const PointsBeforeImage points(rig, std::vector<MicroLensVisibility>(2));
  const auto X = points.At({420, 160}, 2);
  ASSERT_TRUE(X);
  EXPECT_LT((*X - Eigen::Vector3d(0.5, -0.4, 2)).norm(), 1e-12);
  const std::vector<SpaceObservation> seen = points.Seen(*X);
  ASSERT_EQ(seen.size(), 2U);
  for (size_t c = 0; c < 2; ++c) {
    EXPECT_EQ(seen[c].camera, c);
    EXPECT_NEAR(seen[c].values[0], c == 0 ? 420 : 380, 1e-9);
    EXPECT_NEAR(seen[c].values[1], 160, 1e-9);
  }
  EXPECT_FALSE(points.At({420, 160}, -1)) << "behind";
}

TEST(PointsBeforeImage, AreNoneOutsideOfAnImage) {
  SpaceRig rig = Pair();
  const PointsBeforeImage points(rig, std::vector<MicroLensVisibility>(2));
  // At the left edge of the first image, beyond that of the second.
  EXPECT_TRUE(points.Seen(*points.At({10, 240}, 2)).empty());
  EXPECT_EQ(points.Seen(*points.At({50, 240}, 2)).size(), 2U);
  // A circle of either camera.
  rig.cameras[0].image_circle = ImageCircle{{320, 240}, {100, 100}};
  EXPECT_FALSE(points.At({425, 240}, 2));
  const auto X = points.At({230, 240}, 2);
  ASSERT_TRUE(X);
  EXPECT_EQ(points.Seen(*X).size(), 2U);
  rig.cameras[1].image_circle = ImageCircle{{320, 240}, {100, 100}};
  EXPECT_TRUE(points.Seen(*X).empty()) << "40 px further to the left in the second";
}

TEST(PointsBeforeImage, NeedTheMicroImagesOfAPlenopticCamera) {
  CalibrationRecord record;
  record.path = "c.yaml";
  record.cameras.emplace_back().name = "raw";
  record.cameras[0].model = FindModel(CameraModels(), "focused-plenoptic");
  const SpaceRig rig;
  const auto refusal = [&] {
    return testing::RefusalOf([&] { const PointsBeforeImage points(record, {"raw"}, rig, {}); });
  };
  EXPECT_THAT(refusal(),
              HasSubstr("c.yaml: the micro images of camera 'raw' are not known (no file"));
  record.cameras[0].micro_lenses = "grid.csv";
  EXPECT_THAT(refusal(), HasSubstr("(grid.csv is not beside it)"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
