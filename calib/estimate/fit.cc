// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/fit.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <span>

#include "calib/noise/replicate_noise.h"

namespace plenocal {
namespace {

double SquaredLength(const CameraModel& model, const double* residual) {
  double squared = 0;
  for (size_t r = 0; r < model.measured.size(); ++r) squared += residual[r] * residual[r];
  return squared;
}

void AddNoiseFloors(const Bundle& bundle,
                    size_t camera,
                    std::span<const std::array<double, kMaxObservationSize>> residuals,
                    CameraFit* fit) {
  const NoiseFloor used =
      EstimateNoiseFloor(bundle, camera, [](const auto& observation) { return observation.used; });
  if (!(used.redundancy > 0)) return;
  fit->noise_floor = used;
  fit->noise_floor_all =
      EstimateNoiseFloor(bundle, camera, [&](const BundleObservation& observation) {
        const auto place = static_cast<size_t>(&observation - bundle.observations.data());
        return !std::isnan(residuals[place][0]);
      });
}

}  // namespace

CameraFit MeasureFit(const Bundle& bundle, size_t camera, const AssumedSigmas& assumed) {
  const CameraModel& model = *bundle.cameras[camera].model;
  CameraFit fit;
  double sum = 0, sum_all = 0, count_all = 0;
  std::set<int> views;
  const auto residuals = Residuals(bundle, camera);
  for (size_t i = 0; i < residuals.size(); ++i) {
    const BundleObservation& observation = bundle.observations[i];
    if (observation.camera != static_cast<int>(camera)) continue;
    double squared = 0;
    if (!std::isnan(residuals[i][0])) {
      squared = SquaredLength(model, residuals[i].data());
      sum_all += squared;
      ++count_all;
    }
    if (!observation.used) {
      ++fit.rejected;
      continue;
    }
    ++fit.points;
    views.insert(observation.frame);
    sum += squared;
    CameraFit::LensType& lens_type = fit.lens_types[observation.seen.lens_type];
    ++lens_type.points;
    lens_type.rms += squared;  // the sum until the end
  }
  fit.views = static_cast<int>(views.size());
  fit.rms = std::sqrt(sum / std::max(1, fit.points));
  fit.rms_all = std::sqrt(sum_all / std::max(1.0, count_all));
  if (fit.lens_types.size() < 2) fit.lens_types.clear();
  for (auto& [number, lens_type] : fit.lens_types) {
    lens_type.rms = std::sqrt(lens_type.rms / lens_type.points);
  }
  AddNoiseFloors(bundle, camera, residuals, &fit);
  fit.noise_sigma = bundle.cameras[camera].noise.Sigma(assumed.typical);
  fit.common_noise = bundle.cameras[camera].noise.common_sigma;
  fit.detector_sigma = assumed.stated ? assumed.typical : 0;
  return fit;
}

}  // namespace plenocal
