// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/repeated_pose.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::Random;
using testing::TrueBundle;

constexpr double kNoise = 0.1;  // px

// `frames` frames at the pose of the first, each with its own noise.
Bundle StillBundle(int frames) {
  const Bundle first = TrueBundle(MakeProblem(2, {.frames = 1}));
  Bundle bundle = first;
  bundle.observations.clear();
  bundle.T_rig_target.clear();
  Random random(1);
  for (int f = 0; f < frames; ++f) {
    bundle.T_rig_target.push_back(first.T_rig_target[0]);
    for (BundleObservation observation : first.observations) {
      observation.frame = f;
      observation.assumed_sigma = kNoise;
      for (size_t r = 0; r < 2; ++r) observation.seen.values[r] += random.Gaussian(kNoise);
      bundle.observations.push_back(observation);
    }
  }
  return bundle;
}

TEST(RepeatedPose, IsFoundInFramesThatDifferByNoiseOnly) {
  const std::vector<double> typical{kNoise};
  EXPECT_TRUE(ShowsOnePose(StillBundle(6), typical));
  EXPECT_FALSE(ShowsOnePose(StillBundle(1), typical)) << "one frame repeats nothing";
  Bundle moving = TrueBundle(MakeProblem(2, {.frames = 6, .noise = kNoise}));
  EXPECT_FALSE(ShowsOnePose(moving, typical));
}

// Frames are shifted to and fro: the variance of a coordinate is 1 + shift^2 times that of the noise.
TEST(RepeatedPose, IsOneUpToThreeSigmasOfVibration) {
  const auto shifted = [](double sigmas) {
    Bundle bundle = StillBundle(12);
    for (BundleObservation& observation : bundle.observations) {
      for (size_t r = 0; r < 2; ++r) {
        observation.seen.values[r] += (observation.frame % 2 == 0 ? 1 : -1) * sigmas * kNoise;
      }
    }
    return ShowsOnePose(bundle, std::vector<double>{kNoise});
  };
  EXPECT_TRUE(shifted(2.5));
  EXPECT_FALSE(shifted(3.1));
}

// Estimated poses of a still target differ by noise, which seems to determine parameters.
TEST(RepeatedPose, LeavesOpenWhatNoiseSeemsToDetermine) {
  Bundle bundle = StillBundle(6);
  Random random(2);
  for (RigidTransform& T : bundle.T_rig_target) {
    Vector6d delta;
    for (double& number : delta) number = random.Gaussian(1e-4);
    T = Retract(T, delta);
  }
  const Uncertainty uncertainty = UncertaintyOfOnePose(bundle);
  EXPECT_FALSE(uncertainty.open.empty());
  int undetermined = 0;
  for (const double error : uncertainty.param_std_errors[0]) undetermined += std::isinf(error);
  // A homography has eight numbers, of which the pose takes six.
  EXPECT_GE(undetermined, 5);
}

}  // namespace TEST_FILE
}  // namespace plenocal
