// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "calib/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// Whether another camera model describes a camera's points decisively better: each of `models`
/// that can take the place of the camera's own is adjusted to a selection of the views.
std::vector<Finding> FindLensCauses(const CalibrationInput& input,
                                    size_t camera,
                                    std::span<const CameraModel> models);

}  // namespace plenocal
