// SPDX-License-Identifier: Apache-2.0
//
// A camera model made of a lens and parts after it: "ucm+radtan+tilt".
#pragma once

#include <span>
#include <string_view>

#include "calib/camera/camera_model.h"
#include "models/start/lens_part.h"

namespace plenocal {

/// Whether parts can follow the model: u = (f_x m_x + c_x, f_y m_y + c_y), where m depends on the
/// other parameters alone. The support of a point, where the model has one, begins with these four.
bool TakesParts(const CameraModel& lens);

/// Adds the model "lens+part+..." to the registry, unless it is there, and gives it. Its parameters
/// are those of the lens, then those of the parts in their order. Throws `Error` of kind kInput for
/// an unknown part, and for two parameters of one name.
const CameraModel* WithParts(const CameraModel& lens, std::string_view name);

/// All parts, sorted by file name. In registry.cc, which the build makes.
std::span<const LensPart> LensParts();

}  // namespace plenocal
