// SPDX-License-Identifier: Apache-2.0
#include "targets/types/hexagonal.h"

#include <cmath>

#include "targets/reading.h"
#include "targets/target.h"

namespace plenocal {

namespace {

Eigen::Vector2d CircleAt(double spacing, int column, int row) {
  return {spacing * (column + (row % 2) / 2.0), spacing * row * std::sqrt(3.0) / 2};
}

}  // namespace

Target HexagonalLayout::Read(const YamlNode& node) {
  HexagonalLayout circles;
  circles.columns = internal::ReadCount(node.At("columns"), 2);
  circles.rows = internal::ReadCount(node.At("rows"), 2);
  circles.spacing = node.At("spacing").AsLength();
  Target target;
  target.layout = circles;
  target.markers = internal::PlaneMarkers(circles.columns, circles.rows, [&](int column, int row) {
    return CircleAt(circles.spacing, column, row);
  });
  return target;
}

TargetDoubts HexagonalLayout::Doubts(const YamlNode& /*nominal*/) const {
  return {.hypotheses = internal::OtherRows(
              columns,
              rows,
              "circles",
              [&](int column, int row) { return CircleAt(spacing, column, row); }),
          .numbers = {},
          .quads = {}};
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
