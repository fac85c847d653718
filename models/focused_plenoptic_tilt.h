// SPDX-License-Identifier: Apache-2.0
//
// Focused plenoptic camera whose micro-lens array is tilted against the sensor: the distance B of a
// micro lens at (x, y) from the sensor is larger by t_x x + t_y y. Equations:
// models/start/plenoptic_model.h. A tilt of a milliradian changes B by a hundredth across an array
// of 10 mm.
#pragma once

#include <algorithm>

#include "models/pinhole_radial3.h"
#include "models/start/plenoptic_model.h"
#include "models/start/plenoptic_start.h"

namespace plenocal {

struct FocusedPlenopticTilt : PlenopticModel<1, 9> {
  static constexpr std::string_view kName = "focused-plenoptic-tilt";
  static constexpr std::string_view kSource =
      "as focused-plenoptic, with a tilted micro-lens array (docs/plenoptic.md)";
  static constexpr auto kParams = [] {
    std::array<Param, kSharedParams.size() + 2> params{};
    std::copy(kSharedParams.begin(), kSharedParams.end(), params.begin());
    // No array stands 0.1 rad off: half of it would touch the sensor.
    params[kSharedParams.size()] = Param{
        .name = "t_x", .unit = "rad", .lower = -0.1, .upper = 0.1, .scale = 0.01, .neutral = 0};
    params[kSharedParams.size() + 1] = Param{
        .name = "t_y", .unit = "rad", .lower = -0.1, .upper = 0.1, .scale = 0.01, .neutral = 0};
    return params;
  }();
  static constexpr std::array kExample{
      0.0161, 0.0149, 0.00052, 402.0, 391.0, -420.0, 3.1e6, 0.061, -0.042, 0.0021, -0.0014};

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    std::vector<StartCandidate> candidates =
        StartPlenoptic(MakeCameraModel<PinholeRadial3>(), problem);
    for (StartCandidate& candidate : candidates) {
      for (const size_t k : {kSharedParams.size(), kSharedParams.size() + 1}) {
        candidate.params.push_back(problem.given[k].value_or(0));
      }
    }
    return candidates;
  }
};

}  // namespace plenocal
