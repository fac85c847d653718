// SPDX-License-Identifier: Apache-2.0
//
// Four radial coefficients: `equidistant+radial4` is `kannala-brandt4`.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Radial4 : DistortionPart<4, false, PrismTerms::kNone> {
  static constexpr std::string_view kName = "radial4";
};

}  // namespace plenocal::parts
