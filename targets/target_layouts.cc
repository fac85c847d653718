// SPDX-License-Identifier: Apache-2.0
#include "targets/target_layouts.h"

#include <numeric>

namespace plenocal::internal {
namespace {

// Markers row by row; `position` says where (column, row) is in the plane.
template <typename Position>
Markers PlaneMarkers(int columns, int rows, Position position) {
  Markers markers;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const Eigen::Vector2d xy = position(column, row);
      markers.emplace_hint(
          markers.end(), row * columns + column, Eigen::Vector3d(xy.x(), xy.y(), 0));
    }
  }
  return markers;
}

}  // namespace

std::vector<int> TagIds(const TagGrid& grid) {
  std::vector<int> ids(static_cast<size_t>(grid.columns) * static_cast<size_t>(grid.rows));
  std::iota(ids.begin(), ids.end(), grid.first_id);
  return ids;
}

Markers MarkersOf(const TagGrid& grid) {
  const double pitch = (1 + grid.spacing) * grid.size;
  Markers markers;
  int id = grid.first_id;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column, ++id) {
      const Eigen::Vector3d lower_left(column * pitch, row * pitch, 0);
      markers[4 * id] = lower_left;
      markers[4 * id + 1] = lower_left + Eigen::Vector3d(grid.size, 0, 0);
      markers[4 * id + 2] = lower_left + Eigen::Vector3d(grid.size, grid.size, 0);
      markers[4 * id + 3] = lower_left + Eigen::Vector3d(0, grid.size, 0);
    }
  }
  return markers;
}

Markers MarkersOf(const ChessboardLayout& board, double column_spacing) {
  return PlaneMarkers(board.columns, board.rows, [&](int column, int row) {
    return Eigen::Vector2d(column * column_spacing, row * board.square);
  });
}

Markers MarkersOf(const CharucoLayout& board) {
  return PlaneMarkers(board.columns - 1, board.rows - 1, [&](int column, int row) {
    return Eigen::Vector2d((column + 1) * board.square, (row + 1) * board.square);
  });
}

Markers MarkersOf(const CirclesLayout& circles) {
  return PlaneMarkers(circles.columns, circles.rows, [&](int column, int row) {
    const int step = circles.asymmetric ? 2 * column + row % 2 : column;
    return Eigen::Vector2d(step * circles.spacing, row * circles.spacing);
  });
}

}  // namespace plenocal::internal
