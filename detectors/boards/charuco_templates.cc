// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "detectors/boards/charuco_detector.h"
#include "detectors/templates/board_templates.h"

namespace plenocal::internal {
namespace {

/// Squares of the pattern around a corner, to each side half of them.
constexpr int kSquaresAcross = 4;

/// Lines between the cells of a row of squares, in squares: each square has white around its
/// marker.
std::vector<float> CellLines(const CharucoLayout& board, int marker_width) {
  const double marker = board.marker / board.square, gap = (1 - marker) / 2;
  std::vector<float> lines;
  for (int square = 0; square < kSquaresAcross; ++square) {
    lines.push_back(static_cast<float>(square));
    for (int i = 0; i <= marker_width; ++i) {
      lines.push_back(static_cast<float>(square + gap + i * marker / marker_width));
    }
  }
  lines.push_back(kSquaresAcross);
  return lines;
}

/// Squares with the corner at square (column, row) in their middle; white squares have markers.
CellTemplate DrawAround(const CharucoLayout& board,
                        const CharucoMarkers& aruco,
                        int column,
                        int row) {
  const int per_square = aruco.width + 2;  // with the white around the marker
  const int n = kSquaresAcross * per_square;
  const Eigen::Vector2i origin(column - kSquaresAcross / 2, row - kSquaresAcross / 2);
  std::vector<float> cells(static_cast<size_t>(n * n), 1.f);
  const auto cell = [&](int x, int y) -> float& { return cells.begin()[y * n + x]; };
  const Eigen::Vector2i first = aruco.markers.front().square;
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const Eigen::Vector2i square = origin + Eigen::Vector2i(x / per_square, y / per_square);
      const bool on_board = square.x() >= 0 && square.x() < board.columns && square.y() >= 0 &&
                            square.y() < board.rows;
      if (on_board && (square - first).sum() % 2 != 0) cell(x, y) = -1;
    }
  }
  for (const CharucoMarkers::Marker& marked : aruco.markers) {
    const int x0 = (marked.square.x() - origin.x()) * per_square + 1;
    const int y0 = (marked.square.y() - origin.y()) * per_square + 1;
    if (x0 < 0 || y0 < 0 || x0 >= n || y0 >= n) continue;
    for (int i = 0; i < aruco.width * aruco.width; ++i) {
      if (!marked.white[static_cast<size_t>(i)])
        cell(x0 + i % aruco.width, y0 + i / aruco.width) = -1;
    }
  }
  return {std::move(cells), CellLines(board, aruco.width)};
}

}  // namespace

std::vector<MarkerTemplate> MakeTemplates(const CharucoLayout& layout,
                                          const Target& /*target*/,
                                          const std::vector<Observation>& found) {
  const CharucoMarkers aruco = DrawCharucoMarkers(layout);
  return CornerTemplates(layout.columns - 1, found, kSquaresAcross, [&](int column, int row) {
    return DrawAround(layout, aruco, column + 1, row + 1);
  });
}

}  // namespace plenocal::internal
