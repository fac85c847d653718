// SPDX-License-Identifier: Apache-2.0
//
// The best model is in its confidence set as often as stated, and bad ones are not.
#include "assess/held_out/confidence_set.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

// Losses of 30 frames, which share most of their noise between models.
Eigen::MatrixXd Losses(unsigned seed, const std::vector<double>& excess) {
  Random random(seed);
  Eigen::MatrixXd losses(30, std::ssize(excess));
  for (Eigen::Index f = 0; f < losses.rows(); ++f) {
    const double frame = random.Gaussian(0.5);
    for (Eigen::Index m = 0; m < losses.cols(); ++m) {
      losses(f, m) = frame + excess[static_cast<size_t>(m)] + random.Gaussian(0.05);
    }
  }
  return losses;
}

TEST(ConfidenceSet, HasTheBestAndNoneThatIsWorse) {
  constexpr int kTrials = 200;
  int best = 0, other = 0, worse = 0;
  for (unsigned seed = 0; seed < kTrials; ++seed) {
    const std::vector<double> p = ConfidenceSetProbabilities(Losses(seed, {0.1, 0, 0, 0.5}), 1000);
    worse += p[0] >= kOutsideConfidenceSet || p[3] >= kOutsideConfidenceSet ? 1 : 0;
    best += p[1] >= kOutsideConfidenceSet ? 1 : 0;
    other += p[2] >= kOutsideConfidenceSet ? 1 : 0;
    EXPECT_EQ(std::max(p[1], p[2]), 1);
  }
  EXPECT_GE(best, 0.88 * kTrials);
  EXPECT_GE(other, 0.88 * kTrials);
  EXPECT_LT(best + other, 2 * kTrials);  // or the test has no level
  EXPECT_EQ(worse, 0);
}

TEST(ConfidenceSet, HasAllThatAreEqual) {
  const std::vector<double> p = ConfidenceSetProbabilities(Eigen::MatrixXd::Ones(10, 3), 5);
  EXPECT_EQ(p, std::vector<double>(3, 1));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
