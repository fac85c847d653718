// SPDX-License-Identifier: Apache-2.0
#include "detectors/marker_looks.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>
#include <optional>

#include "detectors/charuco_looks.h"
#include "detectors/tag_looks.h"
#include "detectors/tag_template.h"
#include "detectors/target_drawing.h"

namespace plenocal::internal {
namespace {

std::vector<MarkerLook> LooksOfTags(const Target& target, const std::vector<Observation>& found) {
  // What is around a tag is drawn as far as it is known and blurs into what is next to the tag.
  constexpr double kFarthest = 4;  // bits
  const TagLooks tags = FindTagLooks(target);
  const int around = 1 + static_cast<int>(std::clamp(tags.border.outside, 1.0, kFarthest));
  std::map<int, std::map<int, Eigen::Vector2d>> by_tag;
  for (const Observation& seen : found) {
    by_tag[seen.marker / 4][seen.marker % 4] = {seen.values[0], seen.values[1]};
  }
  std::vector<MarkerLook> looks;
  for (const auto& [id, corners] : by_tag) {
    if (corners.size() < 4) continue;
    const Quad quad{corners.at(0), corners.at(1), corners.at(2), corners.at(3)};
    const Eigen::Matrix3d cells_by_image =
        CellsByUnitSquare(tags.border, around) * UnitSquareHomography(quad).inverse();
    for (int k = 0; k < 4; ++k) {
      looks.push_back({.marker = 4 * id + k,
                       .place = quad[k],
                       .cells_by_image = cells_by_image,
                       .drawing = DrawTag(tags.bits.at(id), tags.border, around),
                       .around = around,
                       .part = id});
    }
  }
  return looks;
}

/// A chessboard of 6 x 6 squares with the corner in its middle.
CellDrawing DrawCorner() {
  constexpr int kSquares = 6;
  std::vector<float> cells;
  cells.reserve(kSquares * kSquares);
  for (int i = 0; i < kSquares * kSquares; ++i) {
    cells.push_back((i / kSquares + i % kSquares) % 2 == 0 ? 1.f : -1.f);
  }
  return {std::move(cells), kSquares};
}

/// 4 x 4 squares of a ChArUco board with the corner at square (column, row) in their middle; in
/// white squares there are markers.
CellDrawing DrawCharucoCorner(const CharucoLayout& board,
                              const CharucoLooks& looks,
                              int column,
                              int row) {
  constexpr int kSquares = 4;
  const int per_square = looks.width + 2;  // with the white around the marker
  const int n = kSquares * per_square;
  const double marker = board.marker / board.square, gap = (1 - marker) / 2;
  std::vector<float> lines;
  for (int square = 0; square < kSquares; ++square) {
    lines.push_back(static_cast<float>(square));
    for (int i = 0; i <= looks.width; ++i) {
      lines.push_back(static_cast<float>(square + gap + i * marker / looks.width));
    }
  }
  lines.push_back(kSquares);
  std::vector<float> cells(static_cast<size_t>(n * n), 1.f);
  const auto cell = [&](int x, int y) -> float& { return cells.begin()[y * n + x]; };
  const Eigen::Vector2i first = looks.markers.front().square;
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const Eigen::Vector2i square(column - kSquares / 2 + x / per_square,
                                   row - kSquares / 2 + y / per_square);
      const bool on_board = square.x() >= 0 && square.x() < board.columns && square.y() >= 0 &&
                            square.y() < board.rows;
      if (on_board && (square - first).sum() % 2 != 0) cell(x, y) = -1;
    }
  }
  for (const CharucoLooks::Marker& marked : looks.markers) {
    const int x0 = (marked.square.x() - column + kSquares / 2) * per_square + 1;
    const int y0 = (marked.square.y() - row + kSquares / 2) * per_square + 1;
    if (x0 < 0 || y0 < 0 || x0 >= n || y0 >= n) continue;
    for (int i = 0; i < looks.width * looks.width; ++i) {
      if (!marked.white[static_cast<size_t>(i)])
        cell(x0 + i % looks.width, y0 + i / looks.width) = -1;
    }
  }
  return {std::move(cells), std::move(lines)};
}

