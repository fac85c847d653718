// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/target_trial.h"

#include <gtest/gtest.h>

#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace {

TargetTrial Try(const SyntheticProblem& problem) {
  const CameraModel& model = *FindModel(CameraModels(), "pinhole-radial3");
  return TryTarget(problem.input, 3e-4, {0}, model, {});
}

TEST(TryTarget, RefinesATargetWhosePointsAreNotWhereTheyShouldBe) {
  const TargetTrial trial =
      Try(MakeProblem(5, {.frames = 15, .noise = 0.1, .marker_tolerance = 3e-4}));
  EXPECT_TRUE(trial.refine);
  EXPECT_LT(trial.probability, 1e-3);
  EXPECT_LT(trial.rms_refined, 0.7 * trial.rms_rigid);
}

TEST(TryTarget, HoldsAnExactTarget) {
  for (const unsigned seed : {5U, 6U, 7U}) {
    const TargetTrial trial = Try(MakeProblem(seed, {.frames = 15, .noise = 0.1}));
    EXPECT_FALSE(trial.refine) << seed;
    EXPECT_NEAR(trial.rms_refined / trial.rms_rigid, 1, 0.1) << seed;
  }
}

}  // namespace
}  // namespace plenocal::testing
