// SPDX-License-Identifier: Apache-2.0
#include "detectors/detect.h"

#include "detectors/images/detect_images.h"
#include "detectors/plenoptic/detect_plenoptic.h"
#include "detectors/types/marker_detectors.h"

namespace plenocal {

ImageDetections DetectImages(const std::vector<FrameImage>& images,
                             const Target& target,
                             CameraOptics optics,
                             const DetectOptions& options,
                             const OtherTargets& others) {
  if (optics == CameraOptics::kPlenoptic) return DetectPlenopticImages(images, target, options);
  return DetectOrdinaryImages(
      images, [&] { return MakeMarkerDetector(target, others); }, options);
}

std::vector<ImageSketch> SketchImages(const std::vector<FrameImage>& images,
                                      const Target& target,
                                      const DetectOptions& options) {
  return SketchOrdinaryImages(
      images, [&] { return MakeMarkerDetector(target); }, options);
}

}  // namespace plenocal
