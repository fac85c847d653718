// SPDX-License-Identifier: Apache-2.0
//
// Detection of a target in the raw images of one plenoptic camera.
#pragma once

#include <vector>

#include "calib/files/frame_images.h"
#include "detectors/images/image_detections.h"
#include "targets/target.h"

namespace plenocal {

/// `DetectOrdinaryImages` for a plenoptic camera: micro lenses and attenuation from the white
/// images, totally focused image and virtual depth of each raw image, markers there, and each of
/// them measured again in all micro images that have it well inside. Observations are x, y, lens_x,
/// lens_y.
ImageDetections DetectPlenopticImages(const std::vector<FrameImage>& images,
                                      const Target& target,
                                      const DetectOptions& options);

}  // namespace plenocal
