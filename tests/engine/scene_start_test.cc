// SPDX-License-Identifier: Apache-2.0
//
// Poses and landmarks of a pair of pinhole cameras that passes a cloud of points.
#include "engine/scene/scene_start.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "engine/scene/scene_tracks.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kFocal = 500, kCentre = 400, kBaseline = 0.2, kNoise = 0.1;  // px, m
constexpr int kPoints = 80;
constexpr size_t kFrames = 5;
constexpr double kPoseError =
    5e-3;  // m and rad: points at 3 m have 1 mm by the noise, the path adds

// The rig moves along x and turns a little; the first frame's pose is the identity.
RigidTransform TruePose(size_t frame) {
  const auto step = static_cast<double>(frame);
  return {ExpRotation({0, 0.03 * step, 0.01 * step}), {-0.15 * step, 0.02 * step, 0}};
}

// `wrong` of the points have other positions in each frame but the first.
Bundle Observed(int wrong) {
  Bundle bundle;
  for (const double x : {0.0, kBaseline}) {
    BundleCamera camera{.name = x == 0 ? "left" : "right",
                        .image_size = {800, 800},
                        .model = FindModel(CameraModels(), "pinhole"),
                        .config = {},
                        .params = {kFocal, kFocal, kCentre, kCentre},
                        .fixed = std::vector<bool>(4, true),
                        .T_camera_rig = {Eigen::Matrix3d::Identity(), {-x, 0, 0}}};
    camera.is_master = true;
    bundle.cameras.push_back(camera);
  }
  bundle.T_rig_target.resize(kFrames);
  Random random(1);
  for (int m = 0; m < kPoints; ++m) {
    const Eigen::Vector3d p(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(2, 4));
    bundle.markers.push_back({.number = m, .position = Eigen::Vector3d::Zero(), .nominal = p});
  }
  for (size_t frame = 0; frame < kFrames; ++frame) {
    for (size_t c = 0; c < 2; ++c) {
      for (int m = 0; m < kPoints; ++m) {
        Eigen::Vector3d p = bundle.markers[static_cast<size_t>(m)].nominal;
        if (m < wrong && frame > 0) p += random.Uniforms<3>(-0.5, 0.5);
        p = bundle.cameras[c].T_camera_rig * (TruePose(frame) * p);
        BundleObservation seen{.camera = static_cast<int>(c),
                               .frame = static_cast<int>(frame),
                               .marker = m,
                               .seen = {}};
        seen.seen.values[0] = kCentre + kFocal * p.x() / p.z() + random.Gaussian(kNoise);
        seen.seen.values[1] = kCentre + kFocal * p.y() / p.z() + random.Gaussian(kNoise);
        bundle.observations.push_back(seen);
      }
    }
  }
  SortObservations(&bundle);
  return bundle;
}

double PoseError(const RigidTransform& found, size_t frame) {
  const RigidTransform difference = found * TruePose(frame).Inverse();
  return difference.t.norm() + LogRotation(difference.R).norm();
}

TEST(SceneStarts, FollowThePathAndPlaceThePoints) {
  Bundle bundle = Observed(0);
  SceneState state = MakeSceneState(&bundle);
  const double limit = FollowFrames({0, 1, 2, 3, 4}, &state);
  EXPECT_GT(limit, kNoise);
  EXPECT_LT(limit, 20 * kNoise);
  for (size_t frame = 0; frame < kFrames; ++frame) {
    ASSERT_TRUE(state.has_pose[frame]);
    EXPECT_LT(PoseError(bundle.T_rig_target[frame], frame), kPoseError);
  }
  EXPECT_GT(std::ranges::count(state.has_point, true), kPoints * 3 / 4);
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    if (!state.has_point[m]) continue;
    EXPECT_LT((bundle.markers[m].position - bundle.markers[m].nominal).norm(), 0.1);
  }
  state.has_pose[4] = false;
  KeepStarted(state, &bundle);
  for (const BundleObservation& seen : bundle.observations) EXPECT_NE(seen.frame, 4);
}

TEST(SceneStarts, FindAMinorityByItsLimit) {
  Bundle bundle = Observed(kPoints * 2 / 3);
  SceneState state = MakeSceneState(&bundle);
  FollowFrames({0}, &state);
  const std::optional<PoseSearch> found = FindPose(state, 2, 3.0);
  ASSERT_TRUE(found);
  EXPECT_LT(PoseError(found->T_rig_target, 2), kPoseError);
  EXPECT_FALSE(FindPose(state, 2, 3.0, kPoints));
}

TEST(SceneStarts, PlaceNoPointWhoseRaysDisagree) {
  Bundle bundle = Observed(0);
  for (BundleObservation& seen : bundle.observations) {
    if (seen.marker == 7 && seen.camera == 1) seen.seen.values[1] += 20;
  }
  SceneState state = MakeSceneState(&bundle);
  FollowFrames({0, 1}, &state);
  EXPECT_FALSE(state.has_point[7]);
  EXPECT_TRUE(state.has_point[8]);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
