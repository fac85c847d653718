// SPDX-License-Identifier: Apache-2.0
//
// Weights and constants of robust estimation. Residuals enter as ratios to a width, which is a
// multiple of their standard deviation. P. J. Huber, "Robust Statistics", 1981; P. W. Holland and
// R. E. Welsch, "Robust Regression Using Iteratively Reweighted Least-Squares", Communications in
// Statistics A6, 1977 (widths).
#pragma once

namespace plenocal {

/// Robust loss of a bundle adjustment.
enum class Loss { kNone, kHuber, kCauchy };

/// Standard deviation over the median absolute deviation, for normal errors: 1 / Phi^-1(3/4).
inline constexpr double kSigmaPerMad = 1.4826;

/// Standard deviation of each coordinate over the median length of a vector of two such errors:
/// 1 / sqrt(2 ln 2), from Rayleigh's distribution.
inline constexpr double kSigmaPerMedianLength2d = 0.8493218;

/// Standard deviation, px, of a position that is uniform over one pixel, and hence the smallest
/// blur that an image can have: 1 / sqrt(12).
inline constexpr double kPixelSigma = 0.29;

/// Width of Cauchy's weight, in standard deviations, with 95 % efficiency for normal errors.
template <typename T = double>
inline constexpr T kCauchyWidth = T(2.385);
template <typename T = double>
inline constexpr T kCauchyWidthSquared = kCauchyWidth<T>* kCauchyWidth<T>;

/// Cauchy's weight 1 / (1 + q) for q = (residual / width)^2: bounded influence, no point is without
/// weight.
template <typename T>
constexpr T CauchyWeight(T q) {
  return 1 / (1 + q);
}

/// Huber's weight for t = |residual| / width: 1 up to the width, then 1 / t.
constexpr double HuberWeight(double t) { return t > 1 ? 1 / t : 1; }

/// Tukey's biweight for q = (residual / width)^2: zero beyond the width.
constexpr double TukeyWeight(double q) { return q < 1 ? (1 - q) * (1 - q) : 0; }

}  // namespace plenocal
