// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "calib/files/session.h"

namespace plenocal {

/// Reads a session after the camera models of its `plugins`. Throws `Error` with file, line and
/// key.
Session OpenSession(const std::filesystem::path& path);

}  // namespace plenocal
