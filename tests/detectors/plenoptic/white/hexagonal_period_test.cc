// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/hexagonal_period.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

namespace plenocal::internal {
namespace {

/// Three plane waves at 60 degrees: a hexagonal lattice of maxima whose period is exact.
cv::Mat Waves(double pitch, double rotation) {
  cv::Mat image(400, 500, CV_32F, cv::Scalar(0));
  for (int i = 0; i < 3; ++i) {
    const double angle = rotation + std::numbers::pi / 6 + i * std::numbers::pi / 3;
    const Eigen::Vector2d k = 4 * std::numbers::pi / (std::sqrt(3) * pitch) *
                              Eigen::Vector2d(std::cos(angle), std::sin(angle));
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        image.at<float>(y, x) += static_cast<float>(std::cos(k.x() * x + k.y() * y));
      }
    }
  }
  return image;
}

TEST(FindHexagonalPeriod, FindsPitchAndRotation) {
  for (const double pitch : {8.0, 13.3, 24.7, 51.0}) {
    for (const double degrees : {0.0, 7.0, -23.0, 29.0}) {
      const double rotation = degrees * std::numbers::pi / 180;
      const auto basis = FindHexagonalPeriod(Waves(pitch, rotation));
      ASSERT_TRUE(basis) << pitch << " " << degrees;
      Eigen::Matrix2d truth;
      truth << Eigen::Rotation2Dd(rotation) * Eigen::Vector2d(pitch, 0),
          Eigen::Rotation2Dd(rotation + std::numbers::pi / 3) * Eigen::Vector2d(pitch, 0);
      EXPECT_LT((*basis - truth).norm(), 0.02 * pitch) << pitch << " " << degrees;
    }
  }
}

TEST(FindHexagonalPeriod, FindsNoneInNoiseOrInASquareLattice) {
  cv::Mat noise(400, 500, CV_32F);
  cv::theRNG().state = 7;
  cv::randn(noise, 0, 1);
  EXPECT_FALSE(FindHexagonalPeriod(noise));
  cv::Mat square(400, 500, CV_32F);
  for (int y = 0; y < square.rows; ++y) {
    for (int x = 0; x < square.cols; ++x) {
      square.at<float>(y, x) = static_cast<float>(std::cos(0.4 * x) + std::cos(0.4 * y));
    }
  }
  EXPECT_FALSE(FindHexagonalPeriod(square));
}

}  // namespace
}  // namespace plenocal::internal
