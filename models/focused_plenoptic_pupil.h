// SPDX-License-Identifier: Apache-2.0
//
// Focused plenoptic camera whose main lens has its exit pupil elsewhere than a thin lens: b_P, the
// pupil's distance from the micro lenses, is a parameter of its own. Equations:
// models/start/plenoptic_model.h.
//
// Beside principal point and distortion only three numbers are observable
// (docs/plenoptic.md): with f_L, b_L0, B and b_P all free a whole family of cameras has the same
// images. So one of them must be fixed.
#pragma once

#include <algorithm>

#include "models/pinhole_radial3.h"
#include "models/start/plenoptic_model.h"
#include "models/start/plenoptic_start.h"

namespace plenocal {

struct FocusedPlenopticPupil : PlenopticModel<9> {
  static constexpr std::string_view kName = "focused-plenoptic-pupil";
  static constexpr std::string_view kSource =
      "as focused-plenoptic, with the exit pupil at b_P (docs/plenoptic.md)";
  static constexpr auto kParams = [] {
    std::array<Param, kSharedParams.size() + 1> params{};
    std::copy(kSharedParams.begin(), kSharedParams.end(), params.begin());
    params.back() = Param{"b_P", "m", 0};
    return params;
  }();
  static constexpr std::array kExample{
      0.0161, 0.0149, 0.00052, 402.0, 391.0, -420.0, 3.1e6, 0.061, -0.042, 0.021};

  static std::string Refusal(const StartProblem& problem) {
    for (const size_t k : {0, 1, 2, 9}) {
      if ((*problem.fixed)[k]) return {};
    }
    return "f_L, b_L0, B and b_P cannot all be determined: a family of cameras has the same "
           "images. Hold one of them, best f_L from the data sheet: initial: {f_L: ...}, fixed: "
           "[f_L]; or use focused-plenoptic";
  }

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    return StartPlenopticPupil(MakeCameraModel<PinholeRadial3>(), problem);
  }
};

}  // namespace plenocal
