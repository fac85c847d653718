// SPDX-License-Identifier: Apache-2.0
//
// Six radial coefficients: before `prism` those of COLMAP's RAD_TAN_THIN_PRISM_FISHEYE and of
// Aria's FisheyeRadTanThinPrism.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Radial6 : DistortionPart<6, false, PrismTerms::kNone> {
  static constexpr std::string_view kName = "radial6";
};

}  // namespace plenocal::parts
