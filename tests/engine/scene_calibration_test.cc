// SPDX-License-Identifier: Apache-2.0
//
// Calibration of a camera from tracks of scene points without nominal positions.
#include "engine/scene/scene_calibration.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kFocal = 600, kNoise = 0.2;  // px
constexpr int kPoints = 40, kFrames = 8;

std::vector<Eigen::Vector3d> Scene() {
  Random random(4);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < kPoints; ++i) {
    points.emplace_back(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1));
  }
  return points;
}

// Images of 640 x 480 px from places around the scene, 4 m away.
SceneCalibrationInput Input() {
  Random random(5);
  CameraInput camera{.name = "left",
                     .model = FindModel(CameraModels(), "pinhole"),
                     .config = {},
                     .initial = {550, 550, 320, 240},
                     .fixed = std::vector<bool>(4, false),
                     .image_size = {640, 480},
                     .views = {}};
  for (int frame = 0; frame < kFrames; ++frame) {
    const double angle = 0.12 * frame;
    const RigidTransform T_camera_scene{
        ExpRotation({0.4 * std::sin(2 * angle), angle, 0.3 * std::cos(3 * angle)}), {0, 0, 4}};
    View& view = camera.views.emplace_back();
    view.frame = std::to_string(100 + frame);
    const std::vector<Eigen::Vector3d> points = Scene();
    for (int i = 0; i < kPoints; ++i) {
      const Eigen::Vector3d p = T_camera_scene * points[static_cast<size_t>(i)];
      Observation& seen = view.observations.emplace_back();
      seen.marker = i;
      seen.values[0] = 320 + kFocal * p.x() / p.z() + random.Gaussian(kNoise);
      seen.values[1] = 240 + kFocal * p.y() / p.z() + random.Gaussian(kNoise);
      seen.detector_sigma = kNoise;
    }
  }
  return {.cameras = {.inputs = {camera},
                      .T_camera_rig = {std::nullopt},
                      .fixed_extrinsics = {false},
                      .prior = {},
                      .without_sigmas = {false}},
          .distances = {}};
}

SceneDistance Between(int a, int b, double length) {
  return {.a = {"point " + std::to_string(a), {a}},
          .b = {"point " + std::to_string(b), {b}},
          .length = length,
          .sigma = 1e-3,
          .place = YamlNode::Parse("a: 1", "session.yaml").At("a")};
}

double Distance(const Calibration& calibration, int a, int b) {
  const auto position = [&](int number) {
    return std::ranges::find(calibration.bundle.markers, number, &BundleMarker::number)->position;
  };
  return (position(a) - position(b)).norm();
}

TEST(SceneCalibrations, WithoutDistancesHaveParametersAndNoScale) {
  const Calibration found = CalibrateScene(Input(), {});
  const BundleCamera& camera = found.bundle.cameras[0];
  const double sigma = found.uncertainty.param_std_errors[0][0];
  EXPECT_LT(std::abs(camera.params[0] - kFocal), 4 * sigma);
  EXPECT_LT(sigma, 10);
  EXPECT_EQ(found.frames.size(), static_cast<size_t>(kFrames));
  EXPECT_TRUE(found.bundle.scale_distance);
  EXPECT_TRUE(std::ranges::any_of(
      found.findings, [](const Finding& each) { return each.code == "scene_no_scale"; }));
}

TEST(SceneCalibrations, TakeTheScaleFromADistance) {
  const std::vector<Eigen::Vector3d> points = Scene();
  SceneCalibrationInput input = Input();
  input.distances = {Between(3, 35, (points[3] - points[35]).norm())};
  const Calibration found = CalibrateScene(input, {});
  EXPECT_FALSE(found.bundle.scale_distance);
  EXPECT_NEAR(Distance(found, 5, 30), (points[5] - points[30]).norm(), 0.02);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
