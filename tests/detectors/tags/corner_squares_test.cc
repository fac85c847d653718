// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/corner_squares.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr int kWidth = 8;     // bits
constexpr double kBit = 5.0;  // px

/// Tags of one colour in a row, turned a little, with squares of a bit and a half beyond some of
/// their corners.
struct Tags {
  cv::Mat gray{120, 420, CV_8U, cv::Scalar(0)};
  std::vector<SeenTag> tags;
  TagBorder border{.width = kWidth};

  /// `with_square(tag, corner)`; a white tag on black has squares of white.
  template <typename WithSquare>
  explicit Tags(const WithSquare& with_square, bool black = true, double bit = kBit) {
    border.outside_sign = black ? 1 : -1;
    const double inner = black ? 30 : 220, outer = black ? 200 : 60;
    gray = outer;
    for (int t = 0; t < 4; ++t) {
      const Eigen::Isometry2d image_by_bits = Eigen::Translation2d(60 + 100 * t, 60) *
                                              Eigen::Rotation2Dd(0.15) *
                                              Eigen::Isometry2d::Identity();
      SeenTag tag;
      const double half = kWidth / 2.0;
      // From the lower left against the clock, y down.
      const std::array<Eigen::Vector2d, 4> corners{Eigen::Vector2d(-half, half),
                                                   Eigen::Vector2d(half, half),
                                                   Eigen::Vector2d(half, -half),
                                                   Eigen::Vector2d(-half, -half)};
      for (size_t k = 0; k < 4; ++k) tag.corners[k] = image_by_bits * (bit * corners[k]);
      tags.push_back(tag);
      for (int y = 0; y < gray.rows; ++y) {
        for (int x = 0; x < gray.cols; ++x) {
          const Eigen::Vector2d at = image_by_bits.inverse() * Eigen::Vector2d(x, y) / bit;
          bool is_inner = at.cwiseAbs().maxCoeff() < half;
          for (size_t k = 0; k < 4; ++k) {
            const Eigen::Vector2d beyond = (at - corners[k]).cwiseProduct(corners[k].cwiseSign());
            is_inner = is_inner || (with_square(t, static_cast<int>(k)) && beyond.minCoeff() > 0 &&
                                    beyond.maxCoeff() < 1.5);
          }
          if (is_inner) gray.at<uchar>(y, x) = cv::saturate_cast<uchar>(inner);
        }
      }
    }
  }
  [[nodiscard]] std::optional<bool> Shows() const { return ShowsCornerSquares(gray, tags, border); }
};

TEST(CornerSquares, AreSeenOrNot) {
  for (const bool black : {true, false}) {
    EXPECT_EQ(Tags([](int, int) { return true; }, black).Shows(), true);
    EXPECT_EQ(Tags([](int, int) { return false; }, black).Shows(), false);
  }
}

TEST(CornerSquares, AreThoseOfThreeQuartersOfTheCorners) {
  // Of each corner alone, then of a growing number of tags.
  for (int corner = 0; corner < 4; ++corner) {
    EXPECT_EQ(Tags([&](int, int k) { return k == corner; }).Shows(), false) << corner;
    EXPECT_EQ(Tags([&](int, int k) { return k != corner; }).Shows(), true) << corner;
    EXPECT_EQ(Tags([&](int, int k) { return k == corner || k == (corner + 1) % 4; }).Shows(),
              std::nullopt);
  }
  EXPECT_EQ(Tags([](int t, int k) { return t > 0 || k == 0; }).Shows(), true) << "13 of 16";
  EXPECT_EQ(Tags([](int t, int k) { return t > 1 || (t == 1 && k < 3); }).Shows(), std::nullopt)
      << "11 of 16";
}

TEST(CornerSquares, NeedFourCornersAndLargeBits) {
  Tags tags([](int, int) { return true; });
  tags.tags.resize(1);
  EXPECT_EQ(tags.Shows(), true);
  // Its left corners are beyond the image.
  tags.gray = tags.gray.colRange(60, 420).clone();
  for (Eigen::Vector2d& corner : tags.tags[0].corners) corner.x() -= 60;
  EXPECT_EQ(tags.Shows(), std::nullopt);
  EXPECT_EQ(Tags([](int, int) { return true; }, true, 2.4).Shows(), std::nullopt);
  tags.gray = 90;
  EXPECT_EQ(tags.Shows(), std::nullopt) << "no tag at all";
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
