// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/saddle.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "tests/detectors/render.h"

namespace plenocal::internal {
namespace TEST_FILE {

using testing::GrayFunction;
using testing::Render;

constexpr double kWhite = 200, kBlack = 40;
const cv::Size kImage(61, 61);
const Eigen::Vector2d kCorner(30.3, 29.6);

/// Squares that meet at `kCorner`, bright where u and v have equal signs.
struct Crossing {
  Eigen::Vector2d u, v;  ///< px, to the next corners
  double curvature = 0;  ///< 1/px, of the line along u

  double operator()(const Eigen::Vector2d& x) const {
    Eigen::Matrix2d squares;
    squares << u, v;
    Eigen::Vector2d q = x - kCorner;
    // The line along u is bent towards the direction 90 degrees clockwise of it.
    const Eigen::Vector2d along = u.normalized(), across(-along.y(), along.x());
    q -= across * curvature / 2 * q.dot(along) * q.dot(along);
    const Eigen::Vector2d s = squares.inverse() * q;
    return s.x() * s.y() > 0 ? kWhite : kBlack;
  }
  [[nodiscard]] SaddleGuess Guess(const Eigen::Vector2d& off) const {
    SaddleGuess guess;
    guess.p = kCorner + off;
    guess.u = u;
    guess.v = v;
    guess.curvature_u = curvature;
    return guess;
  }
};

Crossing Turned(double angle, double between) {
  const auto vector = [](double direction) -> Eigen::Vector2d {
    return 16 * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  };
  return {vector(angle), vector(angle + between), 0};
}

TEST(FitSaddle, SignOfContrastIsThatOfTheQuadrants) {
  const Crossing crossing = Turned(0.2, 1.5);
  const cv::Mat gray = 255 - Render(crossing, kImage, {.blur = 0.7});
  const auto saddle = FitSaddle(gray, crossing.Guess({0, 0}));
  ASSERT_TRUE(saddle);
  EXPECT_LT(saddle->contrast, 0);
}

TEST(FitSaddle, SigmaIsThatOfTheScatter) {
  const Crossing crossing = Turned(0.4, 1.4);
  double square = 0, normalised = 0;
  constexpr int kSeeds = 60;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const cv::Mat gray = Render(crossing, kImage, {.blur = 0.8, .noise = 5, .seed = seed});
    const auto saddle = FitSaddle(gray, crossing.Guess({0.3, 0.2}));
    ASSERT_TRUE(saddle);
    const Eigen::Vector2d error = saddle->p - kCorner;
    square += error.squaredNorm();
    normalised += error.squaredNorm() / (saddle->sigma * saddle->sigma);
  }
  // Of 120 coordinates the mean of chi^2 has a standard deviation of 0.13.
  EXPECT_NEAR(normalised / (2 * kSeeds), 1, 0.45);
  EXPECT_LT(std::sqrt(square / (2 * kSeeds)), 0.1);
}

TEST(FitSaddle, CurvatureThatIsKnownDoesNotMoveTheCorner) {
  Crossing crossing = Turned(0.1, 1.5);
  crossing.curvature = 0.01;
  const cv::Mat gray = Render(crossing, kImage, {.blur = 0.7});
  const auto curved = FitSaddle(gray, crossing.Guess({0, 0}));
  SaddleGuess straight_guess = crossing.Guess({0, 0});
  straight_guess.curvature_u = 0;
  const auto straight = FitSaddle(gray, straight_guess);
  ASSERT_TRUE(curved && straight);
  EXPECT_LT((curved->p - kCorner).norm(), 0.02);
  EXPECT_GT((straight->p - kCorner).norm(), 0.05);
}

TEST(FitSaddle, PrintedMarkersOutsideTheClearStripDoNotMatter) {
  const Crossing crossing = Turned(0, 1.5708);
  constexpr double kClear = 0.25;
  // Black where a marker may be: beyond the clear strip of the white quadrants.
  const GrayFunction marked = [&](const Eigen::Vector2d& x) {
    const Eigen::Vector2d s = (x - kCorner) / 16;
    const bool in_marker = s.x() * s.y() > 0 && s.cwiseAbs().minCoeff() > kClear;
    return in_marker ? kBlack : crossing(x);
  };
  SaddleGuess guess = crossing.Guess({0.5, 0.5});
  guess.clear = kClear;
  guess.blur = 0.6;
  const auto saddle = FitSaddle(Render(marked, kImage, {.blur = 0.6}), guess);
  ASSERT_TRUE(saddle);
  EXPECT_LT((saddle->p - kCorner).norm(), 0.03);
}

TEST(FitSaddle, HasTheBlurOfItsEdges) {
  const Crossing crossing = Turned(0.3, 1.5);
  for (const double blur : {0.7, 1.0, 1.6}) {
    const auto saddle = FitSaddle(Render(crossing, kImage, {.blur = blur}), crossing.Guess({0, 0}));
    ASSERT_TRUE(saddle) << blur;
    EXPECT_NEAR(saddle->blur, std::hypot(blur, std::sqrt(1 / 12.0)), 0.02) << "and a pixel's area";
  }
}

TEST(FitSaddle, RefusesWhatIsNoCrossing) {
  const SaddleGuess guess = Turned(0.2, 1.5).Guess({0, 0});
  const GrayFunction edge = [](const Eigen::Vector2d& x) {
    return x.x() > kCorner.x() ? kWhite : kBlack;
  };
  EXPECT_FALSE(FitSaddle(Render(edge, kImage, {.blur = 0.7}), guess));
  cv::Mat noise(kImage, CV_8U);
  cv::RNG random(2);
  random.fill(noise, cv::RNG::UNIFORM, 0, 256);
  EXPECT_FALSE(FitSaddle(noise, guess));
  EXPECT_FALSE(FitSaddle(cv::Mat(kImage, CV_8U, cv::Scalar(90)), guess));
  SaddleGuess tiny = guess;
  tiny.u *= 0.1;
  EXPECT_FALSE(FitSaddle(Render(Turned(0.2, 1.5), kImage, {.blur = 0.7}), tiny))
      << "squares of 1.6 px hold too few pixels";
}

// A chessboard of 6 x 5 inner corners behind a lens of barrel distortion.
struct BentBoard {
  static constexpr int kColumns = 6, kRows = 5;
  static constexpr double kSquare = 26, kBend = 0.015;
  Eigen::Vector2d middle{90.2, 80.4};

