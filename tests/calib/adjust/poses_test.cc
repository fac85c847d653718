// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/poses.h"

#include <gmock/gmock.h>

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

// Steps end where one is shorter than a standard error: the sigma of the observations decides.
TEST(AdjustPoses, TakeAnotherStepAfterOneOfASigmaOrMore) {
  const Bundle exact = TrueBundle(MakeProblem(4, {.cameras = 2, .frames = 2}));
  const RigidTransform& truth = exact.T_rig_target[1];
  Random random(3);
  Bundle moved = exact;
  moved.T_rig_target[1] = Retract(truth, SmallMotion(&random));
  const size_t begin = EndOfFrame(exact.observations, 0), end = exact.observations.size();
  for (BundleObservation& each : moved.observations) each.assumed_sigma = 1e-3;
  AdjustPose(begin, end, &moved);
  EXPECT_LT(Distance(moved.T_rig_target[1], truth), 1e-12);
  EXPECT_EQ(moved.T_rig_target[0].t, exact.T_rig_target[0].t);
  const auto error_with = [&](double length) {
    Bundle bundle = exact;
    Vector6d delta;
    delta << 2e-3, -1e-3, 3e-3, 4e-3, -3e-3, 2e-3;
    bundle.T_rig_target[1] = Retract(truth, delta);
    // Squares of all residuals are length^2.
    double squares = 0;
    for (size_t i = begin; i < end; ++i) {
      double residual[kMaxObservationSize];
      EXPECT_TRUE(Residual(bundle, bundle.observations[i], residual));
      squares += residual[0] * residual[0] + residual[1] * residual[1];
    }
    for (BundleObservation& each : bundle.observations) {
      each.assumed_sigma = std::sqrt(squares) / length;
    }
    AdjustPose(begin, end, &bundle);
    return Distance(bundle.T_rig_target[1], truth);
  };
  const double one_step = error_with(0.9);
  EXPECT_GT(one_step, 1e-7);
  EXPECT_LT(error_with(1.1), 1e-2 * one_step);
}

TEST(AdjustPoses, StayWhereNoObservationDeterminesThem) {
  Bundle bundle = TrueBundle(MakeProblem(4, {.cameras = 1, .frames = 1}));
  for (BundleObservation& each : bundle.observations) each.used = false;
  const RigidTransform before = bundle.T_rig_target[0];
  AdjustPose(0, bundle.observations.size(), &bundle);
  EXPECT_EQ(bundle.T_rig_target[0].t, before.t);
  EXPECT_THAT(OwnPoseSteps(bundle), ::testing::IsEmpty());
}

TEST(PoseInformation, IsThatOfTheDerivativesOfTheResiduals) {
  const Bundle bundle = TrueBundle(MakeProblem(4, {.cameras = 2, .frames = 2, .noise = kNoise}));
  const size_t begin = EndOfFrame(bundle.observations, 0), end = bundle.observations.size();
  const auto residuals = [&](const Vector6d& delta) {
    Bundle moved = bundle;
    moved.T_rig_target[1] = Retract(moved.T_rig_target[1], delta);
    Eigen::VectorXd all(2 * static_cast<Eigen::Index>(end - begin));
    for (size_t i = begin; i < end; ++i) {
      double residual[kMaxObservationSize];
      EXPECT_TRUE(Residual(moved, moved.observations[i], residual));
      all.segment<2>(2 * static_cast<Eigen::Index>(i - begin)) =
          Eigen::Vector2d(residual[0], residual[1]) / moved.observations[i].assumed_sigma;
    }
    return all;
  };
  Eigen::MatrixXd J(2 * static_cast<Eigen::Index>(end - begin), 6);
  for (int k = 0; k < 6; ++k) {
    const Vector6d step = 1e-6 * Vector6d::Unit(k);
    J.col(k) = (residuals(step) - residuals(-step)) / 2e-6;
  }
  const Matrix6d expected = J.transpose() * J;
  EXPECT_LT((PoseInformation(bundle, begin, end) - expected).norm(), 1e-6 * expected.norm());
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
