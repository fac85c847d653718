// SPDX-License-Identifier: Apache-2.0
//
// Tangential distortion and thin prism.
#pragma once

#include "models/start/plane_distortion.h"

namespace plenocal::parts {

struct Prism : DistortionPart<0, true, PrismTerms::kWhole> {
  static constexpr std::string_view kName = "prism";
};

}  // namespace plenocal::parts
