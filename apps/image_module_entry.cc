// SPDX-License-Identifier: Apache-2.0
#include "apps/image_module.h"

extern "C" void plenocal_detect_images(const std::vector<plenocal::FrameImage>& images,
                                       const plenocal::Target& target,
                                       const plenocal::DetectOptions& options,
                                       plenocal::ImageDetections* detections) {
  *detections = plenocal::DetectImages(images, target, options);
}
