// SPDX-License-Identifier: Apache-2.0
//
// Recordings in which neither target nor camera moves: their frames carry the information of one.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/noise/uncertainty.h"

namespace plenocal {

/// True when every camera has each marker at the same position in all frames, up to noise. Small
/// differences between the estimated poses are then noise as well. `typical_sigmas` per camera.
bool ShowsOnePose(const Bundle& bundle, std::span<const double> typical_sigmas);

/// Uncertainty with all frames at one common pose: the directions that this leaves undetermined
/// show as such, and single parameters that only noise and distortion seem to determine are
/// undetermined too (their standard errors are infinite).
Uncertainty UncertaintyOfOnePose(const Bundle& bundle);

}  // namespace plenocal
