// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/outside_poses.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/calib/random.h"
#include "tests/digest.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kPositionNoise = 2e-4, kAngleNoise = 3.5e-4;  // m, rad

struct Robot {
  RigidTransform T_gripper_rig{ExpRotation({0.3, -2, 0.4}), {0.05, -0.03, 0.1}};
  RigidTransform T_base_target{ExpRotation({-1, 0.2, 0.5}), {0.6, 0.1, -0.2}};
  double target_scale = 1;  // of the true target over the stated one

  [[nodiscard]] std::vector<OutsidePose> Poses(unsigned seed, double noise) const {
    testing::Random random(seed);
    std::vector<OutsidePose> poses;
    constexpr int kFrames = 30;
    for (int i = 0; i < kFrames; ++i) {
      const auto draw = [&] { return random.Uniform(-1, 1); };
      const RigidTransform T_rig_target{ExpRotation({0.5 * draw(), 0.5 * draw(), 0.5 * draw()}),
                                        {0.2 * draw(), 0.2 * draw(), 0.7 + 0.2 * draw()}};
      RigidTransform T = T_base_target * T_rig_target.Inverse() * T_gripper_rig.Inverse();
      for (int k = 0; k < 3; ++k) T.t[k] += random.Gaussian(noise * kPositionNoise);
      Eigen::Vector3d w;
      for (double& angle : w) angle = random.Gaussian(noise * kAngleNoise);
      T.R = T.R * ExpRotation(w);
      poses.push_back({T, {T_rig_target.R, T_rig_target.t / target_scale}});
    }
    return poses;
  }
};

TEST(OutsidePoses, GiveMountAndTargetOfExactPoses) {
  const Robot robot;
  const auto fit = FitOutsidePoses(robot.Poses(1, 0), {});
  ASSERT_TRUE(fit);
  constexpr double kRounding = 1e-7;
  EXPECT_LT((fit->T_mount_rig.t - robot.T_gripper_rig.t).norm(), kRounding);
  EXPECT_LT((fit->T_mount_rig.R - robot.T_gripper_rig.R).norm(), kRounding);
  EXPECT_LT((fit->T_other_target.t - robot.T_base_target.t).norm(), kRounding);
}

// Mean (error / sigma)^2 of one transform.
double Ratio(const RigidTransform& found, const RigidTransform& truth, const Vector6d& sigma) {
  Vector6d error;
  error << found.t - truth.t, LogRotation(found.R * truth.R.transpose());
  return error.cwiseQuotient(sigma).squaredNorm() / 6;
}

TEST(OutsidePoses, StateTheErrorsThatSeedsShow) {
  Robot robot;
  robot.target_scale = 0.99;
  constexpr unsigned kSeeds = 40;
  double mount = 0, target = 0, scale = 0, position = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto fit =
        FitOutsidePoses(robot.Poses(seed, 1), {RigMount::kOnGripper, OutsideScale::kFree});
    ASSERT_TRUE(fit);
    mount += Ratio(fit->T_mount_rig, robot.T_gripper_rig, fit->rig_sigma) / kSeeds;
    target += Ratio(fit->T_other_target, robot.T_base_target, fit->target_sigma) / kSeeds;
    scale += std::pow((fit->scale - robot.target_scale) / fit->scale_sigma, 2) / kSeeds;
    position += fit->translation_sigma / kSeeds;
  }
  // 240 numbers that correlate; the last is one a seed.
  EXPECT_NEAR(mount, 1, 0.3);
  EXPECT_NEAR(target, 1, 0.3);
  EXPECT_NEAR(scale, 1, 0.7);
  EXPECT_NEAR(position / kPositionNoise, 1, 0.05);
}

