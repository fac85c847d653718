// SPDX-License-Identifier: Apache-2.0
//
// Residuals over the image: what is left of them when the noise averages out is an error of the
// camera model.
#pragma once

#include <vector>

#include "calib/files/calibration_record.h"

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

/// Mean and spread of residuals in each cell of an image.
struct ResidualField {
  ImageGrid grid;
  std::vector<int> points;               ///< used observations
  std::vector<Eigen::Vector2d> mean;     ///< px
  std::vector<double> square;            ///< mean squared length, px^2
  std::vector<double> variance_of_mean;  ///< of each coordinate of `mean`, from the noise, px^2

  /// RMS of a coordinate of the means over all points, without what noise contributes, px.
  [[nodiscard]] double Pattern() const;
};

ResidualField MakeResidualField(const CalibratedCamera& camera);

}  // namespace plenocal
