// SPDX-License-Identifier: Apache-2.0
//
// Four radial coefficients and tangential distortion: Metashape's.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Brown : DistortionPart<4, true, PrismTerms::kNone> {
  static constexpr std::string_view kName = "brown";
};

}  // namespace plenocal::parts
