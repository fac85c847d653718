// SPDX-License-Identifier: Apache-2.0
//
// Conversion of a camera to another camera model.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// Pixels over the image, corners included, at which a conversion is judged.
inline constexpr int kConvertedColumns = 41, kConvertedRows = 31;

/// A pixel of the original camera and the error of the converted model there.
struct ConversionError {
  Eigen::Vector2d u_px;
  std::optional<Eigen::Vector2d> difference_px;  ///< nothing where the model images no such ray
};

/// A camera converted to another model.
struct Conversion {
  std::vector<double> params;
  std::vector<ConversionError> errors;  ///< a grid over the image from corner to corner
  double rms = 0, largest = 0;          ///< px
  Eigen::Vector2d largest_at = Eigen::Vector2d::Zero();
  int unseen = 0;  ///< pixels whose rays the model does not image
};

/// Least squares of the image over a grid of the original's pixels, with all rays kept (no rotation
/// of the camera frame). Throws `Error` when either model is not central or the original images
/// hardly anything.
Conversion Convert(const CalibratedCamera& camera, const CameraModel& model);

}  // namespace plenocal
