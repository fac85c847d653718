// SPDX-License-Identifier: Apache-2.0
//
// Focused plenoptic camera with a real, thick main lens: its exit pupil is at b_P = 1 / w_P from
// the micro lenses, and it has aberrations of third order. Equations:
// models/start/plenoptic_model.h.
//
// With f_L, b_L0, B and w_P all free a whole family of cameras has the same images
// (docs/plenoptic.md), so w_P is that of a thin lens, 1 / b_L0, unless the session states it.
#pragma once

#include <algorithm>

#include "models/pinhole_radial3.h"
#include "models/start/plenoptic_model.h"
#include "models/start/plenoptic_start.h"

namespace plenocal {

struct PlenopticThick : PlenopticModel<9, -1, 10> {
  static constexpr std::string_view kName = "plenoptic-thick";
  static constexpr std::string_view kSource =
      "as focused-plenoptic, with exit pupil and third-order aberrations (docs/plenoptic.md)";
  static constexpr auto kParams = [] {
    std::array<Param, kSharedParams.size() + 5> params{};
    auto next = std::copy(kSharedParams.begin(), kSharedParams.end(), params.begin());
    *next++ = Param{.name = "w_P", .unit = "m^-1", .scale = 10, .by_others = &InverseOfMainLens};
    // The scales move a point by a pixel of 5 um, 60 um from the middle of a micro image, 5 mm from
    // the middle of the array.
    *next++ = Param{.name = "T_1", .unit = "m^-2", .scale = 2e7, .neutral = 0};
    *next++ = Param{.name = "T_2", .unit = "m^-2", .scale = 1e5, .neutral = 0};
    *next++ = Param{.name = "T_3", .unit = "m^-2", .scale = 3e3, .neutral = 0};
    *next++ = Param{.name = "T_4", .unit = "m^-2", .scale = 3e3, .neutral = 0};
    return params;
  }();
  static constexpr std::array kExample{0.0161,
                                       0.0149,
                                       0.00052,
                                       402.0,
                                       391.0,
                                       -420.0,
                                       3.1e6,
                                       0.061,
                                       -0.042,
                                       48.0,
                                       6e6,
                                       3e4,
                                       -900.0,
                                       700.0};

  static std::string Refusal(const StartProblem& problem) {
    if (!problem.given[kPupil]) return {};
    for (const size_t k : {size_t{0}, size_t{1}, size_t{2}, kPupil}) {
      if ((*problem.fixed)[k] || (!problem.rules.empty() && problem.rules[k].prior)) return {};
    }
    return "f_L, b_L0, B and w_P cannot all be determined: a family of cameras has the same images. "
           "Give one of them a prior or hold it, best by the data sheet (prior: {w_P: {value: 1/b_P, "
           "sigma: 2 % of it}}), or leave out w_P, which then is 1/b_L0";
  }

  /// What moves the edge of a micro image in the corner of the array by half a pixel.
  static std::vector<double> PriorSigmas(const StartProblem& problem) {
    std::vector<double> sigmas(kParams.size(), 0.0);
    double d2 = 0;  // the farthest point from its centre, px^2
    for (const View& view : problem.views) {
      for (const Observation& seen : view.observations) {
        d2 = std::max(d2,
                      std::pow(seen.values[0] - seen.values[2], 2) +
                          std::pow(seen.values[1] - seen.values[3], 2));
      }
    }
    if (!(d2 > 0)) return sigmas;
    constexpr double kMoved = 0.5;  // px
    const Eigen::Vector2d d(std::sqrt(d2), 0),
        c(std::hypot(problem.image_size[0], problem.image_size[1]) / 2, 0);
    const Eigen::Vector4d moved = ThirdOrderTerms(c, d).row(0) * std::pow(problem.config[0], 2);
    for (Eigen::Index k = 0; k < 4; ++k) {
      sigmas[kPupil + 1 + static_cast<size_t>(k)] = kMoved / moved[k];
    }
    return sigmas;
  }

  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    std::vector<StartCandidate> candidates =
        StartPlenopticThick(MakeCameraModel<PinholeRadial3>(), problem);
    for (StartCandidate& candidate : candidates) {
      for (size_t k = kPupil + 1; k < kParams.size(); ++k) {
        candidate.params.push_back(problem.given[k].value_or(0));
      }
    }
    return candidates;
  }

 private:
  static constexpr size_t kPupil = kSharedParams.size();
};

}  // namespace plenocal
