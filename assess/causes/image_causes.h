// SPDX-License-Identifier: Apache-2.0
//
// Causes that are measured in the images themselves (docs/diagnosis.md).
#pragma once

#include <string>
#include <vector>

#include "calib/camera/image_traits.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// A note, of grade good, when images of the camera have an orientation tag: their pixels are used
/// as recorded, which other programs may not do.
std::vector<Finding> FindOrientationTags(const std::string& camera, const CameraTraits& traits);

/// The defect that makes some images of a camera so much worse than the others that they have at
/// least half of the noise: blur, saturation, a target too small. Of grade good: `Judge` raises it
/// where the calibration is worse for its noise. False alarms: 1e-3 a defect and camera.
std::vector<Finding> FindWorseImages(const Calibration& calibration,
                                     size_t camera,
                                     const CameraTraits& traits);

}  // namespace plenocal