// Gives the calibration's poses errors: of a principal point and a focal length, which all share,
// and some of their own.
void AddCalibrationErrors(testing::Random* random, std::vector<OutsidePose>* poses) {
  constexpr double kTurn = 5e-4, kDepth = 1e-3, kOwnPosition = 2e-4, kOwnAngle = 2e-4;
  const double turn = random->Gaussian(1), depth = random->Gaussian(1);
  for (OutsidePose& pose : *poses) {
    PoseErrors& errors = pose.errors;
    errors.own.diagonal() << Eigen::Vector3d::Constant(kOwnPosition * kOwnPosition),
        Eigen::Vector3d::Constant(kOwnAngle * kOwnAngle);
    errors.shared.resize(6, 2);
    errors.shared.col(0) << 0, -kTurn * pose.T_rig_target.t.z(), 0, kTurn, 0, 0;
    errors.shared.col(1) << 0, 0, kDepth * pose.T_rig_target.t.z(), 0, 0, 0;
    Vector6d error = errors.shared * Eigen::Vector2d(turn, depth);
    for (Eigen::Index k = 0; k < 6; ++k) error[k] += random->Gaussian(std::sqrt(errors.own(k, k)));
    pose.T_rig_target = Retract(pose.T_rig_target, -error);
  }
}

TEST(OutsidePoses, StateTheErrorsOfTheCalibrationToo) {
  const Robot robot;
  constexpr unsigned kSeeds = 40;
  double with = 0, without = 0, length_with = 0, length_without = 0, position = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    std::vector<OutsidePose> poses = robot.Poses(seed, 1);
    testing::Random random(1000 + seed);
    AddCalibrationErrors(&random, &poses);
    const auto fit = FitOutsidePoses(poses, {});
    ASSERT_TRUE(fit);
    ASSERT_EQ(fit->calibration_errors.size(), 2);
    for (OutsidePose& pose : poses) pose.errors = {};
    const auto exact = FitOutsidePoses(poses, {});
    ASSERT_TRUE(exact);
    with += Ratio(fit->T_mount_rig, robot.T_gripper_rig, fit->rig_sigma) / kSeeds;
    without += Ratio(exact->T_mount_rig, robot.T_gripper_rig, exact->rig_sigma) / kSeeds;
    length_with += (fit->T_mount_rig.t - robot.T_gripper_rig.t).squaredNorm();
    length_without += (exact->T_mount_rig.t - robot.T_gripper_rig.t).squaredNorm();
    position += fit->translation_sigma / kSeeds;
  }
  EXPECT_NEAR(with, 1, 0.3);
  EXPECT_GT(without, 2);
  EXPECT_LT(length_with, 0.8 * length_without);
  EXPECT_NEAR(position / kPositionNoise, 1, 0.1);
}

// Rotations about one axis of the rig, and about others by `spread`; the noise of the calibration's
// poses turns them about others too.
std::vector<OutsidePose> PosesAboutOneAxis(unsigned seed, double spread) {
  constexpr int kFrames = 25;
  constexpr double kOwnAngle = 5e-4;
  const Robot robot;
  testing::Random random(seed);
  std::vector<OutsidePose> poses;
  for (int i = 0; i < kFrames; ++i) {
    const auto draw = [&] { return 0.2 * random.Uniform(-1, 1); };
    const RigidTransform T_rig_target{
        ExpRotation({random.Gaussian(spread), 3 * draw(), random.Gaussian(spread)}),
        {draw(), draw(), 0.7 + draw()}};
    RigidTransform T = robot.T_base_target * T_rig_target.Inverse() * robot.T_gripper_rig.Inverse();
    Vector6d error = Vector6d::Zero();
    for (int k = 0; k < 3; ++k) {
      T.t[k] += random.Gaussian(kPositionNoise);
      error[3 + k] = random.Gaussian(kOwnAngle);
    }
    poses.push_back({T, Retract(T_rig_target, error)});
    poses.back().errors.own.diagonal().tail<3>().setConstant(kOwnAngle * kOwnAngle);
    poses.back().errors.shared.resize(6, 0);
  }
  return poses;
}

TEST(OutsidePoses, AboutOneAxisLeaveTheTranslationAlongItOpen) {
  const Robot robot;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const auto fit = FitOutsidePoses(PosesAboutOneAxis(seed, 0), {});
    ASSERT_TRUE(fit);
    ASSERT_EQ(fit->open.cols(), 1) << seed;
    const Eigen::Vector3d axis = robot.T_gripper_rig.R.col(1);
    EXPECT_GT(std::abs(fit->open.col(0).head<3>().normalized().dot(axis)), 0.9999) << seed;
    for (Eigen::Index k = 0; k < 6; ++k) {
      EXPECT_EQ(std::isinf(fit->rig_sigma[k]), k < 3) << seed;
      EXPECT_EQ(std::isinf(fit->target_sigma[k]), k < 3) << seed;
    }
  }
}

