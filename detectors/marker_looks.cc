// SPDX-License-Identifier: Apache-2.0
#include "detectors/marker_looks.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <map>
#include <opencv2/calib3d.hpp>
#include <optional>

#include "detectors/tag_looks.h"
#include "detectors/tag_template.h"

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
    if (on_board.size() < 4) continue;
    const cv::Mat H = cv::findHomography(in_image, on_board);
    if (H.empty()) continue;
    MarkerLook look{
        .marker = marker,
        .place = place,
        .cells_by_image =
            Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(H.ptr<double>()),
        .drawing = DrawCorner()};
    // The corner itself is where it was found, whatever its neighbours say.
    const Eigen::Vector2d off =
        (look.cells_by_image * place.homogeneous()).hnormalized() - Eigen::Vector2d(3, 3);
    Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
    shift.topRightCorner<2, 1>() = -off;
    look.cells_by_image = shift * look.cells_by_image;
    looks.push_back(std::move(look));
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
  return {};
}

}  // namespace plenocal::internal
