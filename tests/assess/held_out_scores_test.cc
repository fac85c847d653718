// SPDX-License-Identifier: Apache-2.0
#include "assess/held_out/held_out_scores.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr size_t kFrames = 20, kPointsOfFrame = 30, kFolds = 5;

// Noise of 1 px, and an error of the model that is the same in all frames.
struct Models {
  std::vector<HeldOutResidual> right, wrong;
};

Models Make(unsigned seed, double error) {
  Random random(seed);
  Models models;
  for (size_t p = 0; p < kFrames * kPointsOfFrame; ++p) {
    HeldOutResidual residual{.imaged = true};
    for (size_t r = 0; r < 2; ++r) residual.values[r] = random.Gaussian(1);
    models.right.push_back(residual);
    residual.values[0] += error * std::sin(static_cast<double>(p % kPointsOfFrame));
    models.wrong.push_back(residual);
  }
  return models;
}

HeldOutScores Scores() {
  std::vector<size_t> frame_of;
  for (size_t p = 0; p < kFrames * kPointsOfFrame; ++p) frame_of.push_back(p / kPointsOfFrame);
  return {frame_of, kFrames, kFolds, 2};
}

TEST(HeldOutScores, AreOverThePointsThatCount) {
  Models models = Make(1, 0);
  HeldOutScores scores = Scores();
  EXPECT_NEAR(scores.Score(models.right).value, std::sqrt(2), 0.1);
  std::vector<bool> good(models.right.size(), true);
  models.right[7].values = {1000, 1000};
  good[7] = false;
  models.right[8].imaged = false;
  scores.SetGood(good);
  EXPECT_LT(scores.Score(models.right).value, 2);
  EXPECT_FALSE(scores.Counts(7, models.right));
  EXPECT_FALSE(scores.Counts(8, models.right));
  const auto count = static_cast<double>(good.size() - 1);
  EXPECT_DOUBLE_EQ(scores.Imaged(models.right), (count - 1) / count);
}

TEST(HeldOutScores, ExcessIsOverThePointsThatBothImage) {
  Models models = Make(2, 0);
  for (HeldOutResidual& residual : models.wrong) residual.values[0] += 1;
  const HeldOutScores scores = Scores();
  EXPECT_NEAR(scores.Excess(models.wrong, models.right), 1, 0.2);
  EXPECT_DOUBLE_EQ(scores.Excess(models.wrong, models.right),
                   -scores.Excess(models.right, models.wrong));
  // A point that one does not image decides nothing, however bad it is for the other.
  const double before = scores.Excess(models.wrong, models.right);
  models.right[3].imaged = false;
  models.wrong[3].values = {1e6, 0};
  EXPECT_NEAR(scores.Excess(models.wrong, models.right), before, 0.05);
}

TEST(HeldOutScores, FindErrorsMuchSmallerThanTheNoise) {
  const HeldOutScores scores = Scores();
  const Models clear = Make(3, 0.3);
  EXPECT_LT(scores.ProbabilityOfEqual(clear.wrong, clear.right), 0.01);
  EXPECT_EQ(scores.ProbabilityOfEqual(clear.right, clear.wrong), 1) << "it is not worse";
  EXPECT_EQ(scores.ProbabilityOfEqual(clear.right, clear.right), 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
