// SPDX-License-Identifier: Apache-2.0
#include "calib/reject.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/landmark_system.h"

namespace plenocal {
namespace {

bool IsRejected(const Bundle& bundle, size_t observation) {
  return bundle.markers[static_cast<size_t>(bundle.observations[observation].marker)].rejected;
}

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
      const bool used = view_is_good && lengths[i] <= threshold && !IsRejected(*bundle, i);
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
    observation.used = std::isfinite(lengths[i]) && !IsRejected(*bundle, i) &&
                       frames[static_cast<size_t>(observation.frame)];
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
  constexpr double kLargestDepthSigma = 0.25;
  const std::vector<bool> before = UsedFlags(*bundle);
  Rejection rejection = RejectOutliers(bundle);
  std::vector<double> all(bundle->markers.size(), 0), used(all);
  std::vector<double> distance(all.size(), std::numeric_limits<double>::infinity());
  for (const BundleObservation& observation : bundle->observations) {
    const auto m = static_cast<size_t>(observation.marker);
    const RigidTransform& T = bundle->T_rig_target[static_cast<size_t>(observation.frame)];
    all[m] += 1;
    used[m] += observation.used ? 1 : 0;
    distance[m] = std::min(distance[m], (T * bundle->markers[m].position).norm());
  }
  const std::vector<Eigen::Matrix3d> information = LandmarkInformation(*bundle);
  std::vector<bool> out(all.size());
  for (size_t m = 0; m < all.size(); ++m) {
    BundleMarker& marker = bundle->markers[m];
    marker.rejected = marker.rejected || all[m] - used[m] > kMostRejected * all[m];
    const double least = DecomposeSymmetric(information[m]).values[0];
    out[m] = marker.rejected || !(least * std::pow(kLargestDepthSigma * distance[m], 2) > 1);
  }
  for (BundleObservation& observation : bundle->observations) {
    if (out[static_cast<size_t>(observation.marker)]) observation.used = false;
  }
  const std::vector<bool> after = UsedFlags(*bundle);
  rejection.changed = 0;
  for (size_t i = 0; i < before.size(); ++i) rejection.changed += before[i] != after[i] ? 1 : 0;
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
    throw Error(ErrorKind::kJob,
                fmt::format("{}: no observation is left that agrees with the others; check that "
                            "the target file describes the target in the images",
                            bundle.cameras[c].name));
  }
}

}  // namespace plenocal
