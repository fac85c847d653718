// SPDX-License-Identifier: Apache-2.0
//
// Straight line through the variances of pixels over their light: gain * light + read^2.
#pragma once

namespace plenocal {

/// Weighted least squares.
class NoiseLine {
 public:
  void Add(double weight, double light, double variance) {
    light_square_ += weight * light * light;
    light_ += weight * light;
    weight_ += weight;
    light_variance_ += weight * light * variance;
    variance_ += weight * variance;
  }
  /// False where all variances are of one light.
  [[nodiscard]] bool IsDetermined() const { return Determinant() > 0; }
  /// Slope and offset, which may be negative. REQUIRES: `IsDetermined`.
  [[nodiscard]] double Gain() const {
    return (weight_ * light_variance_ - light_ * variance_) / Determinant();
  }
  [[nodiscard]] double ReadVariance() const {
    return (light_square_ * variance_ - light_ * light_variance_) / Determinant();
  }
  /// The line through zero, and the horizontal one.
  [[nodiscard]] double GainAlone() const { return light_variance_ / light_square_; }
  [[nodiscard]] double ReadVarianceAlone() const { return variance_ / weight_; }

 private:
  [[nodiscard]] double Determinant() const { return light_square_ * weight_ - light_ * light_; }

  double light_square_ = 0, light_ = 0, weight_ = 0, light_variance_ = 0, variance_ = 0;
};

}  // namespace plenocal
