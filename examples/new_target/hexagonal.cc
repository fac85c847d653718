// SPDX-License-Identifier: Apache-2.0
#include "targets/types/hexagonal.h"

#include <cmath>

#include "targets/reading.h"
#include "targets/target.h"

namespace plenocal {

Target HexagonalLayout::Read(const YamlNode& node) {
  HexagonalLayout circles;
  circles.columns = internal::ReadCount(node.At("columns"), 2);
  circles.rows = internal::ReadCount(node.At("rows"), 2);
  circles.spacing = node.At("spacing").AsLength();
  Target target;
  target.layout = circles;
  target.markers = internal::PlaneMarkers(circles.columns, circles.rows, [&](int column, int row) {
    return Eigen::Vector2d(circles.spacing * (column + (row % 2) / 2.0),
                           circles.spacing * row * std::sqrt(3.0) / 2);
  });
  return target;
}

std::vector<TargetPart> HexagonalLayout::Draw(const MarkerPositions& markers,
                                              Pieces /*pieces*/) const {
  TargetPart part;
  const double radius = spacing / 4;
  for (const auto& [number, position] : markers) {
    part.black_discs.push_back({position.head<2>(), radius, number});
    part.paper.extend(position.head<2>());
  }
  const Eigen::Vector2d margin(spacing, spacing);
  part.paper = {Eigen::Vector2d(part.paper.min() - margin),
                Eigen::Vector2d(part.paper.max() + margin)};
  part.finest = radius;
  return {part};
}

}  // namespace plenocal
