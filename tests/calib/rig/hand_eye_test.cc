// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/hand_eye.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/calib/random.h"
#include "tests/digest.h"

namespace plenocal {
namespace TEST_FILE {

RigidTransform Pose(double x, double y, double z, double w_x, double w_y, double w_z) {
  return {ExpRotation({w_x, w_y, w_z}), {x, y, z}};
}

const RigidTransform kX = Pose(0.1, -0.2, 0.05, 0.2, 2.9, -0.3);
const RigidTransform kY = Pose(1.5, 0.3, -1, -0.1, 1.7, 0.2);

// Instants of motions by `rotation` about each axis, rad, with noise of A.
std::vector<HandEyePair> Instants(const Eigen::Vector3d& rotation, double noise) {
  testing::Random random(3);
  std::vector<HandEyePair> pairs;
  constexpr int kInstants = 20;
  for (int i = 0; i < kInstants; ++i) {
    const auto draw = [&] { return random.Uniform(-1, 1); };
    const Eigen::Vector3d w = rotation.cwiseProduct(random.Uniforms<3>(-1, 1));
    const RigidTransform B{ExpRotation(w), {0.4 * draw(), 0.3 * draw(), 1.2 + 0.3 * draw()}};
    Vector6d error;
    for (double& each : error) each = random.Gaussian(noise);
    pairs.push_back({Retract(kX * B * kY, error), B});
  }
  return pairs;
}

double Distance(const RigidTransform& a, const RigidTransform& b) {
  return (a.t - b.t).norm() + LogRotation(a.R * b.R.transpose()).norm();
}

TEST(HandEye, FindsBothTransformsOfExactMotions) {
  const auto found = SolveHandEye(Instants({0.5, 0.5, 0.5}, 0));
  ASSERT_TRUE(found);
  constexpr double kRounding = 1e-7;
  EXPECT_LT(Distance(found->X, kX), kRounding);
  EXPECT_LT(Distance(found->Y, kY), kRounding);
  EXPECT_EQ(found->gap, HandEyeGap::kNone);
}

TEST(HandEye, AveragesNoiseAndPassesOverWrongPoses) {
  constexpr double kNoise = 1e-3;
  std::vector<HandEyePair> pairs = Instants({0.5, 0.5, 0.5}, kNoise);
  pairs[4].A = Pose(0, 0, 2, 1, 1, 1);
  pairs[11].A = Pose(0, 1, 2, -1, 1, 0);
  const auto found = SolveHandEye(pairs);
  ASSERT_TRUE(found);
  EXPECT_LT(Distance(found->X, kX), 5 * kNoise);
  EXPECT_LT(Distance(found->Y, kY), 5 * kNoise);
}

TEST(HandEye, NamesTheAxisAlongWhichOneRotationLeavesItOpen) {
  const auto found = SolveHandEye(Instants({0, 0.6, 0}, 1e-4));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->gap, HandEyeGap::kAlongAxis);
  // B turns about y; A sees that axis turned by X.
  EXPECT_GT(std::abs(found->axis.dot(kX.R.col(1))), 0.999);
  // Rotation and the other translations are found.
  constexpr double kClose = 5e-3;
  EXPECT_LT(LogRotation(found->X.R * kX.R.transpose()).norm(), kClose);
  const Eigen::Vector3d error = found->X.t - kX.t;
  EXPECT_LT((error - error.dot(found->axis) * found->axis).norm(), kClose);
}

TEST(HandEye, NeedsThreeInstants) {
  const std::vector<HandEyePair> pairs = Instants({0.5, 0.5, 0.5}, 0);
  EXPECT_FALSE(SolveHandEye(std::span(pairs).first(2)));
}

TEST(HandEye, OfFewNoisyInstantsIsTheSameAsBefore) {
  testing::Digest digest;
  for (const Eigen::Vector3d& rotation :
       {Eigen::Vector3d(0.4, 0.3, 0.5), {0, 0.6, 0.01}, {0.02, 0.02, 0.02}}) {
    std::vector<HandEyePair> pairs = Instants(rotation, 2e-3);
    pairs.resize(9);
    pairs[4].A = Pose(0, 0, 2, 1, 1, 1);
    const auto found = SolveHandEye(pairs);
    ASSERT_TRUE(found);
    digest.Add(found->X);
    digest.Add(found->Y);
    digest.AddAll(std::vector{100 * found->rotation_rms,
                              100 * found->translation_rms,
                              100 * found->error,
                              1.0 * static_cast<int>(found->gap)});
    digest.AddAll(found->axis);
  }
  EXPECT_NEAR(digest.Sum(), 42.8947, 1e-4);
}

}  // namespace TEST_FILE
}  // namespace plenocal
