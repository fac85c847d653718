// SPDX-License-Identifier: Apache-2.0
//
// Numbering of the points of a grid that was found in an image.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <opencv2/core/types.hpp>
#include <variant>
#include <vector>

#include "detectors/images/other_targets.h"

namespace plenocal::internal {

/// A way to number a lattice of points: entry `row * columns + column` is the index of the point in
/// the order in which they were found.
using GridOrder = std::vector<std::size_t>;

inline GridOrder FoundOrder(int columns, int rows) {
  GridOrder order(static_cast<std::size_t>(columns) * rows);
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  return order;
}

/// The same lattice begun at the opposite corner.
inline GridOrder Rotated180(const GridOrder& order) { return {order.rbegin(), order.rend()}; }

/// A square lattice begun at the next corner: its columns become the rows.
inline GridOrder Rotated90(const GridOrder& order, int size) {
  GridOrder turned(order.size());
  for (int row = 0; row < size; ++row) {
    for (int column = 0; column < size; ++column) {
      turned[static_cast<std::size_t>(row) * size + column] =
          order[static_cast<std::size_t>(size - 1 - column) * size + row];
    }
  }
  return turned;
}

/// Each row from its other end: mirrors the lattice.
inline GridOrder RowsReversed(const GridOrder& order, int columns) {
  GridOrder mirrored(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::size_t column = i % columns;
    mirrored[i] = order[i - column + (columns - 1 - column)];
  }
  return mirrored;
}

/// The last row first: mirrors the lattice.
inline GridOrder ColumnsReversed(const GridOrder& order, int columns) {
  return Rotated180(RowsReversed(order, columns));
}

/// Twice the signed area of the lattice's outline: positive when columns (x) turn clockwise to rows
/// (y) in the image, as they do on a board seen from its front.
inline double Handedness(const std::vector<Eigen::Vector2d>& points,
                         const GridOrder& order,
                         int columns) {
  const Eigen::Vector2d& first = points[order.front()];
  const Eigen::Vector2d& across = points[order[columns - 1]];
  const Eigen::Vector2d& opposite = points[order.back()];
  const Eigen::Vector2d& down = points[order[order.size() - columns]];
  const Eigen::Vector2d a = opposite - first, b = down - across;
  return a.x() * b.y() - a.y() * b.x();
}

/// Whether a grid of these counts, either way round, may be a part of the other.
inline bool IsPart(int columns, int rows, int of_columns, int of_rows) {
  return std::min(columns, rows) <= std::min(of_columns, of_rows) &&
         std::max(columns, rows) <= std::max(of_columns, of_rows);
}

/// Columns and rows of the other targets, of the layout's own type, of which its grid may be a
/// part.
template <typename Layout>
std::vector<cv::Size> LargerGrids(const Layout& own, const OtherTargets& others) {
  std::vector<cv::Size> larger;
  for (const Target& other : others.targets) {
    const auto& grid = std::get<Layout>(other.layout);
    if (IsPart(own.columns, own.rows, grid.columns, grid.rows)) {
      larger.emplace_back(grid.columns, grid.rows);
    }
  }
  return larger;
}

/// Of each of a lattice's four sides the places where it would go on. `points`: row by row.
inline std::vector<std::vector<Eigen::Vector2d>> NextPlaces(
    const std::vector<Eigen::Vector2d>& points, int columns) {
  const int rows = static_cast<int>(points.size()) / columns;
  const auto at = [&](int column, int row) { return points[row * columns + column]; };
  std::vector<std::vector<Eigen::Vector2d>> sides(4);
  for (int column = 0; column < columns; ++column) {
    // Every second row of an asymmetric grid is offset; the same of three rows and of two.
    const int step = rows > 2 ? 2 : 1;
    const auto beyond = [&](int first, int inward) -> Eigen::Vector2d {
      return at(column, first + (step - 1) * inward) + at(column, first) -
             at(column, first + step * inward);
    };
    sides[0].push_back(beyond(0, 1));
    sides[1].push_back(beyond(rows - 1, -1));
  }
  for (int row = 0; row < rows; ++row) {
    sides[2].push_back(2 * at(0, row) - at(1, row));
    sides[3].push_back(2 * at(columns - 1, row) - at(columns - 2, row));
  }
  return sides;
}

/// Whether more of the lattice may be beyond the image's border.
inline bool MayGoOnOutside(const std::vector<std::vector<Eigen::Vector2d>>& next_places,
                           int image_columns,
                           int image_rows) {
  return std::ranges::any_of(next_places, [&](const std::vector<Eigen::Vector2d>& side) {
    return std::ranges::any_of(side, [&](const Eigen::Vector2d& p) {
      return !(p.x() >= 0 && p.y() >= 0 && p.x() <= image_columns - 1 && p.y() <= image_rows - 1);
    });
  });
}

/// Of equally good orders the one whose first point is nearest the image's top left. One image
/// cannot decide more: cameras that are rotated against each other by more than about 90 degrees
/// may begin at different corners of such a board.
inline const GridOrder& NearestTopLeft(const std::vector<Eigen::Vector2d>& points,
                                       const std::vector<GridOrder>& orders) {
  std::size_t best = 0;
  for (std::size_t k = 1; k < orders.size(); ++k) {
    if (points[orders[k].front()].norm() < points[orders[best].front()].norm()) best = k;
  }
  return orders[best];
}

}  // namespace plenocal::internal
