// SPDX-License-Identifier: Apache-2.0
#include "calib/reject.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/base/error.h"
#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {

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
