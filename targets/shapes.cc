// SPDX-License-Identifier: Apache-2.0
#include "targets/shapes.h"

namespace plenocal::internal {

Polygon Rectangle(double x0, double y0, double x1, double y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

void AddSquares(const SquareRaster& raster, int parity, TargetPart* part) {
  for (int row = 0; row < raster.rows; ++row) {
    for (int column = 0; column < raster.columns; ++column) {
      if ((row + column) % 2 != parity) continue;
      const double x = raster.x0 + column * raster.side, y = raster.y0 + row * raster.side;
      part->black.push_back(Rectangle(x, y, x + raster.side, y + raster.side));
    }
  }
}

}  // namespace plenocal::internal
