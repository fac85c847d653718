// SPDX-License-Identifier: Apache-2.0
//
// Four radial coefficients, tangential distortion and a thin prism by q: COLMAP's
// THIN_PRISM_FISHEYE after `equidistant`.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct ThinPrism : DistortionPart<4, true, PrismTerms::kThin> {
  static constexpr std::string_view kName = "thin-prism";
};

}  // namespace plenocal::parts
