// SPDX-License-Identifier: Apache-2.0
//
// Images of one camera, resampled into an output folder: undistort, rectify.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apps/cli/console.h"
#include "apps/cli/view_options.h"
#include "calib/files/frame_images.h"
#include "calib/io/output_folder.h"
#include "engine/resample/pixel_map.h"

namespace plenocal {

/// Throws `Error` of kind kInput when the results of two images would have one name.
void CheckImageNames(const std::vector<FrameImage>& images);

/// How the images of `camera`, one of `calibration`, are resampled.
struct FolderResampling {
  const CalibrationRecord& calibration;
  const CalibratedCamera& camera;
  const PixelMap& map;
  const ResampleArguments& arguments;
  std::string prefix;                                  ///< of the names in the folder
  std::map<std::string, std::string>* keep = nullptr;  ///< the PNG of each frame; null: not kept
};

/// Writes `<prefix><frame>.png` of each image into `out`. Prints messages and progress. Returns the
/// number of images written.
size_t ResampleToFolder(const std::vector<FrameImage>& images,
                        const FolderResampling& resampling,
                        const ConsoleOptions& options,
                        OutputFolder* out);

}  // namespace plenocal
