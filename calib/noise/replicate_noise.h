// SPDX-License-Identifier: Apache-2.0
//
// Noise of observations without a calibration, from replicates: the observations of one marker in
// one view obey a relation that does not contain the camera's parameters
// (`CameraModel::replicate_fit`). Its residuals are noise, and a lower bound of every
// calibration's.
#pragma once

#include <functional>
#include <map>
#include <span>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/camera_model.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// The observations of one marker in one view.
using Replicates = std::vector<const Observation*>;

/// Adds the replicates of one view; the pointers stay valid as long as `observations`.
void AddReplicates(std::span<const Observation> observations, std::vector<Replicates>* replicates);

/// Noise of observations through micro lenses of one type.
struct LensTypeNoise {
  double sigma = 0;       ///< of one coordinate, px
  double redundancy = 0;  ///< coordinates less unknowns
};

using ReplicateFit = decltype(CameraModel::replicate_fit);

/// Noise of each lens type: variance components by the redundancy of each (an iterated
/// least-squares fit with weights by type), without the outliers that good points would show once
/// in twenty times. Types without redundancy or noise are left out.
std::map<int, LensTypeNoise> NoiseByLensType(std::span<const Replicates> replicates,
                                             ReplicateFit fit);

/// The smallest residuals of a camera's observations that any parameters allow, over the
/// observations that `include` accepts; without redundancy for a model without replicate_fit.
NoiseFloor EstimateNoiseFloor(const Bundle& bundle,
                              size_t camera,
                              const std::function<bool(const BundleObservation&)>& include);

}  // namespace plenocal
