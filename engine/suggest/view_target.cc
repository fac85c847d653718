// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/view_target.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <variant>

#include "targets/target.h"
#include "targets/target_drawing.h"

namespace plenocal {
namespace {

constexpr double kDetailsOfSquare = 3;

std::vector<Eigen::Vector3d> PaperOutline(const TargetPart& part) {
  std::vector<Eigen::Vector3d> outline;
  for (const auto corner : {Eigen::AlignedBox2d::BottomLeft,
                            Eigen::AlignedBox2d::BottomRight,
                            Eigen::AlignedBox2d::TopRight,
                            Eigen::AlignedBox2d::TopLeft}) {
    const Eigen::Vector2d p = part.paper.corner(corner);
    outline.push_back(part.T_target_part * Eigen::Vector3d(p.x(), p.y(), 0));
  }
  return outline;
}

}  // namespace

ViewTarget MakeViewTarget(const Target& target) {
  ViewTarget shape{.markers = target.markers};
  for (const auto& [number, position] : target.markers) {
    shape.normals[number] = std::visit(
        [&, marker = number](const auto& layout) { return layout.Normal(target.markers, marker); },
        target.layout);
  }
  if (std::holds_alternative<MarkersLayout>(target.layout)) {
    // Nothing is known of how it looks: seen when all its points are.
    return shape;
  }
  shape.finest = std::numeric_limits<double>::infinity();
  for (const TargetPart& part : DrawTarget(target)) {
    const bool charuco = std::holds_alternative<CharucoLayout>(target.layout);
    shape.found_in_part |= !part.tags.empty() || charuco;
    const bool coarse = (part.squares || !part.black_discs.empty()) && !charuco;
    shape.finest = std::min(shape.finest, coarse ? part.finest / kDetailsOfSquare : part.finest);
    shape.outlines.push_back(PaperOutline(part));
  }
  return shape;
}

}  // namespace plenocal
