// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/estimation_findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "calib/adjust/priors.h"

namespace plenocal {

Finding FindingOfSystematicErrors(const std::string& camera, double ratio) {
  return {.code = "points_share_errors",
          .grade = Grade::kGood,
          .cameras = {camera},
          .value = ratio,
          .limit = 1,
          .what = fmt::format(
              "{}: all standard errors include errors that the points of a frame have in common (a "
              "bent board, motion, a lens that the model does not quite describe). The scatter "
              "between frames shows them; they make the standard errors {:.1f} times as large as "
              "the noise of single points alone.",
              camera,
              ratio),
          .remedy = {}};
}

Finding FindingOfOnePose(size_t frames) {
  return {.code = "one_pose",
          .role = FindingRole::kOpenPoses,
          .grade = Grade::kUsable,
          .cameras = {},
          .value = static_cast<double>(frames),
          .what = fmt::format("All {} frames show the target from one pose; they count as one.",
                              frames),
          .remedy = "Move the target or the camera between images."};
}

Finding FindingOfMisfit(const std::string& camera, const std::string& misfit) {
  return {.code = "model_misfit",
          .role = FindingRole::kCause,
          .grade = Grade::kBad,
          .cameras = {camera},
          .what = misfit + ".",
          .remedy = "Compare camera models with 'plenocal try'."};
}

std::vector<Finding> FindingsOfJitter(const Bundle& bundle) {
  const Jitter& jitter = bundle.jitter;
  if (!(jitter.translation_sigma > 0)) return {};
  const auto misplaced = std::count(jitter.misplaced.begin(), jitter.misplaced.end(), true);
  return {
      {.code = "rig_disagrees",
       .grade = Grade::kUsable,
       .cameras = {},
       .value = jitter.rotation_sigma * 180 / std::numbers::pi,
       .what = fmt::format(
           "The rig is not rigid or its frames are not synchronous: within a frame the target's "
           "pose differs between cameras by {:.2g} mm along and {:.2g} degrees about each axis "
           "(standard deviation){}. Standard errors include it.",
           1e3 * jitter.translation_sigma,
           jitter.rotation_sigma * 180 / std::numbers::pi,
           misplaced == 0
               ? ""
               : fmt::format("; {} images that are farther off count for their camera only",
                             misplaced)),
       .remedy = "Look for images of a frame that were not taken at the same time, a camera that "
                 "moves on the rig, frames with wrong names, or a model that does not suit the "
                 "lens."}};
}

std::vector<Finding> FindingsOfTimeShifts(const Bundle& bundle, const Uncertainty& uncertainty) {
  std::vector<Finding> findings;
  const std::vector<BundleCamera>& cameras = bundle.cameras;
  for (size_t c = 0; c < cameras.size(); ++c) {
    const std::optional<size_t> index = cameras[c].Find(nuisances::kTimeShift);
    if (!index) continue;
    const double shift = cameras[c].params[*index];
    findings.push_back(
        {.code = "time_shift",
         .grade = Grade::kGood,
         .cameras = {cameras[c].name},
         .value = shift,
         .what = fmt::format("{}: images were taken {:.3f} +- {:.2g} ms {} than their times, by "
                             "the clock of {}. The calibration includes it.",
                             cameras[c].name,
                             1e3 * std::abs(shift),
                             1e3 * uncertainty.param_std_errors[c][*index],
                             shift > 0 ? "later" : "earlier",
                             cameras[0].name),
         .remedy = {}});
  }
  return findings;
}

std::vector<Finding> FindingsOfTargetScale(const Bundle& bundle, const Uncertainty& uncertainty) {
  constexpr double kContradiction = 4;   // standard deviations
  constexpr double kLeastGained = 1e-3;  // of a prior: less tests rounding
  std::vector<Finding> findings;
  const auto add = [&](double away, std::string what, const char* remedy) {
    if (away < kContradiction) return;
    findings.push_back({.code = "target_scale_contradicted",
                        .grade = Grade::kUsable,
                        .value = away,
                        .limit = kContradiction,
                        .what = std::move(what),
                        .remedy = remedy});
  };
  for (size_t k = 0; uncertainty.scale_index >= 0 && k < bundle.scales.size(); ++k) {
    const auto i = uncertainty.scale_index + static_cast<Eigen::Index>(k);
    const TargetScale& scale = bundle.scales[k];
    const double variance = uncertainty.covariance(i, i);
    const double expected = std::sqrt(std::max(0.0, scale.sigma * scale.sigma - variance));
    if (!(expected > kLeastGained * scale.sigma)) continue;
    const double away = std::abs(scale.value) / expected;
    add(away,
        fmt::format(
            "{} is {:+.3g} +- {:.2g} %, {:.1f} sigmas of what scale_sigma, {:.2g} %, allows.",
            NameOfScale(bundle, scale),
            100 * scale.value,
            100 * std::sqrt(variance),
            away,
            100 * scale.sigma),
        "Measure the print and the distances again; enlarge 'scale_sigma' if the print is off.");
  }
  const auto layout = internal::MakeLayout(bundle);
  const std::vector<internal::SparseRow> rows = internal::RowsOfDistances(bundle, layout);
  for (size_t i = 0; i < rows.size(); ++i) {
    const MarkerDistance& distance = bundle.distances[i];
    add(std::abs(rows[i].residual),
        fmt::format("The distance {}, {:.6g} m, differs by {:+.2g} mm, {:.1f} sigmas, from that of "
                    "the estimated markers.",
                    distance.name,
                    distance.length,
                    -1e3 * rows[i].residual * distance.sigma,
                    std::abs(rows[i].residual)),
        "Measure it again; if the print's size is not exact, state 'scale_sigma' of the target.");
  }
  return findings;
}

std::vector<Finding> FindingsOfRules(const Bundle& bundle, const Uncertainty& uncertainty) {
  constexpr double kContradiction = 4;  // standard deviations
  std::vector<Finding> findings;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    for (size_t k = 0; k < std::min(camera.rules.size(), camera.ModelParams()); ++k) {
      const std::string name = fmt::format("{}.{}", camera.name, camera.model->params[k].name);
      if (camera.at_bound[k] && !camera.rules[k].tied_to) {
        findings.push_back(
            {.code = "at_bound",
             .grade = Grade::kUsable,
             .cameras = {camera.name},
             .value = camera.params[k],
             .what = fmt::format("{} lies on its bound, {:.9g}: the images ask for a value beyond. "
                                 "It has no standard error, and those of others are too small if "
                                 "the bound is wrong.",
                                 name,
                                 camera.params[k]),
             .remedy = "Widen the bound, or look for what contradicts it."});
      }
      // With a correct prior, estimate - value has the variance sigma^2 - (variance of the
      // estimate).
      const auto& prior = camera.rules[k].prior;
      const double std_error = uncertainty.param_std_errors[c][k];
      if (!prior || !(std_error > 0) || !(std_error < prior->sigma)) continue;
      const double expected = std::sqrt(prior->sigma * prior->sigma - std_error * std_error);
      const double away = std::abs(camera.params[k] - prior->value) / expected;
      if (away < kContradiction) continue;
      findings.push_back(
          {.code = "prior_contradicted",
           .grade = Grade::kUsable,
           .cameras = {camera.name},
           .value = away,
           .limit = kContradiction,
           .what = fmt::format("{}: images and prior disagree by {:.1f} sigma (prior "
                               "{:.6g} +- {:.2g}, with the images {:.6g}).",
                               name,
                               away,
                               prior->value,
                               prior->sigma,
                               camera.params[k]),
           .remedy = "One of them is wrong: check the prior, then the images."});
    }
  }
  return findings;
}

}  // namespace plenocal
