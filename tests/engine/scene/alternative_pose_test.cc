// SPDX-License-Identifier: Apache-2.0
//
// A frame whose points agree on two poses: how many on which, and how far these are apart.
#include "engine/scene/alternative_pose.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "engine/scene/scene_tracks.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

const RigidTransform kPose{ExpRotation({0.1, 0, 0.05}), {0.1, 0, 0.2}};
// Turned by 0.1 rad against the first, with its centre 0.5 m away.
const Eigen::Matrix3d kTurned = ExpRotation({0, 0.1, 0}) * kPose.R;
const RigidTransform kOther{kTurned,
                            -(kTurned*(kPose.Inverse().t + Eigen::Vector3d(0.3, -0.4, 0)))};

struct Frames {
  Bundle bundle;
  SceneState state;

  // `moved` of the points are seen as from the other pose, `wrong` anywhere.
  Frames(int count, int moved, int wrong, size_t frames) {
    BundleCamera& camera = bundle.cameras.emplace_back();
    camera.name = "left";
    camera.image_size = {800, 600};
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.params = {500, 500, 400, 300};
    camera.fixed.assign(4, true);
    camera.is_master = true;
    bundle.T_rig_target.assign(frames, kPose);
    Random random(5);
    for (int m = 0; m < count; ++m) {
      const Eigen::Vector3d p(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(2, 4));
      bundle.markers.push_back({.number = m, .position = p, .nominal = p});
      for (int frame = 0; frame < static_cast<int>(frames); ++frame) {
        const Eigen::Vector3d q = (m < moved ? kOther : kPose) * p;
        BundleObservation seen{.frame = frame, .marker = m, .seen = {}};
        seen.seen.values = {400 + 500 * q.x() / q.z() + random.Gaussian(0.1),
                            300 + 500 * q.y() / q.z() + random.Gaussian(0.1)};
        if (m >= count - wrong) {
          seen.seen.values = {random.Uniform(0, 800), random.Uniform(0, 600)};
        }
        bundle.observations.push_back(seen);
      }
    }
    SortObservations(&bundle);
    state = MakeSceneState(&bundle);
    state.has_pose.assign(frames, true);
    state.has_point.assign(bundle.markers.size(), true);
  }

  std::optional<AlternativePose> Find(const std::vector<size_t>& frames) {
    std::optional<AlternativePose> found = FindAlternativePose(state, frames, 2);
    for (const RigidTransform& T : bundle.T_rig_target) EXPECT_EQ(T.t, kPose.t);
    EXPECT_EQ(std::ranges::count(state.has_point, true), std::ssize(bundle.markers));
    return found;
  }
};

TEST(AlternativePoses, AreThoseOfThePointsThatContradict) {
  for (const size_t frames : {1U, 2U}) {
    const auto found = Frames(60, 18, 6, frames)
                           .Find(frames == 1 ? std::vector<size_t>{0} : std::vector<size_t>{0, 1});
    ASSERT_TRUE(found);
    EXPECT_EQ(found->agreeing, 36U);
    EXPECT_EQ(found->contradicting, 18U);
    EXPECT_NEAR(found->distance, 0.5, 0.01);
    EXPECT_NEAR(found->angle, 0.1, 2e-3);
  }
}

TEST(AlternativePoses, OfFewOrRandomPointsAreChance) {
  EXPECT_FALSE(Frames(60, 0, 0, 1).Find({0}));
  EXPECT_FALSE(Frames(60, 0, 20, 1).Find({0}));
  EXPECT_FALSE(Frames(60, 4, 0, 1).Find({0}));
  EXPECT_FALSE(Frames(60, 18, 0, 1).Find({}));
}

