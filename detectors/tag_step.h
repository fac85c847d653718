// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace plenocal::internal {

/// erf(z / sqrt(2)), a unit step of -1 to 1 blurred by 1, and its derivative, by linear
/// interpolation; the error is below 1e-5, a thousandth of a gray level.
class StepTable {
 public:
  /// Beyond, the step's remainder is a thirtieth of the last of 256 gray levels.
  static constexpr float kReach = 4;

  static const StepTable& Get() {
    static const StepTable table;
    return table;
  }
  void operator()(float z, float* value, float* slope) const {
    const float at = std::clamp(z * static_cast<float>(kPerUnit) + kMiddle, 0.f, kSize - 1.f);
    const int i = static_cast<int>(at);
    const float f = at - static_cast<float>(i);
    *value = value_[i] + f * (value_[i + 1] - value_[i]);
    *slope = slope_[i] + f * (slope_[i + 1] - slope_[i]);
  }

 private:
  StepTable() {
    for (int i = 0; i <= kSize; ++i) {
      const double z = (i - kMiddle) / kPerUnit;
      value_[i] = static_cast<float>(std::erf(z / std::numbers::sqrt2));
      slope_[i] = static_cast<float>(std::sqrt(2 / std::numbers::pi) * std::exp(-z * z / 2));
    }
  }
  static constexpr double kPerUnit = 128;
  static constexpr int kSize = static_cast<int>(2 * kReach * kPerUnit);
  static constexpr int kMiddle = kSize / 2;  ///< where z is 0
  std::array<float, kSize + 1> value_, slope_;
};

}  // namespace plenocal::internal
