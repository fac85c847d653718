// SPDX-License-Identifier: Apache-2.0
#include "calib/warnings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace plenocal {

std::string WarningOfSystematicErrors(const std::string& camera, double ratio) {
  return fmt::format(
      "{}: per-frame estimates scatter {:.1f}x more than detection noise explains: points within a "
      "frame share an error (bent board, motion). Standard errors were scaled by {:.1f}",
      camera,
      ratio,
      ratio);
}

std::string WarningOfOnePose(size_t frames) {
  return fmt::format(
      "all {} frames show the target from one pose; they count as one. Move the target or the "
      "camera between images",
      frames);
}

std::vector<std::string> WarningsOfJitter(const Jitter& jitter) {
  if (!(jitter.translation_sigma > 0)) return {};
  const auto misplaced = std::count(jitter.misplaced.begin(), jitter.misplaced.end(), true);
  return {fmt::format(
      "the rig is not rigid or its frames are not synchronous: within a frame the target's pose "
      "differs between cameras by {:.2g} mm along and {:.2g} degrees about each axis (standard "
      "deviation){}. Images of a frame that were not taken at the same time, a camera that moves on "
      "the rig, frames with wrong names, or a model that does not suit the lens. Standard errors "
      "include it",
      1e3 * jitter.translation_sigma,
      jitter.rotation_sigma * 180 / std::numbers::pi,
      misplaced == 0 ? ""
                     : fmt::format("; {} images that are farther off count for their camera only",
                                   misplaced))};
}

std::vector<std::string> WarningsOfRules(const Calibration& calibration) {
  constexpr double kContradiction = 4;  // standard deviations
  std::vector<std::string> warnings;
  for (size_t c = 0; c < calibration.bundle.cameras.size(); ++c) {
    const BundleCamera& camera = calibration.bundle.cameras[c];
    for (size_t k = 0; k < camera.rules.size(); ++k) {
      const std::string name =
          fmt::format("{}.{}", calibration.bundle.cameras[c].name, camera.model->params[k].name);
      if (camera.at_bound[k] && !camera.rules[k].tied_to) {
        warnings.push_back(fmt::format(
            "{} lies on its bound, {:.9g}: the images ask for a value beyond. It has no "
            "standard error, and those of others are too small if the bound is wrong",
            name,
            camera.params[k]));
      }
      // With a correct prior, estimate - value has the variance sigma^2 - (variance of the
      // estimate).
      const auto& prior = camera.rules[k].prior;
      const double std_error = calibration.uncertainty.param_std_errors[c][k];
      if (!prior || !(std_error > 0) || !(std_error < prior->sigma)) continue;
      const double expected = std::sqrt(prior->sigma * prior->sigma - std_error * std_error);
      const double away = std::abs(camera.params[k] - prior->value) / expected;
      if (away < kContradiction) continue;
      warnings.push_back(
          fmt::format("{}: images and prior disagree by {:.1f} sigma (prior {:.6g} +- {:.2g}, with "
                      "the images {:.6g}); one of them is wrong",
                      name,
                      away,
                      prior->value,
                      prior->sigma,
                      camera.params[k]));
    }
  }
  return warnings;
}

}  // namespace plenocal
