// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "calib/camera_model.h"

namespace plenocal {

/// All camera models of models/, sorted by file name. The build makes this table from the headers.
std::span<const CameraModel> CameraModels();

}  // namespace plenocal
