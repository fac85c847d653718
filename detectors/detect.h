// SPDX-License-Identifier: Apache-2.0
//
// Detection of a target in the images of one camera, ordinary or plenoptic.
#pragma once

#include <vector>

#include "calib/files/frame_images.h"
#include "detectors/images/image_detections.h"
#include "detectors/images/other_targets.h"
#include "targets/target.h"

namespace plenocal {

enum class CameraOptics {
  kOrdinary,
  kPlenoptic,  ///< with micro lenses; the images are raw
};

/// Finds the target in all images of one camera: `DetectOrdinaryImages` or `DetectPlenopticImages`.
/// `others` as of `MakeMarkerDetector`; of ordinary cameras only.
ImageDetections DetectImages(const std::vector<FrameImage>& images,
                             const Target& target,
                             CameraOptics optics,
                             const DetectOptions& options,
                             const OtherTargets& others = {});

/// `SketchOrdinaryImages` of this target.
std::vector<ImageSketch> SketchImages(const std::vector<FrameImage>& images,
                                      const Target& target,
                                      const DetectOptions& options);

}  // namespace plenocal
