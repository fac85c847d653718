// SPDX-License-Identifier: Apache-2.0
#include "detectors/marker_looks.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>
#include <optional>

#include "detectors/tag_looks.h"
#include "detectors/tag_template.h"
#include "detectors/target_drawing.h"

namespace plenocal::internal {
namespace {

std::vector<MarkerLook> LooksOfTags(const Target& target, const std::vector<Observation>& found) {
  const TagLooks tags = FindTagLooks(target);
  std::map<int, std::map<int, Eigen::Vector2d>> by_tag;
  for (const Observation& seen : found) {
    by_tag[seen.marker / 4][seen.marker % 4] = {seen.values[0], seen.values[1]};
  }
  std::vector<MarkerLook> looks;
  for (const auto& [id, corners] : by_tag) {
    if (corners.size() < 4) continue;
    const Quad quad{corners.at(0), corners.at(1), corners.at(2), corners.at(3)};
    const Eigen::Matrix3d cells_by_image =
        CellsByUnitSquare(tags.border) * UnitSquareHomography(quad).inverse();
    for (int k = 0; k < 4; ++k) {
      looks.push_back({.marker = 4 * id + k,
                       .place = quad[k],
                       .cells_by_image = cells_by_image,
                       .drawing = DrawTag(tags.bits.at(id), tags.border),
                       .beyond_unknown = true,
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

std::vector<MarkerLook> LooksOfBoard(int columns, const std::vector<Observation>& found) {
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
        on_board.emplace_back(3 + dx, 3 + dy);
        in_image.emplace_back(other->second.x(), other->second.y());
      }
    }
    const auto cells_by_image = CellsByImage(in_image, on_board, place, {3, 3});
    if (!cells_by_image) continue;
    looks.push_back({.marker = marker,
                     .place = place,
                     .cells_by_image = *cells_by_image,
                     .drawing = DrawCorner()});
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
    return LooksOfBoard(board->columns, found);
  }
  if (const auto* board = std::get_if<CharucoLayout>(&target.layout)) {
    return LooksOfBoard(board->columns - 1, found);
  }
  if (const auto* circles = std::get_if<CirclesLayout>(&target.layout)) {
    return LooksOfCircles(target, *circles, found);
  }
  return {};
}

}  // namespace plenocal::internal
