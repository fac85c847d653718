// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/time_shift.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "calib/adjust/solver/adjust.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

// A hand's motion: 0.4 and 0.7 Hz.
RigidTransform PoseAt(double time) {
  const double slow = 2 * std::numbers::pi * 0.4 * time, fast = 2 * std::numbers::pi * 0.7 * time;
  RigidTransform T;
  T.R = ExpRotation({0.3 * std::sin(slow), 0.2 * std::cos(fast), 0.2 * std::sin(fast + 1)});
  T.t << 0.2 * std::sin(fast), 0.1 * std::cos(slow), 0.8 + 0.1 * std::sin(slow + 2);
  return T;
}

// Two cameras, frames at 20 Hz in the order of their names; the second is `offset` later, as its
// times say.
struct Moving {
  std::vector<CameraInput> cameras{2};
  std::vector<std::string> frames;
  Bundle bundle;

  explicit Moving(double offset) {
    constexpr double kRate = 20;
    constexpr int kFrames = 30;
    bundle.cameras.resize(2);
    bundle.markers = {{.number = 0, .position = {0, 0, 0}, .nominal = {0.1, 0.1, 0}}};
    for (int f = 0; f < kFrames; ++f) {
      const double time = f / kRate;
      frames.push_back(fmt::format("{:03}", f));
      bundle.T_rig_target.push_back(PoseAt(time));
      for (size_t c = 0; c < 2; ++c) {
        cameras[c].views.push_back({.frame = frames.back(), .observations = {}});
        cameras[c].times[frames.back()] = time + (c == 0 ? 0 : offset);
      }
    }
  }
};

TEST(TimeShift, MovesThePoseToTheTimeOfTheImage) {
  constexpr double kOffset = 0.012, kShift = 0.004;
  Moving moving(kOffset);
  const std::optional<RigTimes> times = TimesOf(moving.cameras, moving.frames);
  ASSERT_TRUE(times);
  EXPECT_NEAR(times->interval, 0.05, 1e-12);
  ASSERT_TRUE(ShowsMotion(moving.bundle, *times));
  AddTimeShifts(*times, &moving.bundle);
  BundleCamera& second = moving.bundle.cameras[1];
  ASSERT_EQ(second.params.size(), 1U);
  EXPECT_FALSE(moving.bundle.cameras[0].Find(nuisances::kTimeShift));
  for (const double linearised_at : {0.0, kShift}) {
    second.params[0] = linearised_at;
    UpdateMotion(*times, &moving.bundle);
    second.params[0] = kShift;
    for (size_t f = 0; f < moving.frames.size(); ++f) {
      const RigidTransform expected = PoseAt(times->frame[f] + kOffset + kShift);
      const RigidTransform found = moving.bundle.PoseAtView(f, 1);
      // The way is 15 mm and 0.02 rad; linear in the shift, and at the ends extrapolated.
      EXPECT_LT((found.t - expected.t).norm(), 1e-4) << f;
      EXPECT_LT(LogRotation(found.R * expected.R.transpose()).norm(), 1e-4) << f;
      EXPECT_LT((moving.bundle.PoseAtView(f, 0).t - PoseAt(times->frame[f]).t).norm(), 1e-12);
    }
  }
}

TEST(TimeShift, NeedsTimesAndFramesThatFollowEachOther) {
  Moving moving(0);
  Random random(1);
  std::optional<RigTimes> times = TimesOf(moving.cameras, moving.frames);
  ASSERT_TRUE(times);
  for (RigidTransform& T : moving.bundle.T_rig_target) T = PoseAt(random.Uniform(0, 100));
  EXPECT_FALSE(ShowsMotion(moving.bundle, *times));
  moving.cameras[1].times.erase("007");
  EXPECT_FALSE(TimesOf(moving.cameras, moving.frames));
  moving.cameras.pop_back();
  EXPECT_FALSE(TimesOf(moving.cameras, moving.frames));
}

TEST(TimeShift, IsFoundByTheAdjustment) {
  constexpr double kShift = 0.004;
  const SyntheticProblem problem = MakeProblem(
      5, {.shape = TargetShape::kCorner, .cameras = 2, .frames = 8, .jitter_translation = 0});
  Bundle bundle = TrueBundle(problem);
  Random random(2);
  bundle.motion.resize(bundle.T_rig_target.size() * 2);
  for (size_t f = 0; f < bundle.T_rig_target.size(); ++f) {
    ViewMotion& motion = bundle.motion[bundle.View(f, 1)];
    for (double& component : motion.at_zero_shift) component = random.Uniform(-0.02, 0.02);
    for (double& component : motion.velocity) component = random.Uniform(-1, 1);
  }
  BundleCamera& second = bundle.cameras[1];
  AddNuisance(nuisances::kTimeShift, 1, &second);
  second.rules.back().prior.reset();
  second.params.back() = kShift;
  // Exact observations at the shifted poses.
  for (BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    observation.used = Residual(bundle, observation, residual);
    for (size_t r = 0; r < 2; ++r) observation.seen.values[r] -= residual[r];
  }
  second.params.back() = 0;
  Vector6d disturbed;
  disturbed << 0.002, -0.003, 0.004, 0.01, -0.008, 0.006;
  second.T_camera_rig = Retract(second.T_camera_rig, disturbed);
  const AdjustSummary summary =
      Adjust(&bundle, {.loss = Loss::kNone, .cost_tolerance = 1e-14, .on_iteration = {}});
  ASSERT_TRUE(summary.usable);
  EXPECT_NEAR(second.params.back(), kShift, 1e-9);
  EXPECT_LT(summary.cost, 1e-9);
  EXPECT_EQ(NuisanceName(second, second.params.size() - 1), second.name + ".time_shift");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
