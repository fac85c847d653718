// SPDX-License-Identifier: Apache-2.0
//
// A wrong camera model as the cause of large residuals.
#pragma once

#include <optional>
#include <span>

#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

struct LensCause {
  Finding finding;
  double residual = 0;  ///< of a coordinate with the better model, px
};

/// Whether another camera model describes a camera's points decisively better: each of `models`
/// that can take the place of the camera's own is adjusted to a selection of the views.
std::optional<LensCause> FindLensCause(const CalibrationInput& input,
                                       size_t camera,
                                       std::span<const CameraModel> models);

}  // namespace plenocal
