// SPDX-License-Identifier: Apache-2.0
//
// Noise of each camera's observations from the residuals of an adjustment.
#pragma once

#include <span>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// Exact (simulated) observations have no noise to estimate; below this, px, they count as exact.
inline constexpr double kSmallestNoise = 1e-9;
/// Noise below this, px, is rounding.
inline constexpr double kRoundingNoise = 1e-6;

/// Degrees of freedom of one camera's observed coordinates that the unknowns of an adjustment use.
struct UsedDegrees {
  double all = 0;
  double by_means = 0;  ///< see `Uncertainty::degrees_used_by_means`
};

/// Variance components such that sums of squares, in sigmas, equal their redundancies (restricted
/// maximum likelihood, with weights by the assumed sigmas). Scale and additive sigma follow from
/// the differences between the observations of one marker in one view, the common sigma from their
/// means; where there are too few of either, or the means scatter no more than the differences
/// explain, all follow from the residuals together, without common noise.
NoiseModel EstimateCameraNoise(const Bundle& bundle, size_t camera, const UsedDegrees& used);

/// Per observation: squared length, px^2, by which errors of `marker_sigma` in each of a marker's
/// coordinates move its image; 0 where the model has none.
std::vector<double> SquaresOfMarkerErrors(const Bundle& bundle, double marker_sigma);

/// Noise with standard deviation `sigma` of an observation with `typical_sigma`: assumed sigmas are
/// scaled down where they are too large; where they are too small an additive sigma joins them.
NoiseModel NoiseOfSigma(double sigma, double typical_sigma);

/// Per camera: number of coordinates of used observations.
std::vector<double> UsedCoordinates(const Bundle& bundle);

/// Noise of each camera from the median length of all residuals in the chosen frames, which
/// outliers hardly move; nothing happens to cameras without any. `typical_sigmas` per camera.
/// Returns the cameras most of whose observations are outside the model's domain; the noise of
/// these is left.
std::vector<size_t> EstimateNoiseRobustly(const std::vector<bool>& frames,
                                          std::span<const double> typical_sigmas,
                                          Bundle* bundle);

/// Noise of each camera by `EstimateCameraNoise`, where its used coordinates exceed the degrees
/// used by the unknowns by one or more; else the residuals do not show it, and it is at least the
/// typical sigma. Never less than what leaves the markers' prior visible in the normal equations.
/// Returns the largest relative change.
double UpdateNoise(std::span<const double> typical_sigmas,
                   std::span<const UsedDegrees> used,
                   Bundle* bundle);

}  // namespace plenocal
