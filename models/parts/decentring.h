// SPDX-License-Identifier: Apache-2.0
//
// Tangential distortion alone.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Decentring : DistortionPart<0, true, PrismTerms::kNone> {
  static constexpr std::string_view kName = "decentring";
};

}  // namespace plenocal::parts