// The more frames are searched, the more landmarks have to agree on another pose (Chernoff's bound
// of the tail of Poisson's distribution).
TEST(AlternativePoses, AreChanceInMoreFramesThanTheirLandmarksAllow) {
  constexpr int kMoved = 8;
  constexpr double kLimit = 1.5;
  Frames frames(40, kMoved, 0, 1);
  double expected = 0;
  for (const BundleObservation& seen : frames.bundle.observations) {
    const double length = ResidualLength(frames.bundle, seen);
    if (length > kLimit) expected += std::asin(kLimit / length) / std::numbers::pi;
  }
  constexpr double kCount = kMoved - 3;  // three determine the pose
  const double tail = std::exp(kCount - expected) * std::pow(expected / kCount, kCount);
  const double most = 1e-3 / (4000 * tail);
  const auto finds = [&](double count) {
    const std::vector<size_t> searched(static_cast<size_t>(count), 0);
    return FindAlternativePose(frames.state, searched, kLimit).has_value();
  };
  ASSERT_GT(most, 1);
  ASSERT_LT(most, 20) << most;
  EXPECT_TRUE(finds(std::floor(most)));
  EXPECT_FALSE(finds(std::floor(most) + 1));
}

// Landmarks that agree in one frame and contradict in another agree by chance with any pose.
TEST(AlternativePoses, OfPointsThatAgreeInAnotherFrameAreChance) {
  Frames frames(60, 4, 0, 2);
  for (BundleObservation& seen : frames.bundle.observations) {
    if (seen.frame == 1 && seen.marker >= 10 && seen.marker < 16) {
      seen.seen.values[0] += 50.0 * (seen.marker - 12);
      seen.seen.values[1] += 70;
    }
  }
  EXPECT_FALSE(frames.Find({0, 1}));
}

TEST(AlternativePoses, HaveDistanceAndAngleOfTheFrameWhereMostAgree) {
  Frames frames(60, 18, 0, 2);
  // In the second frame fewer points are seen, from elsewhere.
  const RigidTransform elsewhere{ExpRotation({0, 0, 0.2}) * kPose.R, kPose.t};
  std::erase_if(frames.bundle.observations,
                [](const BundleObservation& seen) { return seen.frame == 1 && seen.marker < 4; });
  for (BundleObservation& seen : frames.bundle.observations) {
    if (seen.frame != 1 || seen.marker >= 18) continue;
    const Eigen::Vector3d q =
        elsewhere * frames.bundle.markers[static_cast<size_t>(seen.marker)].position;
    seen.seen.values = {400 + 500 * q.x() / q.z(), 300 + 500 * q.y() / q.z()};
  }
  frames.state = MakeSceneState(&frames.bundle);
  frames.state.has_pose.assign(2, true);
  frames.state.has_point.assign(60, true);
  for (const std::vector<size_t>& order : {std::vector<size_t>{0, 1}, {1, 0}}) {
    const auto found = frames.Find(order);
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->distance, 0.5, 0.01);
    EXPECT_NEAR(found->angle, 0.1, 2e-3);
    EXPECT_EQ(found->contradicting, 18U);
  }
}

TEST(AlternativePoses, PointsWithoutAPositionHaveNoVote) {
  Frames frames(60, 18, 0, 1);
  for (size_t m = 0; m < 4; ++m) frames.state.has_point[m] = false;
  for (size_t m = 55; m < 60; ++m) frames.state.has_point[m] = false;
  const auto found = FindAlternativePose(frames.state, {0}, 2);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->agreeing, 37U);
  EXPECT_EQ(found->contradicting, 14U);
}

TEST(AlternativePoses, AreAmbiguousFromAnEighthOn) {
  EXPECT_TRUE((AlternativePose{.agreeing = 70, .contradicting = 10}.IsAmbiguous()));
  EXPECT_FALSE((AlternativePose{.agreeing = 71, .contradicting = 10}.IsAmbiguous()));
  EXPECT_EQ(
      (AlternativePose{
          .agreeing = 120, .contradicting = 80, .distance = 1.5, .angle = std::numbers::pi / 90}
           .Text()),
      "80 of 200 common points contradict this pose and agree on another one, 1.5 m and 2 "
      "degrees away");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
