// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "calib/session.h"
#include "detectors/detect_images.h"
#include "targets/target.h"

/// What the image module exports: `DetectImages` of detectors/detect_images.h.
extern "C" void plenocal_detect_images(const std::vector<plenocal::FrameImage>& images,
                                       const plenocal::Target& target,
                                       const plenocal::DetectOptions& options,
                                       plenocal::ImageDetections* detections);

namespace plenocal {

/// `DetectImages` by the image module, which is loaded on first use. Throws `Error` of kind kJob
/// when the installation lacks it.
ImageDetections DetectImagesByModule(const std::vector<FrameImage>& images,
                                     const Target& target,
                                     const DetectOptions& options);

}  // namespace plenocal
