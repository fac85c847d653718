// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

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
};

ResidualField FieldOf(const CalibratedCamera& camera);

/// Input of `addArrowMap` in plots.js.
nlohmann::json FieldJson(const ResidualField& field);

/// Plots of one camera's residuals: sample of points, field, histogram, per frame,
/// per marker, per lens type, coverage of image and depth. `most_points`: points of the sample,
/// which is every k-th one. `lens_types`: per row of `residuals`, -1 unknown; may be empty.
nlohmann::json ResidualSections(const CalibrationRecord& calibration,
                                size_t camera,
                                size_t most_points,
                                const std::vector<int>& lens_types);

/// `value` with `digits` significant digits: short in the page. Null when not finite.
nlohmann::json Short(double value, int digits = 4);

}  // namespace plenocal
