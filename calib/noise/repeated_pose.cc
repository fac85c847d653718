// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/repeated_pose.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

namespace plenocal {
namespace {

// One view determines few of a camera's parameters (a flat target's homography: two); others seem
// determined because distortion has followed the noise. Those with a standard error above a
// hundredth of their own size are undetermined.
void OpenUncertainParameters(const Bundle& bundle, Uncertainty* uncertainty) {
  constexpr double kDetermined = 0.01;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    OpenDirection open{{}, std::numeric_limits<double>::infinity()};
    for (size_t k = 0; k < camera.ModelParams(); ++k) {
      const Param& param = camera.model->params[k];
      double& std_error = uncertainty->param_std_errors[c][k];
      if (std_error <= kDetermined * std::max(std::abs(camera.params[k]), param.scale)) continue;
      std_error = std::numeric_limits<double>::infinity();
      open.parts.emplace_back(bundle.cameras[c].name + "." + std::string(param.name), 1.0);
    }
    if (!open.parts.empty()) uncertainty->open.push_back(open);
  }
}

}  // namespace

bool ShowsOnePose(const Bundle& bundle, std::span<const double> typical_sigmas) {
  if (bundle.T_rig_target.size() < 2) return false;
  struct Sums {
    double count = 0;
    std::array<double, kMaxObservationSize> sum{}, square{}, first{};
  };
  std::map<std::pair<int, int>, Sums> markers;  // (camera, marker)
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    Sums& sums = markers[{observation.camera, observation.marker}];
    if (sums.count++ == 0) sums.first = observation.seen.values;
    for (size_t r = 0; r < kMaxObservationSize; ++r) {
      const double value = observation.seen.values[r] - sums.first[r];
      sums.sum[r] += value;
      sums.square[r] += value * value;
    }
  }
  double degrees = 0, chi2 = 0;
  for (const auto& [key, sums] : markers) {
    const auto c = static_cast<size_t>(key.first);
    const double noise = bundle.cameras[c].noise.Sigma(typical_sigmas[c]);
    for (size_t r = 0; r < bundle.cameras[c].model->measured.size(); ++r) {
      degrees += sums.count - 1;
      chi2 += (sums.square[r] - sums.sum[r] * sums.sum[r] / sums.count) / (noise * noise);
    }
  }
  // Real movement exceeds noise by orders of magnitude; three sigma of vibration does not count.
  constexpr double kStill = 3;
  return degrees > 0 && chi2 < kStill * kStill * degrees;
}

Uncertainty UncertaintyOfOnePose(const Bundle& bundle) {
  Bundle still = bundle;
  for (RigidTransform& T : still.T_rig_target) T = still.T_rig_target[0];
  Uncertainty uncertainty = EstimateUncertainty(still);
  OpenUncertainParameters(bundle, &uncertainty);
  return uncertainty;
}

}  // namespace plenocal
