// SPDX-License-Identifier: Apache-2.0
//
// Images of a stereo pair whose points lie in equal rows.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/calibration_record.h"
#include "engine/images/image_folder.h"
#include "engine/resample/pinhole_view.h"
#include "engine/resample/rectify.h"

namespace plenocal {

struct RectifyRequest {
  std::filesystem::path calibration;  ///< calibration.yaml, where none is given as a record
  std::string left, right;            ///< images, each a folder, glob or file; empty: none
  std::filesystem::path session;      ///< session.yaml that lists the images; empty: none
  std::vector<std::string> cameras;   ///< two names; empty: the calibration's two
  /// Folder of detections_<camera>.csv; empty: that of the calibration.
  std::filesystem::path detections;
  ViewOptions view;
  ResampleSettings settings;
  bool maps = false;          ///< write remap tables
  bool preview = false;       ///< write pictures of the pairs
  std::filesystem::path out;  ///< folder for the images
};

/// The rectified views against the calibration's own detections.
struct EpipolarCheck {
  std::array<std::filesystem::path, 2> files;
  std::filesystem::path missing;  ///< a file that is not there; empty: both are
  EpipolarErrors errors;
};

struct RectifiedImages {
  RectifiedPair pair;
  std::array<size_t, 2> images{};  ///< written
  EpipolarCheck epipolar = {};
};

/// Writes <camera>/<frame>.png, calibration.yaml and rectification.yaml into `out`. Throws `Error`,
/// and `Stopped`.
RectifiedImages RectifyImages(const RectifyRequest& request, const Run& run);
RectifiedImages RectifyImages(const CalibrationRecord& calibration,
                              const RectifyRequest& request,
                              const Run& run);

}  // namespace plenocal
