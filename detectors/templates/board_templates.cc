// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/board_templates.h"

#include <Eigen/Geometry>
#include <map>
#include <opencv2/calib3d.hpp>
#include <optional>

namespace plenocal::internal {
namespace {

/// The homography from the image to cells by the points around a marker, translated such that the
/// marker itself is where it was found, whatever its neighbours are.
std::optional<Eigen::Matrix3d> CellsByImage(const std::vector<cv::Point2d>& in_image,
                                            const std::vector<cv::Point2d>& in_cells,
                                            const Eigen::Vector2d& marker_in_image,
                                            const Eigen::Vector2d& marker_in_cells) {
  if (in_image.size() < 4) return std::nullopt;
  const cv::Mat H = cv::findHomography(in_image, in_cells);
  if (H.empty()) return std::nullopt;
  Eigen::Matrix3d translation = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d cells_by_image =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(H.ptr<double>());
  translation.topRightCorner<2, 1>() =
      marker_in_cells - (cells_by_image * marker_in_image.homogeneous()).hnormalized();
  return translation * cells_by_image;
}

}  // namespace

std::vector<MarkerTemplate> CornerTemplates(int columns,
                                            const std::vector<Observation>& found,
                                            int squares,
                                            const DrawCorner& draw) {
  const int middle = squares / 2;
  std::map<int, Eigen::Vector2d> positions;
  for (const Observation& seen : found) positions[seen.marker] = {seen.values[0], seen.values[1]};
  std::vector<MarkerTemplate> templates;
  for (const auto& [marker, position] : positions) {
    // The homography of the pattern around the corner from the corners next to it.
    std::vector<cv::Point2d> on_board, in_image;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const int column = marker % columns + dx;
        const auto other = positions.find(marker + dy * columns + dx);
        if (column < 0 || column >= columns || other == positions.end()) continue;
        on_board.emplace_back(middle + dx, middle + dy);
        in_image.emplace_back(other->second.x(), other->second.y());
      }
    }
    const Eigen::Vector2d in_cells(middle, middle);
    const auto cells_by_image = CellsByImage(in_image, on_board, position, in_cells);
    if (!cells_by_image) continue;
    templates.push_back({.marker = marker,
                         .position = position,
                         .cells_by_image = *cells_by_image,
                         .pattern = draw(marker % columns, marker / columns)});
  }
  return templates;
}

std::vector<MarkerTemplate> DiscTemplates(const DiscGrid& discs,
                                          const Target& target,
                                          const std::vector<Observation>& found) {
  constexpr double kAround = 2.9;  // distances to the nearest circle: two rows of neighbours
  std::vector<MarkerTemplate> templates;
  for (const Observation& seen : found) {
    const Eigen::Vector3d& middle = target.markers.at(seen.marker);
    std::vector<cv::Point2d> on_board, in_image;
    for (const Observation& other : found) {
      const Eigen::Vector3d away = target.markers.at(other.marker) - middle;
      if (away.norm() > kAround * discs.nearest) continue;
      on_board.emplace_back(away.x() / discs.radius, away.y() / discs.radius);
      in_image.emplace_back(other.values[0], other.values[1]);
    }
    const Eigen::Vector2d position(seen.values[0], seen.values[1]);
    const auto cells_by_image = CellsByImage(in_image, on_board, position, {0, 0});
    if (!cells_by_image) continue;
    templates.push_back({.marker = seen.marker,
                         .position = position,
                         .cells_by_image = *cells_by_image,
                         .pattern = DiscTemplate(1)});
  }
  return templates;
}

}  // namespace plenocal::internal
