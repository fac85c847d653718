// SPDX-License-Identifier: Apache-2.0
//
// Detection of a target in the images of one ordinary camera.
#pragma once

#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "detectors/images/image_detections.h"
#include "detectors/images/marker_detector.h"

namespace plenocal {

/// Finds the target in all images of one ordinary camera, several images at a time. An image that
/// cannot be read, or whose size differs from that of most, is left out with its reason. Throws
/// `Error` of kind kJob when no image can be read, and as `AverageWhiteImages` does for the white
/// images, or of kind kInput when these are of another size.
ImageDetections DetectOrdinaryImages(const std::vector<FrameImage>& images,
                                     const MarkerDetectorFactory& make_detector,
                                     const DetectOptions& options);

namespace internal {

/// Key of the white images of a camera and of how they are read, for the store.
std::string WhiteKey(const DetectOptions& options);

}  // namespace internal

/// The same of very many images: each is detected and only its sketch kept; what was detected goes
/// to the cache, from which a run over a few of them takes it.
std::vector<ImageSketch> SketchOrdinaryImages(const std::vector<FrameImage>& images,
                                              const MarkerDetectorFactory& make_detector,
                                              const DetectOptions& options);

}  // namespace plenocal
