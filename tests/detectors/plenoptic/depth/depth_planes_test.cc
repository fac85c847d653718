// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_planes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <random>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr float kSigma = 0.002f;  // of inverse depth
constexpr int kSide = 80;
const FlatPart kPart{{20, 20}, {60, 20}, {60, 60}, {20, 60}};

double Truth(int x, int y) { return 3 + 0.004 * x - 0.002 * y; }

/// A plane in virtual depth with noise over blocks of 8 x 8 pixels, which is how estimates of 5 x 5
/// raw pixels at v = 3 to 3.5 depend on each other.
VirtualDepth NoisyPlane() {
  VirtualDepth depth;
  depth.scale = 2;
  depth.inverse.create(kSide, kSide, CV_32F);
  depth.sigma = cv::Mat(kSide, kSide, CV_32F, cv::Scalar(kSigma));
  depth.known = cv::Mat(kSide, kSide, CV_8U, cv::Scalar(255));
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, kSigma);
  constexpr int kBlock = 8;
  double blocks[kSide / kBlock][kSide / kBlock];
  for (auto& row : blocks) {
    for (double& block : row) block = noise(random);
  }
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      depth.inverse.at<float>(y, x) =
          static_cast<float>(1 / Truth(x, y) + blocks[y / kBlock][x / kBlock]);
    }
  }
  return depth;
}

void ExpectPlane(const VirtualDepth& depth) {
  for (int y = 22; y < 59; ++y) {
    for (int x = 22; x < 59; ++x) {
      const float sigma = depth.sigma.at<float>(y, x);
      EXPECT_LT(sigma, kSigma);
      EXPECT_NEAR(depth.inverse.at<float>(y, x), 1 / Truth(x, y), 3.5 * sigma);
      EXPECT_EQ(depth.known.at<uchar>(y, x), 255);
    }
  }
}

TEST(FlattenParts, ReplacesNoiseByThePlaneInsideThePart) {
  VirtualDepth depth = NoisyPlane();
  const VirtualDepth before = NoisyPlane();
  EXPECT_EQ(FlattenParts({kPart}, 0, &depth), 1u);
  ExpectPlane(depth);
  cv::Mat outside(kSide, kSide, CV_8U, cv::Scalar(255));
  outside(cv::Rect(20, 20, 41, 41)).setTo(0);
  EXPECT_EQ(cv::norm(depth.inverse, before.inverse, cv::NORM_INF, outside), 0);
  EXPECT_EQ(cv::norm(depth.sigma, before.sigma, cv::NORM_INF, outside), 0);
}

TEST(FlattenParts, StatesTheErrorThatAPartShares) {
  VirtualDepth alone = NoisyPlane(), shared = NoisyPlane();
  constexpr double kCommon = 0.003;
  FlattenParts({kPart}, 0, &alone);
  FlattenParts({kPart}, kCommon, &shared);
  EXPECT_EQ(cv::norm(alone.inverse, shared.inverse, cv::NORM_INF), 0);
  EXPECT_NEAR(shared.sigma.at<float>(40, 40),
              std::hypot(alone.sigma.at<float>(40, 40), kCommon * alone.inverse.at<float>(40, 40)),
              1e-6);
}

TEST(FlattenParts, IgnoresOutliersAndFillsWhatIsUnknown) {
  VirtualDepth depth = NoisyPlane();
  depth.inverse(cv::Rect(22, 22, 12, 12)).setTo(0.45);  // chance matches
  depth.inverse(cv::Rect(45, 40, 10, 10)).setTo(0.1);
  depth.known(cv::Rect(45, 40, 10, 10)).setTo(0);
  EXPECT_EQ(FlattenParts({kPart}, 0, &depth), 1u);
  ExpectPlane(depth);
}

TEST(FlattenParts, LeavesAPartWithoutDepthAlone) {
  VirtualDepth depth = NoisyPlane();
  depth.known.setTo(0);
  EXPECT_EQ(FlattenParts({kPart}, 0, &depth), 0u);
  EXPECT_EQ(cv::norm(depth.inverse, NoisyPlane().inverse, cv::NORM_INF), 0);
}

TEST(FlattenParts, TakesPartsThatReachBeyondTheImage) {
  VirtualDepth depth = NoisyPlane();
  EXPECT_EQ(FlattenParts({{{-15, 20}, {60, -10}, {95, 60}, {30, 100}}}, 0, &depth), 1u);
  EXPECT_NEAR(depth.inverse.at<float>(40, 40), 1 / Truth(40, 40), kSigma);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
