// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "targets/target_type.h"

namespace plenocal::internal {

/// Markers in the plane z = 0, numbered row by row; `position(column, row)` is their x and y.
template <typename Position>
MarkerPositions PlaneMarkers(int columns, int rows, Position position) {
  MarkerPositions markers;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const Eigen::Vector2d xy = position(column, row);
      markers.emplace_hint(
          markers.end(), row * columns + column, Eigen::Vector3d(xy.x(), xy.y(), 0));
    }
  }
  return markers;
}

/// To the viewer of a board in the plane z = 0 whose y axis points down.
inline Eigen::Vector3d BoardNormal() { return {0, 0, -1}; }

}  // namespace plenocal::internal
