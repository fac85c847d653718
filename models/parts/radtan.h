// SPDX-License-Identifier: Apache-2.0
//
// Two radial coefficients and tangential distortion: OpenCV's first four; of omnidir after `ucm`.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Radtan : DistortionPart<2, true, PrismTerms::kNone> {
  static constexpr std::string_view kName = "radtan";
};

}  // namespace plenocal::parts
