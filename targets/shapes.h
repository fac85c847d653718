// SPDX-License-Identifier: Apache-2.0
//
// Shapes that drawings of several target types consist of.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "targets/target_drawing.h"

namespace plenocal::internal {

Polygon Rectangle(double x0, double y0, double x1, double y1);

/// Squares in rows and columns whose first has its upper left corner at (x0, y0).
struct SquareRaster {
  int columns = 0, rows = 0;
  double x0 = 0, y0 = 0, side = 0;  ///< m
};

/// Adds the squares whose column + row has this parity (0 or 1).
void AddSquares(const SquareRaster& raster, int parity, TargetPart* part);

/// Adds the black cells of a square raster (row by row) as few rectangles: runs along rows. `place`
/// maps points in cells, counted from the raster's upper left, to the part.
template <typename Place>
void AddCells(const std::vector<bool>& white, int width, const Place& place, TargetPart* part) {
  for (int y = 0; y < width; ++y) {
    const auto row = white.begin() + y * width;
    for (int x = 0; x < width;) {
      int end = x;
      while (end < width && !row[end]) ++end;
      if (end > x) {
        Polygon polygon = Rectangle(x, y, end, y + 1);
        for (Eigen::Vector2d& p : polygon) p = place(p);
        part->black.push_back(std::move(polygon));
      }
      x = std::max(end, x + 1);
    }
  }
}

}  // namespace plenocal::internal
