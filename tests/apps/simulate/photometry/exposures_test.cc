// SPDX-License-Identifier: Apache-2.0
//
// Exposures of a simulated recording, their files, and a wall's light by its formulas.
#include "apps/simulate/photometry/exposures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "apps/simulate/photometry/wall_surface.h"
#include "apps/simulate/spec/random.h"
#include "calib/io/yaml.h"
#include "targets/target.h"
#include "tests/apps/simulate/small_scene.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;
using Eigen::Vector3f;

SimulationSpec Exposed(const ExposureSpec& exposures) {
  SimulationSpec spec = SmallScene();
  spec.scenery.reset();
  spec.exposures = exposures;
  return spec;
}

TEST(SimulatedExposures, RiseInEqualRatiosInASweep) {
  const SimulationSpec spec =
      Exposed({.least = 2, .largest = 32, .sweep = true, .late_camera = {}});
  const Exposures exposures = DrawExposures(spec, 5);
  ASSERT_EQ(exposures.size(), 2u);
  for (const auto& camera : exposures) {
    ASSERT_EQ(camera.size(), 5u);
    for (size_t f = 0; f < 5; ++f) {
      EXPECT_NEAR(camera[f].written, 2 * std::exp2(static_cast<double>(f)), 1e-12);
      EXPECT_EQ(camera[f].exact, camera[f].written);
    }
  }
  EXPECT_EQ(DrawExposures(spec, 1)[0][0].written, 2);
}

TEST(SimulatedExposures, AreCommonToAllCamerasButForErrorsAndLateOnes) {
  const SimulationSpec spec = Exposed({.least = 2,
                                       .largest = 32,
                                       .error = 0.05,
                                       .late_camera = "right",
                                       .late_change = 0.5,
                                       .late_share = 0.3});
  const Exposures exposures = DrawExposures(spec, 40);
  int late = 0;
  for (size_t f = 0; f < 40; ++f) {
    const double written = 2 * std::pow(16, Random(5, "exposure", {f}).Uniform(0, 1));
    for (size_t c = 0; c < 2; ++c) {
      Random random(5, "shutter", {c, f});
      double exact = written * (1 + random.Gaussian(0.05));
      if (c == 1 && random.Uniform(0, 1) < 0.3) exact *= 1.5, ++late;
      EXPECT_DOUBLE_EQ(exposures[c][f].written, written);
      EXPECT_DOUBLE_EQ(exposures[c][f].exact, exact);
    }
  }
  EXPECT_TRUE(late > 4 && late < 25);
}

TEST(SimulatedExposures, AreWrittenWithTimesAndTruth) {
  SimulationSpec spec = Exposed({});
  spec.cameras[1].sensor.bayer = BayerOrder::kRggb;
  const std::vector<std::string> frames{"000100", "000105"};
  const Exposures exposures{{{1.5, 1.625}, {2, 2.5}}, {{1.5, 3}, {2, 4}}};
  EXPECT_EQ(ExposureTimesText(frames, exposures[0], true),
            "# frame time_s exposure_ms\n000100 0.200000 1.5\n000105 0.400000 2\n");
  EXPECT_EQ(ExposureTimesText(frames, exposures[0], false),
            "# frame time_s\n000100 0.200000\n000105 0.400000\n");
  EXPECT_EQ(
      TrueExposuresCsv(spec, frames, exposures),
      "frame,camera,exposure_ms\n000100,left,1.625\n000105,left,2.5\n000100,right,3\n000105,right,4\n");
  EXPECT_EQ(
      PhotometryRecordingYaml(spec),
      "plenocal: 1\ncameras:\n"
      "  left:\n    images: left/*.png\n    white_images: left_white/*.png\n    times: times_left.txt\n"
      "    exposure_unit: ms\n"
      "  right:\n    images: right/*.png\n    white_images: right_white/*.png\n"
      "    times: times_right.txt\n    exposure_unit: ms\n    bayer: RGGB\n"
      "pairing: {by: name}\ncalibration: truth/calibration.yaml\n");
}

TEST(SimulatedVignetting, IsAPolynomialOfTheSquaredRadius) {
  const ImageSize size{60, 80};  // half of the diagonal is 50 px
  const VignettingSpec round{.polynomial = {-0.3, 0.1, -0.05}};
  EXPECT_DOUBLE_EQ(round.At(29.5, 39.5, size), 1);
  EXPECT_NEAR(
      round.At(29.5 + 25, 39.5, size), 1 - 0.3 * 0.25 + 0.1 * 0.0625 - 0.05 * 0.015625, 1e-12);
  EXPECT_NEAR(round.At(29.5, 39.5 - 50, size), 1 - 0.3 + 0.1 - 0.05, 1e-12);
  const VignettingSpec oval{
      .polynomial = {-0.3, 0, 0}, .centre = Eigen::Vector2d(10, 20), .axes = {2, 0.5}};
  EXPECT_NEAR(oval.At(60, 20, size), 1 - 0.3 / 4, 1e-12);
  EXPECT_NEAR(oval.At(10, 45, size), 1 - 0.3, 1e-12);
  EXPECT_EQ(oval.At(10, 145, size), 0.01);  // not less
}

