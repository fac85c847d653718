// SPDX-License-Identifier: Apache-2.0
//
// The noise of a camera's observations.
#pragma once

#include <cmath>

namespace plenocal {

/// Noise of one camera's measured coordinates, px. An observation has an assumed sigma before its
/// residual is known (`BundleObservation::assumed_sigma`); this model corrects it by what the
/// residuals show.
struct NoiseModel {
  /// Factor on the assumed sigmas: 1 where they are right.
  double detector_scale = 1;
  /// Added in quadrature, px: errors that the detector does not see (model, target, motion).
  double additive_sigma = 0;
  /// Standard deviation, px, of each coordinate of the error that all observations of one marker in
  /// one view have in common, beside their own. Zero where a camera sees a marker once: the two
  /// cannot be separated there.
  double common_sigma = 0;

  /// Standard deviation of each coordinate of an observation without the common part.
  [[nodiscard]] double OwnSigma(double assumed_sigma) const {
    const double own = detector_scale * assumed_sigma;
    return std::sqrt(own * own + additive_sigma * additive_sigma);
  }
  /// Standard deviation of each coordinate of an observation.
  [[nodiscard]] double Sigma(double assumed_sigma) const {
    const double own = OwnSigma(assumed_sigma);
    return std::sqrt(own * own + common_sigma * common_sigma);
  }
};

}  // namespace plenocal
