// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/target_area.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/detectors/render.h"

namespace plenocal::internal {
namespace TEST_FILE {

using testing::GrayFunction;
using testing::Render;

constexpr int kSquares = 8, kHalf = kSquares / 2;
constexpr double kPitch = 20;  // px
const cv::Size kSize(220, 220);

/// A chessboard turned by an angle on a textured ground, and its inner corners.
struct TurnedBoard {
  double angle = 0.3, white = 200;

  [[nodiscard]] Eigen::Matrix2d Turn() const {
    return kPitch * Eigen::Rotation2Dd(angle).toRotationMatrix();
  }
  [[nodiscard]] GrayFunction Scene() const {
    return [turn = Eigen::Matrix2d(Turn().inverse()), white = white](const Eigen::Vector2d& p) {
      const Eigen::Vector2d q = turn * (p - Eigen::Vector2d(110, 110));
      if (q.cwiseAbs().maxCoeff() > kHalf) return p.x() * 1.1;
      return static_cast<int>(std::floor(q.x()) + std::floor(q.y())) % 2 == 0 ? 40.0 : white;
    };
  }
  [[nodiscard]] std::vector<Observation> Corners() const {
    std::vector<Observation> corners;
    for (int i = 1 - kHalf; i < kHalf; ++i) {
      for (int j = 1 - kHalf; j < kHalf; ++j) {
        const Eigen::Vector2d p = Turn() * Eigen::Vector2d(i, j);
        corners.push_back({.marker = 0, .values = {110 + p.x(), 110 + p.y()}});
      }
    }
    return corners;
  }
};

TEST(TargetArea, HasTheBlurOfItsEdges) {
  for (const double angle : {0.0, 0.3, 0.8}) {
    const TurnedBoard board{angle};
    for (const double blur : {1.0, 2.0, 4.0}) {
      const cv::Mat gray = Render(board.Scene(), kSize, {.blur = blur, .noise = 3});
      EXPECT_NEAR(MeasureTargetArea(gray, board.Corners()).blur, blur, 0.3 * blur) << angle;
    }
  }
}

TEST(TargetArea, HasTheBlurOfMotionInOneDirection) {
  const TurnedBoard board;
  cv::Mat gray = Render(board.Scene(), kSize, {.blur = 0.7, .noise = 2});
  const double still = MeasureTargetArea(gray, board.Corners()).blur;
  cv::blur(gray, gray, {11, 1});
  EXPECT_GT(MeasureTargetArea(gray, board.Corners()).blur, 2 * still);
}

TEST(TargetArea, IsSaturatedWhereItHasTheLargestGrayLevel) {
  const auto saturated = [](double white) {
    const TurnedBoard board{0.3, white};
    const cv::Mat gray = Render(board.Scene(), kSize, {.blur = 0.7, .noise = 2});
    return MeasureTargetArea(gray, board.Corners()).saturated;
  };
  EXPECT_EQ(saturated(230), 0);
  EXPECT_NEAR(saturated(300), 0.5, 0.1);
}

TEST(TargetArea, IsNotMeasuredWithoutMarkers) {
  const cv::Mat gray(50, 60, CV_8U, cv::Scalar(255));
  EXPECT_EQ(MeasureTargetArea(gray, {}).blur, 0);
  // A line of markers, markers beyond the image.
  std::vector<Observation> line(5), outside(5);
  for (int i = 0; i < 5; ++i) {
    line[i].values = {10.0 * i, 20};
    outside[i].values = {100.0 + i * i, 100.0 + i};
  }
  EXPECT_EQ(MeasureTargetArea(gray, line).blur, 0);
  EXPECT_EQ(MeasureTargetArea(gray, outside).saturated, 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
