// SPDX-License-Identifier: Apache-2.0
//
// A formula as the header of a camera model in models/.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "models/formula/lens.h"

namespace plenocal::formula {

/// The header's text. Throws `Error` of kind kInput for formulas that have no closed inverse:
/// `ray`, and `map` without `domain` or `unmap`.
std::string HeaderText(const CameraModel& model,
                       const LensNodes& nodes,
                       std::span<const std::vector<double>> starts);

}  // namespace plenocal::formula
