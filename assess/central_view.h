// SPDX-License-Identifier: Apache-2.0
//
// A camera without a single centre, taken as a central one, as a map of pixels to pixels needs it.
#pragma once

#include <optional>
#include <string>

#include "calib/base/run.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// What the functions of the central model need.
struct RaysAtDistance {
  const CameraModel* model = nullptr;  ///< of the original camera
  double inverse_distance = 0;         ///< 1/m
};

/// A central camera whose ray of a pixel goes from the camera frame's origin to the point at
/// `distance` on the ray of the original: exact for points at that distance.
class CentralView {
 public:
  /// `distance` in m, may be infinite; not set: the median distance of the target in the frames of
  /// `calibration`, to which the camera belongs. A central camera stays itself, and so does a
  /// plenoptic one. The camera must outlive the view. Throws `Error` of kind kInput where the
  /// calibration has no frames and `distance` is not set.
  CentralView(const CalibrationRecord& calibration,
              const CalibratedCamera& camera,
              std::optional<double> distance);
  CentralView(const CentralView&) = delete;
  CentralView& operator=(const CentralView&) = delete;

  [[nodiscard]] const CalibratedCamera& camera() const {
    return camera_.model == nullptr ? original_ : camera_;
  }
  /// `provenance` of results of the view, with the distance of a camera that is not central.
  [[nodiscard]] Provenance WithDistance(Provenance provenance) const;
  /// A message with the distance and `LargestError` of a camera that is not central.
  void Report(const Run& run) const;
  /// Largest error in the image of points at half and at twice the distance, at 1 m for an infinite
  /// one, px; 0 for a central camera.
  [[nodiscard]] double LargestError() const { return largest_error_; }

 private:
  [[nodiscard]] std::string DistanceText() const;
  void FindLargestError();

  const CalibratedCamera& original_;
  RaysAtDistance rays_ = {};
  CameraModel model_ = {};  // of `camera_`
  CalibratedCamera camera_ = {};
  double largest_error_ = 0;  // px
};

}  // namespace plenocal
