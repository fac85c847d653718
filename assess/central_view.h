// SPDX-License-Identifier: Apache-2.0
//
// A camera without a single centre, taken as a central one: what a map of pixels to pixels needs.
#pragma once

#include <optional>
#include <string>

#include "calib/base/run.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

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
  /// What is stated in a file of the view's results: for a camera that is not central, the
  /// distance.
  [[nodiscard]] Provenance StatedIn(Provenance provenance) const;
  /// Of a camera that is not central a message: the distance, and `LargestError`.
  void Report(const Run& run) const;
  /// Largest error in the image of points at half and at twice the distance, at 1 m for an infinite
  /// one, px; 0 for a central camera.
  [[nodiscard]] double LargestError() const { return largest_error_; }

 private:
  // Those of the central model.
  static bool Project(const CameraModel& model,
                      const double* params,
                      const double* config,
                      const double* values,
                      const Eigen::Vector3d& p,
                      double h,
                      double* predicted);
  static bool ProjectWithJacobian(const CameraModel& model,
                                  const double* params,
                                  const double* config,
                                  const double* values,
                                  const Eigen::Vector3d& p,
                                  double h,
                                  const ProjectionOutput& out);
  static std::optional<Ray> Unproject(const CameraModel& model,
                                      const double* params,
                                      const double* config,
                                      const double* values);
  [[nodiscard]] std::string DistanceText() const;
  void FindLargestError();

  const CalibratedCamera& original_;
  CameraModel model_ = {};       // of `camera_`
  double inverse_distance_ = 0;  // 1/m
  CalibratedCamera camera_ = {};
  double largest_error_ = 0;  // px
};

}  // namespace plenocal
