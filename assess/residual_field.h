// SPDX-License-Identifier: Apache-2.0
//
// Residuals over the image: what is left of them when the noise averages out is an error of the
// camera model.
#pragma once

#include <vector>

#include "calib/files/calibration_record.h"
#include "calib/traits/image_grid.h"

namespace plenocal {

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
