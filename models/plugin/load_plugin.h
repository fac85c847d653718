// SPDX-License-Identifier: Apache-2.0
//
// Loading of camera models from shared libraries.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// The models of a plug-in (models/plugin/plugin.h), which stays loaded. Throws `Error` of kind
/// kInput when the file is no plug-in or was built against another version; nothing of it has been
/// called then.
std::span<const CameraModel> LoadPlugin(const std::filesystem::path& path);

namespace internal {

/// Why the file cannot be loaded at all; empty when the system's loader may try, which itself dies
/// of a file that was cut off.
std::string WhyNotLoadable(const std::filesystem::path& path);

}  // namespace internal

}  // namespace plenocal
