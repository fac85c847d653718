// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/poses.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/adjust/solver/adjust.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::Random;
using testing::TrueBundle;

constexpr double kNoise = 0.2;  // px

double Distance(const RigidTransform& a, const RigidTransform& b) {
  return (a.t - b.t).norm() + LogRotation(a.R * b.R.transpose()).norm();
}

Vector6d SmallMotion(Random* random) {
  Vector6d delta;
  for (double& number : delta) number = random->Gaussian(0.003);
  return delta;
}

TEST(AdjustPoses, MovesTheChosenFramesToTheOptimumOfAdjust) {
  Bundle bundle = TrueBundle(MakeProblem(4, {.cameras = 2, .frames = 4, .noise = kNoise}));
  for (BundleCamera& camera : bundle.cameras) {
    camera.fixed.assign(camera.fixed.size(), true);
    camera.is_master = true;  // extrinsics are not estimated either
  }
  Random random(1);
  for (RigidTransform& T : bundle.T_rig_target) T = Retract(T, SmallMotion(&random));
  Bundle all = bundle;
  AdjustOptions options;
  options.loss = Loss::kHuber;
  ASSERT_TRUE(Adjust(&all, options).usable);
  Bundle some = bundle;
  AdjustPoses(&some, {true, false, true, false});
  for (size_t f = 0; f < 4; ++f) {
    const RigidTransform& expected = f % 2 == 0 ? all.T_rig_target[f] : bundle.T_rig_target[f];
    // A tenth of the poses' standard errors, 3e-4 rad.
    EXPECT_LT(Distance(some.T_rig_target[f], expected), f % 2 == 0 ? 3e-5 : 1e-15) << f;
  }
}

TEST(OwnPoseSteps, LeadEachViewToItsOwnPose) {
  const Bundle exact = TrueBundle(MakeProblem(5, {.cameras = 2, .frames = 3}));
  Random random(2);
  Bundle moved = exact;
  for (RigidTransform& T : moved.T_rig_target) T = Retract(T, SmallMotion(&random));
  const std::vector<PoseStep> steps = OwnPoseSteps(moved);
  ASSERT_EQ(steps.size(), 2U * 3U);
  for (const PoseStep& step : steps) {
    const auto frame = static_cast<size_t>(step.frame);
    const RigidTransform reached = Retract(moved.T_rig_target[frame], step.delta);
    // One step of Gauss and Newton leaves the square of the distance.
    const double before = Distance(moved.T_rig_target[frame], exact.T_rig_target[frame]);
    EXPECT_LT(Distance(reached, exact.T_rig_target[frame]), 0.1 * before);
    EXPECT_GT(step.gain, 0);
  }
}

// At the true pose, the gain of a view with n points and noise of its sigmas is chi-square
// distributed with six degrees of freedom.
TEST(OwnPoseSteps, GainWhatSixUnknownsAbsorbOfTheNoise) {
  double gain = 0, steps = 0;
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Bundle bundle =
        TrueBundle(MakeProblem(seed, {.cameras = 2, .frames = 10, .noise = kNoise}));
    for (const PoseStep& step : OwnPoseSteps(bundle)) {
      gain += step.gain;
      steps += 1;
    }
  }
  ASSERT_GT(steps, 50);
  EXPECT_NEAR(gain / steps, 6, 5 * std::sqrt(12 / steps));
}

}  // namespace TEST_FILE
}  // namespace plenocal
