// SPDX-License-Identifier: Apache-2.0
//
// Rectified stereo pairs: both views have one orientation, whose x axis is the baseline, so that a
// point lies in one row of both.
#pragma once

#include <array>
#include <span>

#include "calib/camera/observation.h"
#include "engine/resample/pinhole_view.h"

namespace plenocal {

/// The pair, first and second camera.
struct RectifiedPair {
  /// `pinhole`, one size and the same parameters; T_camera_rig of the first is the identity, of the
  /// second (-baseline, 0, 0). The baseline is negative when the second lies on the left.
  std::array<CalibratedCamera, 2> views;
  /// R_view_camera.
  std::array<Eigen::Matrix3d, 2> R_view_camera;
  double baseline = 0;  ///< m
  /// The cameras are above each other: the views are rotated by 90 degrees, so that rows
  /// correspond as stereo matchers require.
  bool turned = false;

  /// P1 or P2 of cv::stereoRectify, 3 x 4 row by row: from the first view's frame to a view's px.
  [[nodiscard]] std::array<double, 12> ProjectionMatrix(size_t view) const;
};

/// The views look along the mean of both optical axes as nearly as the baseline allows. Throws
/// `Error` when both cameras have one position, or one is in front of the other.
RectifiedPair Rectify(const CalibratedCamera& first,
                      const CalibratedCamera& second,
                      const ViewOptions& options);

/// Differences of the rows in which both views show a marker.
struct EpipolarErrors {
  size_t points = 0;         ///< markers seen by both cameras in one frame
  size_t frames = 0;         ///< in which there are such
  double mean_absolute = 0;  ///< px, as are all
  double rms = 0;
  double largest = 0;
};

/// `views`: of the first and of the second of `cameras`. Points outside of a model's domain do not
/// count.
EpipolarErrors MeasureEpipolarErrors(const RectifiedPair& pair,
                                     const std::array<const CalibratedCamera*, 2>& cameras,
                                     const std::array<std::vector<View>, 2>& views);

}  // namespace plenocal
