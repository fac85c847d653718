// SPDX-License-Identifier: Apache-2.0
//
// Causes that are measured in the images themselves (docs/diagnosis.md).
#pragma once

#include <string>
#include <vector>

#include "calib/camera/image_traits.h"
#include "calib/files/finding.h"

namespace plenocal {

/// A note, of grade good, when images of the camera have an orientation tag: their pixels are used
/// as recorded, which other programs may not do.
std::vector<Finding> FindOrientationTags(const std::string& camera, const CameraTraits& traits);

}  // namespace plenocal
