// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/reject.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/adjust/landmarks.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

std::vector<bool> UsedFlags(const Bundle& bundle) {
  std::vector<bool> used;
  for (const BundleObservation& observation : bundle.observations) used.push_back(observation.used);
  return used;
}

}  // namespace

Rejection RejectOutliers(Bundle* bundle) {
  const std::vector<double> lengths = WeightedLengths(*bundle);
  const double p = kFalseRejections / static_cast<double>(std::max<size_t>(1, lengths.size()));
  std::vector<double> thresholds;
  for (const BundleCamera& camera : bundle->cameras) {
    thresholds.push_back(
        std::sqrt(ChiSquareQuantile(static_cast<int>(camera.model->measured.size()), p)));
  }
  Rejection rejection{.threshold = *std::max_element(thresholds.begin(), thresholds.end())};
  std::vector<BundleObservation>& observations = bundle->observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfView(observations, begin);
    const double threshold = thresholds[static_cast<size_t>(observations[begin].camera)];
    size_t good = 0;
    for (size_t i = begin; i < end; ++i) good += lengths[i] <= threshold ? 1 : 0;
    const bool view_is_good = 2 * good >= end - begin;
    for (size_t i = begin; i < end; ++i) {
      const bool used = view_is_good && lengths[i] <= threshold;
      rejection.changed += used != observations[i].used ? 1 : 0;
      observations[i].used = used;
    }
  }
  return rejection;
}

void UseProjecting(const std::vector<bool>& frames, Bundle* bundle) {
  const std::vector<double> lengths = WeightedLengths(*bundle);
  for (size_t i = 0; i < lengths.size(); ++i) {
    BundleObservation& observation = bundle->observations[i];
    observation.used = std::isfinite(lengths[i]) && frames[static_cast<size_t>(observation.frame)];
  }
}

void DropWeakFrames(Bundle* bundle) {
  std::vector<size_t> markers(bundle->T_rig_target.size(), 0);
  std::vector<int> last_frame(bundle->markers.size(), -1);  // that has counted the marker
  for (const BundleObservation& observation : bundle->observations) {
    int& last = last_frame[static_cast<size_t>(observation.marker)];
    if (!observation.used || last == observation.frame) continue;
    last = observation.frame;
    ++markers[static_cast<size_t>(observation.frame)];
  }
  for (BundleObservation& observation : bundle->observations) {
    if (markers[static_cast<size_t>(observation.frame)] < kMinMarkersInFrame) {
      observation.used = false;
    }
  }
}

Rejection RejectLandmarks(Bundle* bundle) {
  constexpr double kMostRejected = 1.0 / 3;
  // Beyond this part of the distance the cost along the ray is far from quadratic.
  constexpr double kLargestDepthSigma = 0.1;
  const std::vector<std::vector<size_t>> of_marker = ObservationsOfMarkers(*bundle);
  std::vector<BundleObservation>& observations = bundle->observations;
  const auto is_used = [&](size_t i) { return observations[i].used; };
  const std::vector<bool> before = UsedFlags(*bundle);
  for (const std::vector<size_t>& indices : of_marker) {
    if (std::ranges::none_of(indices, is_used)) AdjustLandmark(indices, bundle);
  }
  Rejection rejection = RejectOutliers(bundle);
  std::vector<size_t> used;
  for (size_t m = 0; m < of_marker.size(); ++m) {
    used.clear();
    double distance = std::numeric_limits<double>::infinity();
    for (const size_t i : of_marker[m]) {
      const RigidTransform& T = bundle->T_rig_target[static_cast<size_t>(observations[i].frame)];
      distance = std::min(distance, (T * bundle->markers[m].position).norm());
      if (is_used(i)) used.push_back(i);
    }
    const auto all = static_cast<double>(of_marker[m].size());
    const Eigen::Matrix3d H =
        LineariseLandmark(*bundle, used, std::numeric_limits<double>::max()).H;
    const double least = DecomposeSymmetric(H).values[0];
    if (static_cast<double>(used.size()) >= (1 - kMostRejected) * all &&
        least * std::pow(kLargestDepthSigma * distance, 2) > 1) {
      continue;
    }
    for (const size_t i : used) observations[i].used = false;
  }
  rejection.changed = 0;
  for (size_t i = 0; i < before.size(); ++i) {
    rejection.changed += before[i] != observations[i].used ? 1 : 0;
  }
  return rejection;
}

std::vector<bool> SelectFrames(const Bundle& bundle, size_t limit) {
  std::vector<std::vector<int>> seen(bundle.cameras.size());
  for (const BundleObservation& observation : bundle.observations) {
    auto& frames = seen[static_cast<size_t>(observation.camera)];
    if (frames.empty() || frames.back() != observation.frame) frames.push_back(observation.frame);
  }
  std::vector<bool> selected(bundle.T_rig_target.size(), false);
  for (const auto& frames : seen) {
    const size_t count = std::min(limit, frames.size());
    for (size_t i = 0; i < count; ++i) {
      selected[static_cast<size_t>(frames[i * frames.size() / count])] = true;
    }
  }
  return selected;
}

void CheckAllCamerasUsed(const Bundle& bundle) {
  const std::vector<double> coordinates = UsedCoordinates(bundle);
  for (size_t c = 0; c < coordinates.size(); ++c) {
    if (coordinates[c] > 0) continue;
    throw JobError("{}: no observation is left that agrees with the others; check that {}",
                   bundle.cameras[c].name,
                   bundle.HasLandmarks() ? "the points have one number in all cameras and frames"
                                         : "the target file describes the target in the images");
  }
}

}  // namespace plenocal
