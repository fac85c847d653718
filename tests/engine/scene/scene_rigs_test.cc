// SPDX-License-Identifier: Apache-2.0
//
// Scenes that two cameras see: a pair of known extrinsics gives the scale, tracks that look alike
// give the start of extrinsics.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "engine/scene/scene_calibration.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::Not;

constexpr double kFocal = 600;  // px
constexpr int kPoints = 30;
const RigidTransform kRight{ExpRotation({0.01, 0.1, -0.02}), {-0.5, 0.02, 0.05}};

std::vector<Eigen::Vector3d> Points() {
  Random random(4);
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < kPoints; ++k) points.push_back(random.Uniforms<3>(-1, 1));
  return points;
}

// Numbers of the right camera's tracks are `offset` larger.
SceneCalibrationInput Pair(bool known, int offset) {
  Random random(6);
  SceneCalibrationInput input{.cameras = {}, .distances = {}};
  const std::vector<Eigen::Vector3d> points = Points();
  for (int c = 0; c < 2; ++c) {
    CameraInput& camera = input.cameras.inputs.emplace_back();
    camera.name = c == 0 ? "left" : "right";
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.initial = {kFocal, kFocal, 320, 240};
    camera.fixed.assign(4, true);
    camera.image_size = {640, 480};
    for (int frame = 0; frame < 4; ++frame) {
      // Turns about the scene alone would leave the right camera's distances open.
      const double angle = 0.2 * frame;
      const RigidTransform T{ExpRotation({0.3 * std::sin(3 * angle), angle, 0.2 * angle}),
                             {0.3 - 0.25 * frame, 0.2 * std::sin(2.0 * frame), 4 + 0.2 * frame}};
      View& view = camera.views.emplace_back();
      view.frame = std::to_string(frame);
      for (int k = 0; k < kPoints; ++k) {
        const Eigen::Vector3d at = T * points[static_cast<size_t>(k)];
        const Eigen::Vector3d p = c == 0 ? at : kRight * at;
        Observation& seen = view.observations.emplace_back();
        seen.marker = k + (c == 0 ? 0 : offset);
        seen.values = {320 + kFocal * p.x() / p.z() + random.Gaussian(0.05),
                       240 + kFocal * p.y() / p.z() + random.Gaussian(0.05)};
        seen.detector_sigma = 0.05;
      }
    }
    input.cameras.without_sigmas.push_back(false);
    input.cameras.fixed_extrinsics.push_back(known);
    input.cameras.T_camera_rig.emplace_back(
        known ? std::optional(c == 0 ? RigidTransform{} : kRight) : std::nullopt);
  }
  return input;
}

double Apart(const Calibration& calibration, int a, int b) {
  const auto position = [&](int number) {
    return std::ranges::find(calibration.bundle.markers, number, &BundleMarker::number)->position;
  };
  return (position(a) - position(b)).norm();
}

std::vector<std::string> CodesOf(const Calibration& calibration) {
  std::vector<std::string> codes;
  for (const Finding& each : calibration.findings) codes.push_back(each.code);
  return codes;
}

TEST(SceneRigs, OfKnownExtrinsicsHaveTheScale) {
  const Calibration found = CalibrateScene(Pair(true, 0), {});
  EXPECT_EQ(found.bundle.markers.size(), static_cast<size_t>(kPoints));
  EXPECT_FALSE(found.bundle.scale_distance);
  EXPECT_THAT(CodesOf(found), Not(Contains("scene_no_scale")));
  const std::vector<Eigen::Vector3d> points = Points();
  EXPECT_NEAR(Apart(found, 3, 9), (points[3] - points[9]).norm(), 0.01);
  EXPECT_TRUE(found.bundle.cameras[1].is_master);
  EXPECT_LT((found.bundle.cameras[1].T_camera_rig.t - kRight.t).norm(), 1e-12);
}

TEST(SceneRigs, TracksThatLookAlikeStartTheExtrinsics) {
  SceneCalibrationInput input = Pair(false, 1000);
  for (int k = 0; k < kPoints; ++k) input.alike.emplace_back(1000 + k, k);
  const Calibration found = CalibrateScene(input, {});
  // Points of both cameras stay points of their own.
  EXPECT_EQ(found.bundle.markers.size(), static_cast<size_t>(2 * kPoints));
  EXPECT_TRUE(found.bundle.scale_distance);
  EXPECT_EQ(CodesOf(found).front(), "scene_no_scale");
  EXPECT_EQ(found.findings.front().grade, Grade::kBad);
  const std::vector<Eigen::Vector3d> points = Points();
  const double scale = Apart(found, 3, 9) / (points[3] - points[9]).norm();
  const RigidTransform& right = found.bundle.cameras[1].T_camera_rig;
  EXPECT_LT(LogRotation(right.R * kRight.R.transpose()).norm(), 0.01);
  EXPECT_LT((right.t / scale - kRight.t).norm(), 0.05);
  EXPECT_NEAR(Apart(found, 1003, 1009) / Apart(found, 3, 9), 1, 0.02);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