TEST(OutsidePoses, AboutNearlyOneAxisStateTheErrorsThatSeedsShow) {
  const Robot robot;
  constexpr unsigned kSeeds = 20;
  double mount = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const auto fit = FitOutsidePoses(PosesAboutOneAxis(seed, 2e-3), {});
    ASSERT_TRUE(fit);
    ASSERT_EQ(fit->open.cols(), 0) << seed;
    mount += Ratio(fit->T_mount_rig, robot.T_gripper_rig, fit->rig_sigma) / kSeeds;
  }
  // Of the six numbers three are one, the translation along the axis: 80 that count.
  EXPECT_NEAR(mount, 1, 0.5);
}

TEST(OutsidePoses, LeaveOutWrongOnes) {
  const Robot robot;
  std::vector<OutsidePose> poses = robot.Poses(2, 1);
  poses[7].T_base_gripper.t.x() += 0.02;
  const auto fit = FitOutsidePoses(poses, {});
  ASSERT_TRUE(fit);
  for (size_t i = 0; i < poses.size(); ++i) EXPECT_EQ(fit->used[i], i != 7) << i;
}

TEST(OutsidePoses, OfARigOnTheBaseAreInverse) {
  Robot robot;
  std::vector<OutsidePose> poses = robot.Poses(3, 0);
  for (OutsidePose& pose : poses) pose.T_base_gripper = pose.T_base_gripper.Inverse();
  const auto fit = FitOutsidePoses(poses, {RigMount::kOnBase, OutsideScale::kFixed});
  ASSERT_TRUE(fit);
  EXPECT_LT((fit->T_mount_rig.t - robot.T_gripper_rig.t).norm(), 1e-7);
  // The other way round nothing fits.
  const auto wrong = FitOutsidePoses(poses, {});
  EXPECT_TRUE(!wrong || wrong->translation_sigma > 0.01);
}

TEST(OutsidePoses, InMillimetresMoveAThousandTimesAsFar) {
  std::vector<OutsidePose> poses = Robot().Poses(4, 0);
  EXPECT_NEAR(RatioOfLengths(poses), 1, 0.5);
  for (OutsidePose& pose : poses) pose.T_base_gripper.t *= 1000;
  EXPECT_GT(RatioOfLengths(poses), 500);
}

// With errors of the calibration, of the scale and of three poses.
TEST(OutsidePoses, FitIsTheSameAsBefore) {
  Robot robot;
  robot.target_scale = 1.004;
  std::vector<OutsidePose> poses = robot.Poses(5, 2);
  testing::Random random(6);
  AddCalibrationErrors(&random, &poses);
  for (OutsidePose& pose : poses) {
    for (double& velocity : pose.velocity) velocity = random.Gaussian(0.2);
    pose.velocity_covariance.setConstant(1e-4);
  }
  for (const size_t wrong : {4, 11, 23}) poses[wrong].T_base_gripper.t.x() += 0.02;
  testing::Digest digest;
  for (const OutsideScale scale : {OutsideScale::kFixed, OutsideScale::kFree}) {
    const auto fit = FitOutsidePoses(
        poses, {.scale = scale, .instants_per_error = 1.5, .time_shift = FreeTimeShift{0.02, 0.1}});
    ASSERT_TRUE(fit);
    digest.Add(fit->T_mount_rig);
    digest.Add(fit->T_other_target);
    for (const auto& values :
         {Eigen::VectorXd(1e3 * fit->rig_sigma),
          Eigen::VectorXd(1e3 * fit->target_sigma),
          Eigen::VectorXd(Eigen::Vector4d(fit->scale,
                                          1e3 * fit->scale_sigma,
                                          1e3 * fit->translation_sigma,
                                          1e3 * fit->rotation_sigma)),
          Eigen::VectorXd(Eigen::Vector2d(1e3 * fit->time_shift, 1e3 * fit->time_shift_sigma)),
          fit->calibration_errors}) {
      digest.AddAll(values);
    }
    for (const bool used : fit->used) digest.Add(used ? 1 : 0);
  }
  EXPECT_NEAR(digest.Sum(), 4.3214, 1e-4);
}

}  // namespace TEST_FILE
}  // namespace plenocal
