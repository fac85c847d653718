// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with rational radial, tangential and thin-prism terms, OpenCV's twelve
// coefficients.
// Equations and source: models/start/radtan_model.h.
#pragma once

#include "models/start/radtan_model.h"

namespace plenocal {

struct PinholeRadtan12 : RadtanModel<PinholeRadtan12, 12> {
  static constexpr std::string_view kName = "pinhole-radtan12";
  static constexpr Usage kUsage = Usage::kSome;
};

}  // namespace plenocal
