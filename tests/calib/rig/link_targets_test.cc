// SPDX-License-Identifier: Apache-2.0
//
// Two cameras back to back, each before a wall of its own: placed by the motion of the rig.
#include "calib/rig/link_targets.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "calib/camera/marker_id.h"
#include "calib/estimate/calibrate.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::Not;

constexpr int kColumns = 9, kRows = 7;
constexpr double kSpacing = 0.06, kDistance = 0.8;  // m
constexpr double kNoise = 0.1;                      // px

struct TwoWalls {
  CalibrationInput input;
  RigidTransform T_back_rig, T_front_back;  // extrinsics of the second camera; walls
};

// A rig that turns about its y axis, and about the others by `spread`, rad.
TwoWalls Record(unsigned seed, double spread) {
  constexpr int kFrames = 25;
  testing::Random random(seed);
  const CameraModel* model = FindModel(CameraModels(), "pinhole-radtan4");
  const std::vector<double> params{500, 501, 322, 238, -0.1, 0.02, 0, 0};
  const ImageSize size{640, 480};
  const Eigen::Vector3d centre(kSpacing * (kColumns - 1) / 2, kSpacing * (kRows - 1) / 2, 0);
  const RigidTransform front{Eigen::Matrix3d::Identity(),
                             Eigen::Vector3d(0, 0, kDistance) - centre};
  TwoWalls walls;
  walls.T_back_rig = {
      ExpRotation(random.Gaussians<3>(0.05)) * ExpRotation(Eigen::Vector3d(0, std::numbers::pi, 0)),
      Eigen::Vector3d(0.1, 0.02, -0.15)};
  walls.T_front_back = front.Inverse() * walls.T_back_rig.Inverse() * front;
  CalibrationInput& input = walls.input;
  for (const char* name : {"front", "back"}) {
    input.cameras.push_back({.name = name,
                             .model = model,
                             .config = {},
                             .initial = std::vector<std::optional<double>>(params.size()),
                             .fixed = std::vector<bool>(params.size(), false),
                             .image_size = size,
                             .views = {}});
    input.targets.push_back({.name = std::string("wall_") + name, .known = {}});
  }
  for (int i = 0; i < kFrames; ++i) {
    const RigidTransform moved{
        ExpRotation({random.Gaussian(spread), random.Uniform(-0.5, 0.5), random.Gaussian(spread)}),
        random.Uniforms<3>(-0.15, 0.15)};
    const RigidTransform poses[] = {moved * front,
                                    walls.T_back_rig * moved * front * walls.T_front_back};
    for (size_t c = 0; c < 2; ++c) {
      View view{fmt::format("{:04}", i), {}};
      for (int m = 0; m < kColumns * kRows; ++m) {
        const Eigen::Vector3d p(kSpacing * (m % kColumns), kSpacing * (m / kColumns), 0);
        const int number = MarkerId{static_cast<size_t>(c), m}.Number();
        input.markers[number] = p;
        Observation seen{.marker = number, .detector_sigma = kNoise};
        const Eigen::Vector3d p_camera = poses[c] * p;
        if (p_camera.z() < 0.1 ||
            !model->Project(params.data(), nullptr, nullptr, p_camera, seen.values.data()) ||
            seen.values[0] < 0 || seen.values[0] > size[0] || seen.values[1] < 0 ||
            seen.values[1] > size[1]) {
          continue;
        }
        for (size_t r = 0; r < 2; ++r) seen.values[r] += random.Gaussian(kNoise);
        view.observations.push_back(seen);
      }
      if (view.observations.size() > 20) input.cameras[c].views.push_back(view);
    }
  }
  return walls;
}

// In the chart in which it was estimated, over the standard errors; zero along what is open.
Vector6d ErrorOfExtrinsics(const TwoWalls& walls, const Calibration& calibration) {
  const RigidTransform& found = calibration.bundle.cameras[1].T_camera_rig;
  Vector6d error;
  error << found.t - walls.T_back_rig.t, LogRotation(found.R * walls.T_back_rig.R.transpose());
  return error.cwiseQuotient(
      calibration.uncertainty.extrinsics_covariance[1].diagonal().cwiseSqrt());
}

TEST(LinkTargets, ByMotionAboutOneAxisLeavesTheTranslationAlongItOpenAlone) {
  constexpr unsigned kSeeds = 8;
  double rotation = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const TwoWalls walls = Record(seed, 0);
    const Calibration calibration = Calibrate(walls.input, {});
    EXPECT_THAT(testing::CodesOf(calibration.findings), Contains("one_rotation_axis")) << seed;
    const Uncertainty& uncertainty = calibration.uncertainty;
    ASSERT_EQ(uncertainty.undetermined.cols(), 1) << seed;
    const Eigen::VectorXd open = uncertainty.undetermined.col(0);
    const int back = uncertainty.extrinsics_index[1], wall = uncertainty.target_index[1];
    // The axis is y of the rig and of the walls.
    EXPECT_GT(std::abs(open.segment<3>(back).normalized().dot(walls.T_back_rig.R.col(1))), 0.999);
    EXPECT_GT(std::abs(open.segment<3>(wall).normalized().y()), 0.999);
    EXPECT_TRUE(open.segment<3>(back + 3).isZero()) << seed;
    EXPECT_TRUE(open.segment<3>(wall + 3).isZero()) << seed;
    EXPECT_TRUE(open.head(back).isZero()) << seed;
    const RigidTransform& T_back_rig = calibration.bundle.cameras[1].T_camera_rig;
    EXPECT_LT(std::abs(T_back_rig.R.col(1).dot(T_back_rig.t)), 0.01) << seed;  // near the rig
    rotation += ErrorOfExtrinsics(walls, calibration).tail<3>().squaredNorm() / (3 * kSeeds);
  }
  // 24 numbers, nearly independent.
  EXPECT_GT(rotation, 0.4);
  EXPECT_LT(rotation, 1.9);
}

TEST(LinkTargets, KeepsEachObservationOnce) {
  const TwoWalls walls = Record(1, 0.1);
  size_t count = 0;
  for (const CameraInput& camera : walls.input.cameras) {
    for (const View& view : camera.views) count += view.observations.size();
  }
  const Calibration calibration = Calibrate(walls.input, {});
  EXPECT_EQ(calibration.bundle.observations.size(), count);
  std::set<std::tuple<int, int, int>> seen;
  for (const BundleObservation& each : calibration.bundle.observations) {
    seen.emplace(each.camera, each.frame, each.marker);
  }
  EXPECT_EQ(seen.size(), count);
  EXPECT_EQ(calibration.bundle.T_rig_target.size(), calibration.frames.size());
}

TEST(LinkTargets, ByMotionAboutNearlyOneAxisStatesTheErrorsThatSeedsShow) {
  constexpr unsigned kSeeds = 8;
  double squares = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const TwoWalls walls = Record(seed, 5e-3);
    const Calibration calibration = Calibrate(walls.input, {});
    EXPECT_EQ(calibration.uncertainty.undetermined.cols(), 0) << seed;
    squares += ErrorOfExtrinsics(walls, calibration).squaredNorm() / (6 * kSeeds);
  }
  // 48 numbers, of which about half are independent.
  EXPECT_GT(squares, 0.4);
  EXPECT_LT(squares, 1.9);
}

}  // namespace TEST_FILE
}  // namespace plenocal
