// SPDX-License-Identifier: Apache-2.0
//
// Noise of a camera's observations from the residuals of an adjustment.
#pragma once

#include "calib/bundle.h"

namespace plenocal {

/// As BundleCamera's fields of these names.
struct CameraNoise {
  double scale = 1, floor = 0, common = 0;
};

/// What the unknowns of an adjustment take up of a camera's observed coordinates.
struct PaidCoordinates {
  double all = 0;
  double by_means = 0;  ///< see `Uncertainty::paid_by_means`
};

/// Variance components such that sums of squares, in sigmas, equal their redundancies (restricted
/// maximum likelihood, with weights by the stated sigmas). Scale and floor follow from what the
/// observations of one marker in one view differ by, the common noise from their means; from all
/// residuals together, without common noise, where there are too few of either or the means
/// scatter no more than the differences let them.
CameraNoise EstimateCameraNoise(const Bundle& bundle, size_t camera, const PaidCoordinates& paid);

}  // namespace plenocal
