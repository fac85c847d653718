// SPDX-License-Identifier: Apache-2.0
#include "calib/traits/image_grid.h"

#include <algorithm>
#include <cmath>

namespace plenocal {

ImageGrid::ImageGrid(ImageSize image_size, int longer)
    : width_(image_size[0]), height_(image_size[1]) {
  const double cell = std::max(width_, height_) / longer;
  columns_ = std::max(1, static_cast<int>(std::lround(width_ / cell)));
  rows_ = std::max(1, static_cast<int>(std::lround(height_ / cell)));
}

size_t ImageGrid::Cell(double x, double y) const {
  // The image begins half a pixel before the first pixel's centre.
  const int column = static_cast<int>(std::floor((x + 0.5) / width_ * columns_));
  const int row = static_cast<int>(std::floor((y + 0.5) / height_ * rows_));
  return static_cast<size_t>(std::clamp(row, 0, rows_ - 1)) * static_cast<size_t>(columns_) +
         static_cast<size_t>(std::clamp(column, 0, columns_ - 1));
}

Eigen::Vector2d ImageGrid::Middle(size_t cell) const {
  const int row = static_cast<int>(cell) / columns_, column = static_cast<int>(cell) % columns_;
  return {(column + 0.5) * width_ / columns_ - 0.5, (row + 0.5) * height_ / rows_ - 0.5};
}

}  // namespace plenocal
