// SPDX-License-Identifier: Apache-2.0
//
// The three ways in which an adjustment treats the positions of markers.
#pragma once

#include <limits>

namespace plenocal {

/// The deviation of markers from their nominal positions that an adjustment estimates: none (a
/// rigid target), errors of a tolerance, or any (landmarks, which have no nominal position).
class MarkerFreedom {
 public:
  constexpr MarkerFreedom() = default;  ///< rigid
  static constexpr MarkerFreedom Rigid() { return {}; }
  static constexpr MarkerFreedom Landmarks() { return FromSigma(kInfinite); }
  /// `sigma`: as files state it and `Sigma` returns it.
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