  double operator()(const Eigen::Vector2d& x) const {
    const Eigen::Vector2d q = (x - middle) / kSquare;
    const Eigen::Vector2d s = q * (1 + kBend * q.squaredNorm()) + Eigen::Vector2d(2.5, 2);
    const auto square = static_cast<int>(std::floor(s.x()) + std::floor(s.y()));
    return square % 2 == 0 ? kWhite : kBlack;
  }
  [[nodiscard]] Eigen::Vector2d Corner(int row, int column) const {
    const Eigen::Vector2d undistorted(column - 2.5, row - 2);
    Eigen::Vector2d q = undistorted;
    for (int i = 0; i < 50; ++i) q = undistorted / (1 + kBend * q.squaredNorm());
    return middle + kSquare * q;
  }
};

// Straight edges would be off by 0.15 px at the board's border.
TEST(RefineGrid, FollowsBentLinesToTheBorderAndBesideAGap) {
  const BentBoard board;
  const cv::Mat gray = Render(board, {181, 161}, {.blur = 0.7});
  std::vector<std::optional<Eigen::Vector2d>> guesses;
  for (int row = 0; row < BentBoard::kRows; ++row) {
    for (int column = 0; column < BentBoard::kColumns; ++column) {
      guesses.emplace_back(board.Corner(row, column) +
                           0.4 * Eigen::Vector2d(column % 2 == 0 ? 1 : -1, row % 3 - 1));
    }
  }
  constexpr size_t kGap = 2 * BentBoard::kColumns + 3;
  for (const bool gap : {false, true}) {
    if (gap) guesses[kGap].reset();
    const CornerGrid grid = RefineGrid(gray, BentBoard::kColumns, BentBoard::kRows, guesses);
    for (size_t i = 0; i < guesses.size(); ++i) {
      ASSERT_EQ(grid.corners[i].has_value(), guesses[i].has_value()) << i;
      if (!guesses[i]) continue;
      const auto row = static_cast<int>(i) / BentBoard::kColumns;
      const auto column = static_cast<int>(i) % BentBoard::kColumns;
      EXPECT_LT((grid.corners[i]->p - board.Corner(row, column)).norm(), 0.04)
          << "row " << row << ", column " << column << (gap ? ", with a gap" : "");
      EXPECT_EQ(grid.corners[i]->contrast > 0, (row + column) % 2 == 0);
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
