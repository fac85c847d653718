// SPDX-License-Identifier: Apache-2.0
//
// The three ways to treat marker positions in an adjustment: rigid, within a tolerance, landmarks.
#pragma once

#include <limits>

namespace plenocal {

/// Deviation of markers from their nominal positions that an adjustment estimates: none (a rigid
/// target), one with the tolerance as prior, or a free one (landmarks have no nominal position).
class MarkerFreedom {
 public:
  constexpr MarkerFreedom() = default;  ///< rigid
  static constexpr MarkerFreedom Rigid() { return {}; }
  static constexpr MarkerFreedom Landmarks() { return FromSigma(kInfinite); }
  /// `sigma`: as in files and as `Sigma` returns it.
  static constexpr MarkerFreedom FromSigma(double sigma) {
    MarkerFreedom freedom;
    freedom.sigma_ = sigma;
    return freedom;
  }

  [[nodiscard]] constexpr bool IsRigid() const { return sigma_ == 0; }
  [[nodiscard]] constexpr bool HasTolerance() const { return !IsRigid() && !IsLandmarks(); }
  [[nodiscard]] constexpr bool IsLandmarks() const { return sigma_ == kInfinite; }
  /// Prior standard deviation of each coordinate, m; 0 of rigid targets, infinite of landmarks.
  [[nodiscard]] constexpr double Sigma() const { return sigma_; }
  [[nodiscard]] constexpr double Variance() const { return sigma_ * sigma_; }

 private:
  static constexpr double kInfinite = std::numeric_limits<double>::infinity();

  double sigma_ = 0;
};

}  // namespace plenocal
