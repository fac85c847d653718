// SPDX-License-Identifier: Apache-2.0
//
// The bundle adjustment: choice of its back end.
#pragma once

#include "calib/adjust/bundle.h"
#include "calib/adjust/solution.h"

namespace plenocal {

/// Minimises over intrinsics (with their rules; the start must be within their bounds),
/// T_camera_rig, T_rig_target, jitter (where its sigmas are not zero) and markers. Every used
/// observation must project at the start. Runs on one thread: the same input must give the same
/// bytes.
AdjustSummary Adjust(Bundle* bundle, const AdjustOptions& options);

/// The reason for which a bundle is adjusted with all unknowns in Ceres (`all_unknowns/`) and not
/// with poses and markers eliminated (`reduced/`); empty for the latter, which takes 0.6 of the
/// time and a fifth of the memory.
std::string_view ReasonForAllUnknowns(const Bundle& bundle);

}  // namespace plenocal
