// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with rational radial and two tangential terms, OpenCV's eight coefficients.
// Equations and source: models/start/radtan_model.h.
#pragma once

#include "models/start/radtan_model.h"

namespace plenocal {

struct PinholeRadtan8 : RadtanModel<PinholeRadtan8, 8> {
  static constexpr std::string_view kName = "pinhole-radtan8";
  static constexpr Usage kUsage = Usage::kCommon;
};

}  // namespace plenocal
