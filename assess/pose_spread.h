// SPDX-License-Identifier: Apache-2.0
//
// Extent of the poses in which a camera has seen the target.
#pragma once

#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// Where one camera has seen the target: the part of the image, distances, tilts.
struct PoseSpread {
  bool any = false;     ///< there are used points; else nothing is set
  double coverage = 0;  ///< part of the image (circle)'s cells with points
  double left = 0, right = 0, top = 0, bottom = 0;  ///< outermost points, parts of width and height
  double nearest = 0, farthest = 0;  ///< of the images' median distances or depths, m
  bool is_plane = false;             ///< the target
  /// Largest angle between the plane's normals in two images, of a target in space between the
  /// directions from which they show it, degrees.
  double tilt = 0;
  double lean = 0;                 ///< angle of their mean with the optical axis, degrees
  std::vector<std::string> empty;  ///< ninths of the image without any point: "upper left corner"

  /// "the upper left corner"; empty when the points are on both sides of the middle each way.
  [[nodiscard]] std::string Region() const;
  /// The largest of the four margins without points, as a part of width or height.
  [[nodiscard]] double Margin() const;
};

PoseSpread MeasurePoseSpread(const CalibrationRecord& calibration, size_t camera);

}  // namespace plenocal
