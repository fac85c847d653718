// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// The registered model that a command-line option names; throws `Error` with the nearest name.
const CameraModel* ModelOfOption(const std::string& option, const std::string& name);

}  // namespace plenocal
