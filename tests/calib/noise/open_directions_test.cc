// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/open_directions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::Pair;

TEST(OpenDirections, SampleNoiseIsTheMeanOfBothSignsLessTheEstimate) {
  const auto scalar = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  const NoisyInformation noisy = SampleNoise(scalar(3), [&](unsigned sample, double sign) {
    return scalar(3 + 100 * sign + 2.0 * sample);
  });
  EXPECT_EQ(noisy.information, scalar(3));
  ASSERT_EQ(noisy.of_noise.size(), 16U);
  for (size_t sample = 0; sample < 16; ++sample) {
    EXPECT_DOUBLE_EQ(noisy.of_noise[sample](0, 0), 2.0 * static_cast<double>(sample));
  }
}

// Three unknowns: motion determines the sum and the difference of the first two, noise makes the
// information on the third and a tenth of that on the difference.
NoisyInformation SumDifferenceAndNoise() {
  Eigen::Matrix3d axes;
  axes << 1, 1, 0, 1, -1, 0, 0, 0, 1;
  NoisyInformation noisy{axes * Eigen::Vector3d(1e4, 100, 1).asDiagonal() * axes.transpose(), {}};
  testing::Random random(1);
  for (int sample = 0; sample < 16; ++sample) {
    const Eigen::Vector3d errors = random.Gaussians<3>(1);
    noisy.of_noise.emplace_back(
        axes * Eigen::Vector3d(0, 10, errors.squaredNorm() / 3).asDiagonal() * axes.transpose());
  }
  return noisy;
}

TEST(OpenDirections, AreThoseWhoseInformationIsNoise) {
  for (const Eigen::Vector3d& unit : {Eigen::Vector3d(1, 1, 1), Eigen::Vector3d(2, 3, 0.1)}) {
    const DeterminedPart part = Separate(SumDifferenceAndNoise(), unit);
    ASSERT_EQ(part.open.cols(), 1);
    EXPECT_NEAR(part.open(0, 0), 0, 1e-9);
    EXPECT_NEAR(part.open(1, 0), 0, 1e-9);
    EXPECT_NEAR(std::abs(part.open(2, 0)), unit[2], 1e-9);
    // Variances along (1, 1) / 2 and (1, -1) / 2: 1 / I, and I / (I - N)^2.
    Eigen::Matrix3d expected = Eigen::Matrix3d::Zero();
    const double sum = 1e-4, difference = 100 / std::pow(100 - 10, 2);
    expected.topLeftCorner<2, 2>() << sum + difference, sum - difference, sum - difference,
        sum + difference;
    EXPECT_LT((part.covariance - expected / 4).norm(), 1e-6 * expected.norm()) << part.covariance;
  }
}

TEST(OpenDirections, AreNoneWithoutNoise) {
  NoisyInformation noisy = SumDifferenceAndNoise();
  for (Eigen::MatrixXd& sample : noisy.of_noise) sample.setZero();
  const DeterminedPart part = Separate(noisy, Eigen::Vector3d(2, 3, 0.1));
  EXPECT_EQ(part.open.cols(), 0);
  EXPECT_LT((part.covariance * noisy.information - Eigen::Matrix3d::Identity()).norm(), 1e-9);
}

TEST(OpenDirections, ADescriptionHasTheLargestSharesFirst) {
  const OpenDirection described =
      Describe(Eigen::Vector4d(0.02, -0.4, 0.05, 0.044), 5, {"a", "b", "c", "d"});
  EXPECT_EQ(described.sigma, 5);
  EXPECT_THAT(described.parts,
              ElementsAre(Pair("b", 1), Pair("c", 0.125), Pair("d", DoubleNear(0.11, 1e-12))));
}

}  // namespace TEST_FILE
}  // namespace plenocal
