// SPDX-License-Identifier: Apache-2.0
//
// Poses of single images of a calibrated camera.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"
#include "engine/scene/locate_view.h"
#include "targets/target.h"

namespace plenocal {

struct LocateRequest {
  std::filesystem::path calibration;  ///< calibration.yaml, where none is given as a record
  std::filesystem::path map;          ///< target.yaml, or points.csv of an earlier run
  std::optional<Target> target;       ///< in place of `map`
  std::vector<std::string> images;    ///< files, globs, folders; or tables of detections (CSV)
  std::vector<FrameImage> given;      ///< images in memory, in place of `images`
  std::string camera;                 ///< empty: the calibration's only one
  std::vector<std::string> white;     ///< white images of a plenoptic camera
  std::optional<BayerOrder> bayer;    ///< of raw mosaics
  std::filesystem::path out;          ///< table of the poses (CSV); empty: none is written
};

struct LocatedImage {
  std::string name;
  LocatedView located;
};

/// The images with a pose; those without one are reported. Throws `Error`: of kind kJob when no
/// image has a pose; and `Stopped`.
std::vector<LocatedImage> LocateImages(const LocateRequest& request, const Run& run);
std::vector<LocatedImage> LocateImages(const CalibrationRecord& calibration,
                                       const LocateRequest& request,
                                       const Run& run);

}  // namespace plenocal
