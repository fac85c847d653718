// SPDX-License-Identifier: Apache-2.0
//
// Images as a pinhole camera takes them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/calibration_record.h"
#include "engine/images/image_folder.h"
#include "engine/resample/pinhole_view.h"

namespace plenocal {

struct UndistortRequest {
  std::filesystem::path calibration;  ///< calibration.yaml, where none is given as a record
  std::string camera;                 ///< empty: the only one
  std::vector<std::string> images;    ///< folders, globs and files
  ViewOptions view;
  ResampleSettings settings;
  std::filesystem::path cloud;  ///< PLY of one plenoptic image; empty: none
  std::filesystem::path out;    ///< folder for the images
};

struct UndistortedImages {
  CalibratedCamera view;  ///< that the results are images of
  size_t count = 0;
};

/// Writes <frame>.png (of a plenoptic camera depth as well) and calibration.yaml into `out`. Throws
/// `Error`, and `Stopped`.
UndistortedImages UndistortImages(const UndistortRequest& request, const Run& run);
UndistortedImages UndistortImages(const CalibrationRecord& calibration,
                                  const UndistortRequest& request,
                                  const Run& run);

}  // namespace plenocal
