// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <map>
#include <vector>

#include "detectors/tags/tag_detector.h"
#include "detectors/tags/tag_patterns.h"
#include "detectors/tags/tag_template.h"

namespace plenocal::internal {

std::vector<MarkerTemplate> MakeTemplates(const TagLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found,
                                          const cv::Mat& gray) {
  // The surround of a tag is drawn as far as it is known and blurs into the tag.
  constexpr double kFarthest = 4;  // bits
  std::map<int, std::map<int, Eigen::Vector2d>> by_tag;
  for (const Observation& seen : found) {
    by_tag[seen.marker / 4][seen.marker % 4] = {seen.values[0], seen.values[1]};
  }
  std::map<int, Quad> whole;
  for (const auto& [id, corners] : by_tag) {
    if (corners.size() == 4)
      whole[id] = {corners.at(0), corners.at(1), corners.at(2), corners.at(3)};
  }
  const TagPatterns tags = FindTagPatterns(layout, target, gray, whole);
  const int margin = 1 + static_cast<int>(std::clamp(tags.border.outside, 1.0, kFarthest));
  std::vector<MarkerTemplate> templates;
  for (const auto& [id, quad] : whole) {
    const Eigen::Matrix3d cells_by_image =
        CellsByUnitSquare(tags.border, margin) * UnitSquareHomography(quad).inverse();
    for (int k = 0; k < 4; ++k) {
      templates.push_back({.marker = 4 * id + k,
                           .position = quad[k],
                           .cells_by_image = cells_by_image,
                           .pattern = DrawTag(tags.bits.at(id), tags.border, margin),
                           .margin = margin,
                           .part = id});
    }
  }
  return templates;
}

}  // namespace plenocal::internal
