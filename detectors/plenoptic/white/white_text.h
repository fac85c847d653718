// SPDX-License-Identifier: Apache-2.0
//
// Properties of a camera from its white images, in words.
#pragma once

#include <string>

#include "detectors/plenoptic/white/white_camera.h"

namespace plenocal {

/// For the terminal. `name`: of the camera; `images`: number of those given.
std::string WhiteText(const std::string& name, size_t images, const WhiteCamera& camera);

}  // namespace plenocal
