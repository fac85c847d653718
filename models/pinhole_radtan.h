// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with three radial and two tangential terms, OpenCV's five coefficients.
// Equations and source: models/start/radtan_model.h.
#pragma once

#include "models/start/radtan_model.h"

namespace plenocal {

struct PinholeRadtan : RadtanModel<PinholeRadtan, 5> {
  static constexpr std::string_view kName = "pinhole-radtan";
  static constexpr Usage kUsage = Usage::kCommon;
};

}  // namespace plenocal
