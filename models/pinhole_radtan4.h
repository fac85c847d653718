// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with two radial and two tangential terms, OpenCV's first four coefficients
// (Kalibr's pinhole-radtan).
// Equations and source: models/start/radtan_model.h.
#pragma once

#include "models/start/radtan_model.h"

namespace plenocal {

struct PinholeRadtan4 : RadtanModel<PinholeRadtan4, 4> {
  static constexpr std::string_view kName = "pinhole-radtan4";
  static constexpr Usage kUsage = Usage::kCommon;
};

}  // namespace plenocal