/// The homography from the image to cells that points around a marker tell. The marker itself is
/// where it was found, whatever its neighbours say.
std::optional<Eigen::Matrix3d> CellsByImage(const std::vector<cv::Point2d>& in_image,
                                            const std::vector<cv::Point2d>& in_cells,
                                            const Eigen::Vector2d& marker_in_image,
                                            const Eigen::Vector2d& marker_in_cells) {
  if (in_image.size() < 4) return std::nullopt;
  const cv::Mat H = cv::findHomography(in_image, in_cells);
  if (H.empty()) return std::nullopt;
  Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d cells_by_image =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(H.ptr<double>());
  shift.topRightCorner<2, 1>() =
      marker_in_cells - (cells_by_image * marker_in_image.homogeneous()).hnormalized();
  return shift * cells_by_image;
}

/// Of corners, `columns` in a row. `draw` makes the drawing of the one in a column and row, in
/// whose middle it is, `middle` squares from its edges.
template <typename Draw>
std::vector<MarkerLook> LooksOfBoard(int columns,
                                     const std::vector<Observation>& found,
                                     int middle,
                                     const Draw& draw) {
  std::map<int, Eigen::Vector2d> places;
  for (const Observation& seen : found) places[seen.marker] = {seen.values[0], seen.values[1]};
  std::vector<MarkerLook> looks;
  for (const auto& [marker, place] : places) {
    // The pattern around the corner from the corners next to it.
    std::vector<cv::Point2d> on_board, in_image;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const int column = marker % columns + dx;
        const auto other = places.find(marker + dy * columns + dx);
        if (column < 0 || column >= columns || other == places.end()) continue;
        on_board.emplace_back(middle + dx, middle + dy);
        in_image.emplace_back(other->second.x(), other->second.y());
      }
    }
    const Eigen::Vector2d in_cells(middle, middle);
    const auto cells_by_image = CellsByImage(in_image, on_board, place, in_cells);
    if (!cells_by_image) continue;
    looks.push_back({.marker = marker,
                     .place = place,
                     .cells_by_image = *cells_by_image,
                     .drawing = draw(marker % columns, marker / columns)});
  }
  return looks;
}

std::vector<MarkerLook> LooksOfCircles(const Target& target,
                                       const CirclesLayout& circles,
                                       const std::vector<Observation>& found) {
  constexpr double kAround = 2.9;  // of the distance to the nearest circle: two rows of neighbours
  const double nearest = circles.spacing * (circles.asymmetric ? std::sqrt(2.0) : 1);
  const double radius = NominalRadius(circles);
  std::vector<MarkerLook> looks;
  for (const Observation& seen : found) {
    const Eigen::Vector3d& middle = target.markers.at(seen.marker);
    std::vector<cv::Point2d> on_board, in_image;
    for (const Observation& other : found) {
      const Eigen::Vector3d away = target.markers.at(other.marker) - middle;
      if (away.norm() > kAround * nearest) continue;
      on_board.emplace_back(away.x() / radius, away.y() / radius);
      in_image.emplace_back(other.values[0], other.values[1]);
    }
    const Eigen::Vector2d place(seen.values[0], seen.values[1]);
    const auto cells_by_image = CellsByImage(in_image, on_board, place, {0, 0});
    if (!cells_by_image) continue;
    looks.push_back({.marker = seen.marker,
                     .place = place,
                     .cells_by_image = *cells_by_image,
                     .drawing = DiscDrawing(1)});
  }
  return looks;
}

}  // namespace

std::vector<MarkerLook> LooksOf(const Target& target, const std::vector<Observation>& found) {
  if (std::holds_alternative<TagLayout>(target.layout)) return LooksOfTags(target, found);
  if (const auto* board = std::get_if<ChessboardLayout>(&target.layout)) {
    return LooksOfBoard(board->columns, found, 3, [](int, int) { return DrawCorner(); });
  }
  if (const auto* board = std::get_if<CharucoLayout>(&target.layout)) {
    const CharucoLooks looks = FindCharucoLooks(*board);
    return LooksOfBoard(board->columns - 1, found, 2, [&](int column, int row) {
      return DrawCharucoCorner(*board, looks, column + 1, row + 1);
    });
  }
  if (const auto* circles = std::get_if<CirclesLayout>(&target.layout)) {
    return LooksOfCircles(target, *circles, found);
  }
  return {};
}

}  // namespace plenocal::internal
