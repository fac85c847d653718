// SPDX-License-Identifier: Apache-2.0
//
// Focus or zoom that changed during the recording.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"

namespace plenocal {
namespace {

constexpr double kFocusLevel = 1e-3;  // false alarms, a camera

/// Estimates of the views' own magnifications.
struct Zooms {
  std::vector<int> frames;
  std::vector<double> changes;      ///< relative to the camera's
  std::vector<double> information;  ///< inverse of their variances
};

Zooms EstimateZooms(const std::vector<ViewRows>& views, ImageSize image_size) {
  Zooms zooms;
  const Eigen::RowVector2d middle((image_size[0] - 1) / 2.0, (image_size[1] - 1) / 2.0);
  for (const ViewRows& view : views) {
    Eigen::MatrixXd X(view.residual.size(), 1);
    for (Eigen::Index i = 0; i < view.noise.size(); ++i) {
      X.block<2, 1>(2 * i, 0) = (view.position.row(i) - middle).transpose() / view.noise[i];
    }
    const Regression regression = Regress(view, X);
    if (!(regression.information(0, 0) > 0)) continue;
    zooms.frames.push_back(view.frame);
    zooms.changes.push_back(regression.estimate[0]);
    zooms.information.push_back(regression.information(0, 0));
  }
  return zooms;
}

// A step in the magnification between two parts of the recording.
std::vector<Finding> FindFocusChange(const CauseEvidence& evidence) {
  constexpr Eigen::Index kLeastPart = 3;  // views before and after
  const Calibration& calibration = *evidence.calibration;
  const BundleCamera& camera = calibration.bundle.cameras[evidence.camera];
  const Zooms zooms = EstimateZooms(evidence.views, camera.image_size);
  const auto count = static_cast<Eigen::Index>(zooms.frames.size());
  if (count < 2 * kLeastPart + 2) return {};
  const SequenceSplit split =
      LargestSplit(Eigen::Map<const Eigen::VectorXd>(zooms.changes.data(), count),
                   Eigen::Map<const Eigen::VectorXd>(zooms.information.data(), count),
                   kLeastPart);
  constexpr double kNoiseOfPoints = 1;  // in units of `information`
  if (split.Probability(kNoiseOfPoints) > kFocusLevel) return {};
  const double change = split.step[0];
  const int frame = zooms.frames[static_cast<size_t>(split.first)];
  return {{.code = "focus_changed",
           .role = FindingRole::kCause,
           .grade = Grade::kUsable,
           .value = change,
           .limit = 0,
           .what = fmt::format("focus or zoom changed during the recording: from frame {} on the "
                               "image is {:.2f} % {} than before.",
                               calibration.frames[static_cast<size_t>(frame)],
                               100 * std::abs(change),
                               change > 0 ? "larger" : "smaller"),
           .remedy =
               "Turn autofocus, zoom and image stabilisation off and record again, or calibrate "
               "the two parts as sessions of their own."}};
}

}  // namespace

Cause FocusChangedCause() { return {CauseStage::kMotion, FindFocusChange}; }

}  // namespace plenocal
