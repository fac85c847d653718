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
PoseTrack Robot(double shift,
                double noise,
                Random* random,
                double frame_interval = kFrameInterval) {
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
  return {times, poses, frame_interval};
}

// Poses of a calibration with an error of the focal length and of both coordinates of the principal
// point, of this part of the focal length.
std::vector<TimedFrame> Frames(double calibration_error, Random* random) {
  constexpr int kFrames = 40;
  const Eigen::Vector3d error(random->Gaussian(1), random->Gaussian(1), random->Gaussian(1));
  std::vector<TimedFrame> frames;
  for (int f = 0; f < kFrames; ++f) {
    const double time = kFrameInterval * f + 0.003;
    const RigidTransform T = TargetAt(time);
    Eigen::Matrix<double, 6, 3> shared = Eigen::Matrix<double, 6, 3>::Zero();
    shared(2, 0) = shared(0, 1) = shared(1, 2) = calibration_error * T.t.z();
    shared(4, 1) = calibration_error;
    frames.push_back({time, Retract(T, -shared * error), {.shared = shared}});
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
  EXPECT_LT((half->pose.t - Eigen::Vector3d(0.5, 1, 1.5)).norm(), 1e-12);
  EXPECT_LT((LogRotation(half->pose.R) - Eigen::Vector3d(0, 0, 0.5)).norm(), 1e-12);
  EXPECT_LT((half->velocity - (Vector6d() << 1, 2, 3, 0, 0, 1).finished()).norm(), 1e-12);
  EXPECT_TRUE(track.At(0) && track.At(11));
  EXPECT_FALSE(track.At(-0.01));
  EXPECT_FALSE(track.At(11.01));
  EXPECT_FALSE(track.At(5));
}

// The base is moved by 1 m in a gap that is shorter than the time over which poses are averaged.
TEST(PoseTrack, AveragesNoPosesBeyondAGap) {
  Random random(3);
  constexpr double kGapBegin = 10, kGapEnd = 10.03;
  std::vector<double> times;
  std::vector<RigidTransform> poses;
  const auto truth = [](double time) {
    RigidTransform T = kBaseTarget * TargetAt(time).Inverse() * kGripperRig.Inverse();
    if (time > kGapBegin) T.t.x() += 1;
    return T;
  };
  for (int i = 0; i < 2000; ++i) {
    const double time = 0.01 * i + 0.005;
    if (time > kGapBegin && time < kGapEnd) continue;
    RigidTransform T = truth(time);
    for (double& t : T.t) t += random.Gaussian(kPositionNoise);
    times.push_back(time);
    poses.push_back(T);
  }
  const PoseTrack track(times, poses, 0.13);
  for (const double time : {9.5, 9.95, 9.98, 9.994, 10.036, 10.05, 10.08, 10.5}) {
    const auto at = track.At(time);
    ASSERT_TRUE(at) << time;
    EXPECT_LT((at->pose.t - truth(time).t).norm(), 6 * kPositionNoise) << time;
  }
  EXPECT_FALSE(track.At(10.015));
}

struct Shift {
  double value = 0, sigma = 0;
};

Shift ShiftOf(const PoseTrack& track, std::span<const TimedFrame> frames) {
  OutsideOptions options;
  const double shift = FindTrackShift(track, frames, &options);
  const auto fit = FitOutsidePoses(MatchTrack(track, frames, shift).poses, options);
  EXPECT_TRUE(fit);
  return {shift, fit ? fit->time_shift_sigma : 0};
}

// Mean square of the errors in standard errors, of robots whose clock is so far ahead.
double SquareOfShifts(double clock, unsigned seeds, double calibration_error) {
  double squares = 0;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    Random random(seed);
    const PoseTrack robot = Robot(clock, 1, &random);
    const Shift shift = ShiftOf(robot, Frames(calibration_error, &random));
    EXPECT_LT(shift.sigma, 1e-3);
    const double error = (shift.value - clock) / shift.sigma;
    EXPECT_LT(std::abs(error), 4.5) << seed;
    squares += error * error / seeds;
  }
  return squares;
}

TEST(PoseTrack, FindsTheShiftOfItsClock) {
  // The second: images at the times of logged poses, where the errors of poses and velocities
  // between are correlated.
  for (const double clock : {0.137, -0.003}) {
    const double squares = SquareOfShifts(clock, 5, 0);
    EXPECT_GT(squares, 0.2) << clock;
    EXPECT_LT(squares, 2.5) << clock;
  }
}

// Errors of the calibration move all its poses together, by where they are.
TEST(PoseTrack, HasAShiftWithTheErrorsOfTheCalibration) {
  const double squares = SquareOfShifts(0.137, 8, 3e-3);
  EXPECT_GT(squares, 0.4);
  EXPECT_LT(squares, 2);
}

TEST(PoseTrack, OfARigAtRestHasAnOpenShift) {
  Random random(1);
  const PoseTrack robot = Robot(0, 1, &random);
  std::vector<double> times;
  std::vector<RigidTransform> poses;
  std::vector<TimedFrame> frames;
  for (int stop = 0; stop < 12; ++stop) {
    for (int i = 0; i < 100; ++i) {
      times.push_back(2 * stop + 0.01 * i);
      RigidTransform T = kBaseTarget * TargetAt(2 * stop).Inverse() * kGripperRig.Inverse();
      for (double& t : T.t) t += random.Gaussian(kPositionNoise);
      T.R = T.R * ExpRotation({random.Gaussian(kAngleNoise), 0, random.Gaussian(kAngleNoise)});
      poses.push_back(T);
    }
    frames.push_back({2 * stop + 0.503, TargetAt(2 * stop)});
  }
  const Shift shift = ShiftOf({times, poses, 2}, frames);
  EXPECT_EQ(shift.value, 0);
  EXPECT_TRUE(std::isinf(shift.sigma)) << shift.sigma;
}

// Poses logged so often that two neighbours differ by their errors more than by the motion.
// A cubic through n poses has about 9 / 4 of the variance of a pose over n in its middle.
TEST(PoseTrack, AveragesNoLongerThanFramesAreApart) {
  const auto averaged = [](double frame_interval) {
    Random random(4);
    const TrackErrors errors = Robot(0, 1, &random, frame_interval).Errors();
    EXPECT_NEAR(errors.single_position, kPositionNoise, 0.2 * kPositionNoise);
    return errors.position / errors.single_position;
  };
  EXPECT_GT(averaged(0.05), 0.75) << "up to five poses";
  const double twelve = averaged(0.13);
  EXPECT_LT(twelve, 0.55);
  EXPECT_GT(twelve, 0.35);
  EXPECT_LT(averaged(kFrameInterval), 0.3);
}

TEST(PoseTrack, AveragesTheErrorsOfLoggedPoses) {
  Random random(3);
  const PoseTrack track = Robot(0, 1, &random);
  double squares = 0;
  int count = 0;
  for (const TimedFrame& frame : Frames(0, &random)) {
    const auto at = track.At(frame.time);
    ASSERT_TRUE(at);
    const RigidTransform truth =
        kBaseTarget * TargetAt(frame.time).Inverse() * kGripperRig.Inverse();
    squares += (at->pose.t - truth.t).squaredNorm();
    count += 3;
  }
  const double error = std::sqrt(squares / count);
  EXPECT_LT(error, 0.5 * kPositionNoise);
  EXPECT_NEAR(error / track.Errors().position, 1, 0.3);
  EXPECT_EQ(track.Errors().frames, 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
