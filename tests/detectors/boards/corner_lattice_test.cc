// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/corner_lattice.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "tests/detectors/render.h"
#include "tests/detectors/render_pattern.h"

namespace plenocal::internal {
namespace TEST_FILE {

using testing::GrayFunction;
using testing::Render;
using testing::TiltedView;

constexpr int kColumns = 7, kRows = 5;  // inner corners

/// A chessboard with corner (0, 0) at the origin and squares of side 1.
double Board(const Eigen::Vector2d& p) {
  const int column = static_cast<int>(std::floor(p.x())), row = static_cast<int>(std::floor(p.y()));
  if (column < -1 || row < -1 || column >= kColumns || row >= kRows) return 200;
  return (column + row) % 2 == 0 ? 40 : 200;
}

/// The farthest that a corner of the board is from the nearest of a lattice, px.
double Farthest(const CornerLattice& lattice, const Eigen::Matrix3d& H) {
  double farthest = 0;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Eigen::Vector2d truth = (H * Eigen::Vector3d(column, row, 1)).hnormalized();
      double nearest = std::numeric_limits<double>::max();
      for (const Eigen::Vector2d& p : lattice.corners) {
        nearest = std::min(nearest, (p - truth).norm());
      }
      farthest = std::max(farthest, nearest);
    }
  }
  return farthest;
}

/// Neighbours in the lattice are neighbours on the board: no step is longer than twice the
/// shortest.
void ExpectRegular(const CornerLattice& lattice) {
  double shortest = std::numeric_limits<double>::max(), longest = 0;
  for (int row = 0; row < lattice.rows; ++row) {
    for (int column = 0; column + 1 < lattice.columns; ++column) {
      const std::size_t i = static_cast<std::size_t>(row) * lattice.columns + column;
      const double step = (lattice.corners[i + 1] - lattice.corners[i]).norm();
      shortest = std::min(shortest, step);
      longest = std::max(longest, step);
    }
  }
  EXPECT_LT(longest, 2 * shortest);
}

/// The first of the lattices with the board's size, with its columns along the board's.
CornerLattice BoardAmong(const std::vector<CornerLattice>& lattices) {
  for (const CornerLattice& lattice : lattices) {
    if (lattice.columns == kColumns && lattice.rows == kRows) return lattice;
    if (lattice.columns == kRows && lattice.rows == kColumns) return Transposed(lattice);
  }
  return {};
}

TEST(FindCornerLattices, FindsBoardsOfAllSizes) {
  for (const double pitch : {7.0, 15.0, 45.0}) {
    for (const double turn : {0.0, 0.5, 2.5}) {
      const Eigen::Matrix3d H = testing::CentredView(pitch, turn, {3, 2}, {240, 200});
      const cv::Mat gray = Render(
          testing::View(Board, H), {480, 400}, {.blur = 0.7, .noise = 3, .supersampling = 4});
      const CornerLattice lattice = BoardAmong(FindCornerLattices(gray, 20));
      ASSERT_EQ(lattice.corners.size(), 35u) << pitch << " px, turned by " << turn;
      EXPECT_LT(Farthest(lattice, H), std::max(1.0, 0.1 * pitch)) << pitch << " px, " << turn;
      ExpectRegular(lattice);
    }
  }
}

TEST(FindCornerLattices, CompletesCornersThatAreHidden) {
  const Eigen::Matrix3d H = TiltedView(24, 0.2, 100, 60);
  cv::Mat gray = Render(testing::View(Board, H), {400, 300}, {.blur = 0.8, .supersampling = 4});
  const Eigen::Vector2d hidden = (H * Eigen::Vector3d(3, 2, 1)).hnormalized();
  cv::circle(
      gray, {static_cast<int>(hidden.x()), static_cast<int>(hidden.y())}, 9, cv::Scalar(128), -1);
  const CornerLattice lattice = BoardAmong(FindCornerLattices(gray, 20));
  ASSERT_EQ(lattice.corners.size(), 35u);
  EXPECT_LT(Farthest(lattice, H), 2.5);
}

TEST(FindCornerLattices, FindsNothingInTexture) {
  for (const cv::Mat& image : testing::EmptyImages()) {
    EXPECT_TRUE(FindCornerLattices(image, 12).empty());
  }
  const GrayFunction stripes = [](const Eigen::Vector2d& x) {
    return static_cast<int>(std::floor(x.x() / 9)) % 2 == 0 ? 40.0 : 200.0;
  };
  EXPECT_TRUE(FindCornerLattices(Render(stripes, {320, 240}, {.blur = 1}), 12).empty());
}

TEST(FindCornerLattices, WantsAsManyCornersAsItIsAsked) {
  const cv::Mat gray = Render(testing::View(Board, TiltedView(20, 0, 60, 60)),
                              {320, 240},
                              {.blur = 0.7, .supersampling = 4});
  EXPECT_FALSE(FindCornerLattices(gray, kColumns * kRows).empty());
  EXPECT_TRUE(FindCornerLattices(gray, kColumns * kRows + 1).empty());
}

TEST(Transposed, ExchangesColumnsAndRows) {
  const CornerLattice lattice{3, 2, {{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}}};
  const CornerLattice transposed = Transposed(lattice);
  EXPECT_EQ(transposed.columns, 2);
  EXPECT_EQ(transposed.rows, 3);
  EXPECT_EQ(transposed.corners[1], Eigen::Vector2d(0, 1));
  EXPECT_EQ(transposed.corners[2], Eigen::Vector2d(1, 0));
  EXPECT_EQ(Transposed(transposed).corners, lattice.corners);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
