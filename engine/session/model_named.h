// SPDX-License-Identifier: Apache-2.0
//
// A registered camera model by its name.
#pragma once

#include <string>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// `option` begins the message. Throws `Error` of kind kInput with the nearest name.
const CameraModel* ModelNamed(const std::string& option, const std::string& name);

}  // namespace plenocal
