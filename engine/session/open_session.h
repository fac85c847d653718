// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "calib/files/session.h"

namespace plenocal {

/// Reads a session after the camera models of its `plugins`. Throws `Error` with file, line and
/// key.
Session OpenSession(const std::filesystem::path& path);

/// The registered model of this name. `option` begins the message. Throws `Error` of kind kInput
/// with the nearest name.
const CameraModel* ModelNamed(const std::string& option, const std::string& name);

}  // namespace plenocal
