// SPDX-License-Identifier: Apache-2.0
//
// The three ways to treat marker positions in an adjustment: rigid, within a tolerance, landmarks;
// and the size of a whole target.
#pragma once

#include <Eigen/Core>
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

  /// Held markers that are unknowns all the same, for the sake of scales and distances.
  static constexpr MarkerFreedom Held() { return FromSigma(1e-6); }

  [[nodiscard]] constexpr bool IsRigid() const { return sigma_ == 0; }
  [[nodiscard]] constexpr bool IsHeld() const { return sigma_ <= Held().sigma_; }
  [[nodiscard]] constexpr bool HasTolerance() const { return !IsRigid() && !IsLandmarks(); }
  [[nodiscard]] constexpr bool IsLandmarks() const { return sigma_ == kInfinite; }
  /// Prior standard deviation of each coordinate, m; 0 of rigid targets, infinite of landmarks.
  [[nodiscard]] constexpr double Sigma() const { return sigma_; }
  [[nodiscard]] constexpr double Variance() const { return sigma_ * sigma_; }

 private:
  static constexpr double kInfinite = std::numeric_limits<double>::infinity();

  double sigma_ = 0;
};

/// A target's relative deviation from its nominal size, along all axes of its frame or along some:
/// markers deviate from their places at that size. The prior is about 0.
struct TargetScale {
  int target = 0;                                  ///< of several; as `BundleMarker::target`
  Eigen::Vector3d axes = Eigen::Vector3d::Ones();  ///< 1: of the axes along which it applies
  double sigma = 0;
  double value = 0;
};

}  // namespace plenocal
