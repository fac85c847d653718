// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/pose_track.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kPositionNoise = 2e-4, kAngleNoise = 3.5e-4;  // m, rad
constexpr double kFrameInterval = 0.5;                         // s

const RigidTransform kGripperRig{ExpRotation({0.3, -2, 0.4}), {0.05, -0.03, 0.1}};
const RigidTransform kBaseTarget{ExpRotation({-1, 0.2, 0.5}), {0.6, 0.1, -0.2}};

// The rig before the target, moved by a robot.
RigidTransform TargetAt(double time) {
  const auto wave = [&](double hertz, double phase) {
    return std::sin(2 * std::numbers::pi * hertz * time + phase);
  };
  return {ExpRotation({0.4 * wave(0.11, 0), 0.4 * wave(0.17, 1), 0.4 * wave(0.23, 2)}),
          {0.2 * wave(0.13, 3), 0.2 * wave(0.19, 4), 0.7 + 0.2 * wave(0.07, 5)}};
}

// Poses of a robot at 100 Hz whose clock is `shift` ahead of that of the images.
PoseTrack Robot(double shift, double noise, Random* random) {
  std::vector<double> times;
  std::vector<RigidTransform> poses;
  for (int i = -150; i < 2200; ++i) {
    const double time = 0.01 * i;
    RigidTransform T = kBaseTarget * TargetAt(time).Inverse() * kGripperRig.Inverse();
    for (double& t : T.t) t += random->Gaussian(noise * kPositionNoise);
    Eigen::Vector3d w;
    for (double& angle : w) angle = random->Gaussian(noise * kAngleNoise);
    T.R = T.R * ExpRotation(w);
    times.push_back(time + shift);
    poses.push_back(T);
  }
  return {times, poses, kFrameInterval};
}

std::vector<TimedFrame> Frames() {
  constexpr int kFrames = 40;
  std::vector<TimedFrame> frames;
  for (int f = 0; f < kFrames; ++f) {
    const double time = kFrameInterval * f + 0.003;
    frames.push_back({time, TargetAt(time)});
  }
  return frames;
}

TEST(PoseTrack, InterpolatesAndHasGaps) {
  const PoseTrack track({0, 1, 2, 10, 11},
                        {{ExpRotation({0, 0, 0}), {0, 0, 0}},
                         {ExpRotation({0, 0, 1}), {1, 2, 3}},
                         {ExpRotation({0, 0, 1}), {1, 2, 3}},
                         {ExpRotation({0, 0, 1}), {1, 2, 3}},
                         {ExpRotation({0, 0, 1}), {1, 2, 3}}},
                        1);
  const auto half = track.At(0.5);
  ASSERT_TRUE(half);
  EXPECT_LT((half->t - Eigen::Vector3d(0.5, 1, 1.5)).norm(), 1e-12);
  EXPECT_LT((LogRotation(half->R) - Eigen::Vector3d(0, 0, 0.5)).norm(), 1e-12);
  EXPECT_TRUE(track.At(0) && track.At(11));
  EXPECT_FALSE(track.At(-0.01));
  EXPECT_FALSE(track.At(11.01));
  EXPECT_FALSE(track.At(5));
}

TEST(PoseTrack, FindsTheShiftOfItsClock) {
  constexpr double kShift = 0.137;
  constexpr unsigned kSeeds = 6;
  double squares = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    Random random(seed);
    const auto shift = FindTrackShift(Robot(kShift, 1, &random), Frames(), {});
    ASSERT_TRUE(shift);
    EXPECT_LT(shift->sigma, 1e-3);
    const double error = (shift->value - kShift) / shift->sigma;
    EXPECT_LT(std::abs(error), 4.5) << seed;
    squares += error * error / kSeeds;
  }
  EXPECT_GT(squares, 0.2);
  EXPECT_LT(squares, 2.5);
}

// Poses logged so often that two neighbours differ by their errors more than by the motion.
TEST(PoseTrack, AveragesTheErrorsOfLoggedPoses) {
  Random random(3);
  const PoseTrack track = Robot(0, 1, &random);
  double squares = 0;
  int count = 0;
  for (const TimedFrame& frame : Frames()) {
    const std::optional<RigidTransform> pose = track.At(frame.time);
    ASSERT_TRUE(pose);
    const RigidTransform truth =
        kBaseTarget * TargetAt(frame.time).Inverse() * kGripperRig.Inverse();
    squares += (pose->t - truth.t).squaredNorm();
    count += 3;
  }
  const double error = std::sqrt(squares / count);
  EXPECT_LT(error, 0.5 * kPositionNoise);
  EXPECT_NEAR(error / track.Errors().position, 1, 0.3);
  EXPECT_EQ(track.Errors().frames, 1);
}

TEST(PoseTrack, OfOneClockHasNoShift) {
  int shifts = 0;
  for (unsigned seed = 1; seed <= 2; ++seed) {
    Random random(seed);
    shifts += FindTrackShift(Robot(0, 1, &random), Frames(), {}) ? 1 : 0;
  }
  EXPECT_EQ(shifts, 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
