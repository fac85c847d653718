// SPDX-License-Identifier: Apache-2.0
//
// Single images whose residuals are far larger than those of the others.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

std::vector<Finding> FindFrameOutliers(const CauseEvidence& evidence) {
  const Calibration& calibration = *evidence.calibration;
  const Bundle& bundle = calibration.bundle;
  std::map<int, std::vector<double>> lengths;  // by frame, px
  ForEachResidual(
      bundle, evidence.camera, [&](const BundleObservation& observation, const double* residual) {
        lengths[observation.frame].push_back(WeightedLength(bundle, observation, residual));
      });
  std::map<int, double> medians;
  std::vector<double> all;
  for (const auto& [frame, of_frame] : lengths) {
    all.push_back(medians[frame] = Median(of_frame));
  }
  constexpr size_t kLeastFrames = 6;
  if (all.size() < kLeastFrames) return {};
  const double typical = Median(all);
  for (double& value : all) value = std::abs(std::log(value / typical));
  // Medians of images scatter by their size alone; an image that disagrees is far beyond the
  // scatter.
  constexpr double kFactor = 3;
  const double limit = std::max(std::log(kFactor), 6 * kSigmaPerMad * Median(all));
  std::vector<std::string> names;
  double worst = 1;
  for (const auto& [frame, median] : medians) {
    if (std::log(median / typical) < limit) continue;
    names.push_back(calibration.frames[static_cast<size_t>(frame)]);
    worst = std::max(worst, median / typical);
  }
  // Many are no exceptions.
  if (names.empty() || 4 * names.size() > all.size()) return {};
  return {{.code = "frame_outlier",
           .role = FindingRole::kOutlier,
           .follows_from_noise = true,
           .grade = Grade::kUsable,
           .value = worst,
           .limit = std::exp(limit),
           .what = fmt::format("{} with all others: {} (residuals {:.1f} times the typical "
                               "frame's).",
                               names.size() == 1 ? "one frame disagrees" : "some frames disagree",
                               fmt::join(names, ", "),
                               worst),
           .remedy =
               "Look at these images (motion, a wrong detection, another zoom, rotated by the "
               "viewer); leave them out with 'exclude'."}};
}

}  // namespace

Cause FrameOutlierCause() { return {CauseStage::kMotion, FindFrameOutliers}; }

}  // namespace plenocal
