// SPDX-License-Identifier: Apache-2.0
//
// Measurement of the corners of chessboards and ChArUco boards.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace plenocal::internal {

/// A chessboard corner before it is measured.
struct SaddleGuess {
  Eigen::Vector2d p;     ///< px
  Eigen::Vector2d u, v;  ///< px, to the next corner along the columns and along the rows
  /// Curvature (1/px) of the board's lines through the corner, along u and along v; positive when
  /// they bend towards the direction 90 degrees clockwise as seen in the image (x to y).
  double curvature_u = 0, curvature_v = 0;
  double blur = 0.8;  ///< px, sigma of the edges' blur (first estimate)
  /// ChArUco: how far (in squares) the printed marker of a white square stays away from the
  /// square's border; 1: there are no markers.
  double clear = 1;
  /// ChArUco: the quadrants that may hold markers: +1 those where u and v have equal signs, -1 the
  /// other two.
  int marked_quadrants = 1;
};

/// A measured corner.
struct Saddle {
  Eigen::Vector2d p;  ///< px
  double sigma = 0;   ///< px, of each coordinate: root of the mean of the two variances
  /// Gray levels. Positive: bright where u and v have equal signs.
  double contrast = 0;
  double blur = 0;  ///< px, sigma of the edges' blur
};

/// Fits the image of two crossing edges to the pixels around a corner. The patch ends before the
/// neighbouring corners' edges. Nothing when there is no such crossing near the guess.
std::optional<Saddle> FitSaddle(const cv::Mat& gray, const SaddleGuess& guess);

/// A rectangular lattice of corners, row-major; what is missing is empty.
struct CornerGrid {
  int columns = 0, rows = 0;
  std::vector<std::optional<Saddle>> corners;
};

/// Refines every corner of `guesses` (same shape as the grid) twice: with straight lines, then with
/// the curvature that the neighbouring corners show (a lens with distortion bends the board's
/// lines, and a straight edge fitted to an arc of curvature k over +-r px misses it by k r^2 / 6).
/// `clear` and `first_marked_quadrants` (of corner 0; neighbours alternate) as in SaddleGuess.
CornerGrid RefineGrid(const cv::Mat& gray,
                      int columns,
                      int rows,
                      const std::vector<std::optional<Eigen::Vector2d>>& guesses,
                      double clear = 1,
                      int first_marked_quadrants = 1);

}  // namespace plenocal::internal
