// SPDX-License-Identifier: Apache-2.0
//
// Cells of an image.
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "calib/camera/observation.h"

namespace plenocal {

/// A regular division of an image into cells that are nearly square.
class ImageGrid {
 public:
  /// `longer`: cells along the image's longer side.
  ImageGrid(ImageSize image_size, int longer);

  [[nodiscard]] int Columns() const { return columns_; }
  [[nodiscard]] int Rows() const { return rows_; }
  [[nodiscard]] size_t Cells() const { return static_cast<size_t>(columns_) * rows_; }
  /// Index of the cell of a position; positions outside the image belong to the outermost cells.
  [[nodiscard]] size_t Cell(double x, double y) const;
  /// Middle of a cell, px.
  [[nodiscard]] Eigen::Vector2d Middle(size_t cell) const;

 private:
  double width_, height_;
  int columns_, rows_;
};

}  // namespace plenocal
