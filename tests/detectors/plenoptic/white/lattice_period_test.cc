// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/lattice_period.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

namespace plenocal::internal {
namespace TEST_FILE {

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

TEST(FindLatticePeriod, FindsPitchAndRotation) {
  for (const double pitch : {8.0, 13.3, 24.7, 51.0}) {
    for (const double degrees : {0.0, 7.0, -23.0, 29.0}) {
      const double rotation = degrees * std::numbers::pi / 180;
      const auto basis = FindLatticePeriod(Waves(pitch, rotation));
      ASSERT_TRUE(basis) << pitch << " " << degrees;
      Eigen::Matrix2d truth;
      truth << Eigen::Rotation2Dd(rotation) * Eigen::Vector2d(pitch, 0),
          Eigen::Rotation2Dd(rotation + std::numbers::pi / 3) * Eigen::Vector2d(pitch, 0);
      EXPECT_LT((*basis - truth).norm(), 0.02 * pitch) << pitch << " " << degrees;
    }
  }
}

TEST(FindLatticePeriod, FindsRectangles) {
  for (const double across : {16.0, 21.0}) {
    cv::Mat image(400, 500, CV_32F);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        image.at<float>(y, x) = static_cast<float>(std::cos(2 * std::numbers::pi * x / 16) +
                                                   std::cos(2 * std::numbers::pi * y / across));
      }
    }
    const auto basis = FindLatticePeriod(image);
    ASSERT_TRUE(basis) << across;
    EXPECT_LT((*basis - Eigen::Vector2d(16, across).asDiagonal().toDenseMatrix()).norm(), 0.1);
  }
}

TEST(FindLatticePeriod, FindsNoneInNoiseOrStripes) {
  cv::Mat noise(400, 500, CV_32F);
  cv::theRNG().state = 7;
  cv::randn(noise, 0, 1);
  EXPECT_FALSE(FindLatticePeriod(noise));
  cv::Mat stripes(400, 500, CV_32F);
  for (int y = 0; y < stripes.rows; ++y) {
    for (int x = 0; x < stripes.cols; ++x) {
      stripes.at<float>(y, x) = static_cast<float>(std::cos(0.4 * x));
    }
  }
  EXPECT_FALSE(FindLatticePeriod(stripes));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
