// SPDX-License-Identifier: Apache-2.0
//
// The micro lenses and the attenuation of a plenoptic camera from files. No OpenCV type here: the
// command line includes this header without it.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"

namespace plenocal {

struct PlenopticCamera;  // detectors/plenoptic/depth/reconstruction.h

/// Sources of the micro lenses and the attenuation of a camera.
struct PlenopticSource {
  std::vector<FrameImage> white_images;
  /// micro_lenses_<camera>.csv or RayCalibData XML; with white images only the latter, else needed.
  std::filesystem::path grid;
  std::filesystem::path
      vignetting;  ///< TIFF; empty with `grid` alone: the raw images are corrected already
  std::optional<BayerOrder> bayer = {};  ///< of raw mosaics
};

/// The camera of a source. `raw_image`: one of its images, of whose size a camera without
/// attenuation is. Warnings go to `message`. Throws `Error` with the file or the reason.
PlenopticCamera LoadPlenopticCamera(const PlenopticSource& source,
                                    const FrameImage& raw_image,
                                    int threads,
                                    const std::function<void(const std::string&)>& message);

}  // namespace plenocal