class WallLight : public ::testing::Test {
 protected:
  WallLight() {
    nominal_ = ReadTarget(YamlNode::Parse(
        "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n"
        "  - {id: 0, corners: [[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]]}\n",
        "t"));
    surface_.emplace(nominal_, TrueTarget{nominal_.markers, {}}, 1);
    T_.R = ExpRotation({0.2, -0.3, 0.4}) * Vector3d(1, -1, -1).asDiagonal();
    T_.t = {0.1, -0.05, 1.4};
  }
  // Radiance of the ray towards a point of the wall's frame.
  [[nodiscard]] double At(const WallSpec& wall,
                          const Vector3d& point,
                          const Spread& spread = {}) const {
    const PosedSurface posed(*surface_, T_);
    return WallSurface(wall, texture_, posed, T_)
        .Radiance(Vector3f(0.01f, 0.02f, 0.03f),
                  (T_ * point - Vector3d(0.01, 0.02, 0.03)).cast<float>(),
                  spread);
  }
  static double Lamp(const Vector3d& point, double lost) {
    const double x = point.x() + 0.4, y = point.y() + 0.3;
    return 1 / (1 + (x * x + y * y) * lost / (1 - lost));
  }

  Target nominal_;
  std::optional<TargetSurface> surface_;
  RigidTransform T_;
  SceneTexture texture_{0.01, 3};
};

TEST_F(WallLight, FallsWithTheDistanceFromTheLampsFootAndHasTheTexture) {
  const WallSpec wall{.contrast = 0, .light = 0.3};
  for (const Vector3d& point :
       {Vector3d(0.5, 0.3, 0), Vector3d(-0.4, -0.3, 0), Vector3d(0.6, -0.4, 0)}) {
    EXPECT_NEAR(At(wall, point), 0.6 * Lamp(point, 0.3), 1e-5);
  }
  EXPECT_NEAR(At(wall, {-0.4, 0.7, 0}), 0.6 * 0.7, 1e-5);  // 30 % are lost 1 m away
  // The target on it is in the same light: its board is gray, ink at the tag's border.
  EXPECT_NEAR(At(wall, {0.09, 0, 0}), PosedSurface::kInk * Lamp({0.09, 0, 0}, 0.3), 1e-3);
  // Nothing behind the camera.
  const PosedSurface posed(*surface_, T_);
  const WallSurface surface(wall, texture_, posed, T_);
  EXPECT_EQ(surface.Radiance(Vector3f::Zero(), {0, 0, -1}, {}), Surface::kBackground);
  const auto [face, distance] =
      surface.FaceOf(Vector3f::Zero(), (2 * (T_ * Vector3d(0.5, 0.1, 0))).cast<float>());
  EXPECT_EQ(face, -1);
  EXPECT_NEAR(distance, 0.5, 1e-6);
  // Texture.
  const WallSpec textured{.contrast = 0.1, .light = 0};
  for (const float x : {0.3f, 0.41f, 0.52f}) {
    const Spread spread{.at_origin = 0.01f, .by_distance = 0.03f};
    const float structure =
        texture_.At(x, 0.2f, 0.04f);  // the direction is as long as the distance
    EXPECT_NEAR(At(textured, {x, 0.2, 0}, spread), 0.6 * (1 + 0.5 * (structure - 0.45)), 2e-4);
  }
}

TEST_F(WallLight, ShinesAboutTheReflectionGoesWithTheCameraAndFollowsAFold) {
  const Vector3d lamp(-0.4, -0.3, 2), viewer = T_.Inverse().t;
  const auto gloss = [&](const Vector3d& point) {
    const Vector3d half = (lamp - point).normalized() + (viewer - point).normalized();
    return std::pow(half.normalized().z(), 40);
  };
  // Where the lamp's mirror image is seen.
  const Vector3d mirrored(-0.4, -0.3, -2);
  const Vector3d at = viewer + viewer.z() / (viewer.z() + 2) * (mirrored - viewer);
  EXPECT_NEAR(gloss(at), 1, 1e-12);
  const WallSpec wall{.contrast = 0, .light = 0.2, .gloss = 0.5};
  for (const Vector3d& point : {at, Vector3d(at + Vector3d(0.2, 0.1, 0)), Vector3d(0.5, 0.5, 0)}) {
    if (point.head<2>().cwiseAbs().maxCoeff() < 0.25) continue;  // the target
    EXPECT_NEAR(At(wall, point), (0.6 + 0.5 * gloss(point)) * Lamp(point, 0.2), 1e-4);
  }
  // Shading by the tangent from the camera's axis.
  const WallSpec shaded{.contrast = 0, .light = 0, .shading = 0.4};
  const RigidTransform T_wall_camera = T_.Inverse();
  const Vector3d forward = T_wall_camera.R.col(2);
  const double axis = viewer.x() - viewer.z() / forward.z() * forward.x();
  for (const double x : {0.4, 0.7, -0.6}) {
    EXPECT_NEAR(At(shaded, {x, 0.3, 0}), 0.6 * (1 + 0.4 * (x - axis) / viewer.z()), 1e-5);
  }

  const WallSpec flat{.contrast = 0.2, .light = 0.3};
  WallSpec folded = flat;
  folded.fold = 0.3;
  folded.fold_angle = 0.5;
  EXPECT_EQ(At(folded, {0.29, 0.2, 0}), At(flat, {0.29, 0.2, 0}));
  for (const double along : {0.05, 0.2, 0.4}) {
    const Vector3d point(0.3 + along * std::cos(0.5), 0.2, along * std::sin(0.5));
    const float structure = texture_.At(static_cast<float>(0.3 + along), 0.2f, 0);
    EXPECT_NEAR(At(folded, point), 0.6 * (1 + structure - 0.45) * Lamp(point, 0.3), 2e-4);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
