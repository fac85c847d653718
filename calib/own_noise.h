// SPDX-License-Identifier: Apache-2.0
//
// What observations say of each other without a calibration: those of one marker in one view obey a
// relation that has the camera's parameters not in it (`CameraModel::own_fit`). What it leaves is
// noise, and the floor for every calibration's residuals.
#pragma once

#include <map>
#include <span>
#include <vector>

#include "calib/bundle.h"
#include "calib/camera_model.h"

namespace plenocal {

/// The observations of one marker in one view.
using SeenPoint = std::vector<const Observation*>;

/// Adds the points of one view; the pointers stay valid as long as `observations`.
void AddPoints(std::span<const Observation> observations, std::vector<SeenPoint>* points);

struct KindNoise {
  double sigma = 0;       ///< of one coordinate, px
  double redundancy = 0;  ///< coordinates less unknowns
};

using OwnFit = decltype(CameraModel::own_fit);

/// Noise of each kind of observations: variance components by the redundancy of each (an iterated
/// least-squares fit with weights by kind), without the outliers that good points would show once
/// in twenty times. Kinds without redundancy or noise are left out.
std::map<int, KindNoise> NoiseByKind(std::span<const SeenPoint> points, OwnFit fit);

/// The least that any parameters can leave of a camera's observations.
struct Floor {
  double squared = 0;     ///< sum of the squared residuals of unweighted fits, px^2
  double redundancy = 0;  ///< coordinates less three unknowns a point and the like
  int dimension = 0;      ///< coordinates of an observation

  /// Root mean square of one coordinate; NaN without redundancy.
  [[nodiscard]] double Coordinate() const;
  /// Of the residual vector's length, comparable with a calibration's RMS.
  [[nodiscard]] double Length() const;
};

/// Over the observations that `include` accepts; without redundancy for a model without own_fit.
Floor FloorOf(const Bundle& bundle,
              size_t camera,
              const std::function<bool(const BundleObservation&)>& include);

}  // namespace plenocal
