// SPDX-License-Identifier: Apache-2.0
//
// Cameras before their calibration: start values of ordinary ones, and the virtual image of a
// plenoptic camera as that of an ordinary one.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

#include "calib/camera/camera_model.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

/// Index of the parameter; their number if there is none.
size_t ParamOf(const CameraModel& model, std::string_view name);

/// True for a focal length in pixels.
bool IsFocal(const Param& param);

/// Parameters of an ordinary camera from what is given, focal length `focal`, px, where it is not,
/// and an optical axis through the middle of the image.
std::vector<double> OrdinaryStart(const CameraInput& camera, double focal);

/// The virtual image of a plenoptic camera as an ordinary camera of focal length b_L0 + B
/// (docs/plenoptic.md), with what is given of these and the principal point as start values.
CameraInput VirtualCamera(const CameraInput& camera);

}  // namespace plenocal
