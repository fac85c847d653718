// SPDX-License-Identifier: Apache-2.0
//
// Focused plenoptic camera of the paper: the main lens' exit pupil is the thin lens itself, so the
// micro-lens centres are c_ML = c_I b_L0 / (b_L0 + B). Equations: models/start/plenoptic_model.h.
#pragma once

#include "models/pinhole_radial3.h"
#include "models/start/plenoptic_model.h"
#include "models/start/plenoptic_start.h"

namespace plenocal {

struct FocusedPlenoptic : PlenopticModel<1> {
  static constexpr std::string_view kName = "focused-plenoptic";
  static constexpr Usage kUsage = Usage::kCommon;
  static constexpr std::string_view kSource =
      "Zeller et al., synchronized stereo and plenoptic VO dataset, \"Plenoptic Camera Model\"";
  static constexpr auto kParams = kSharedParams;
  static constexpr std::array kExample{
      0.0161, 0.0149, 0.00052, 402.0, 391.0, -420.0, 3.1e6, 0.061, -0.042};

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    return StartPlenoptic(MakeCameraModel<PinholeRadial3>(), problem);
  }
};

}  // namespace plenocal
