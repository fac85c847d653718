// SPDX-License-Identifier: Apache-2.0
//
// Two radial coefficients.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Radial2 : DistortionPart<2, false, PrismTerms::kNone> {
  static constexpr std::string_view kName = "radial2";
};

}  // namespace plenocal::parts
