// SPDX-License-Identifier: Apache-2.0
//
// Images of a flat wall with a marker: the light that they show and where the camera was.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"
#include "detectors/photometry/response_curve.h"
#include "engine/recording/recording.h"
#include "targets/target.h"

namespace plenocal {

struct WallView {
  std::string frame;
  double exposure = 1;  ///< ms; 1 where none is known
  RigidTransform T_camera_wall;
  /// ln(light / exposure) of the reduced image, CV_32F; NaN: dark, saturated or beside it.
  cv::Mat brightness;
  cv::Mat light;  ///< CV_32F, 0 to 255; same size
};

struct WallRecording {
  const CalibratedCamera* camera = nullptr;
  ResponseCurve response;
  int reduction = 1;  ///< px of the image per pixel of the reduced one
  bool exposures_known = true;
  std::vector<WallView> views;
  /// Part of the wall that the marker covers, with its white border: least x, y, largest x, y, m.
  std::array<double, 4> marker{};
  std::vector<LeftOut> left_out;
};

struct WallOptions {
  const Recording* recording = nullptr;
  const RecordedCamera* images = nullptr;
  const CalibratedCamera* camera = nullptr;  ///< ordinary
  ResponseCurve response;
  const Target* target = nullptr;  ///< its markers lie on the wall: z = 0
  int threads = 0;
  std::function<bool(std::size_t done, std::size_t total)> progress;
};

/// Images that cannot be read, show no marker or are saturated are left out with their reason.
/// Throws `Error`: of kind kInput for a target that is not flat, images of another size than the
/// calibration's, or 16 bits; of kind kJob when fewer than ten images remain.
WallRecording ReadWall(const WallOptions& options);

}  // namespace plenocal
