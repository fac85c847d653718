// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/aperture_shape.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace plenocal::internal {

double ApertureShape(double V) {
  // The segment of height e = 1 - d is 4 sqrt(2) / (3 pi) e^(3/2) (1 - 0.15 e + ..) of the disc.
  // Its inverse is the leading power `first` times 1 + 2/3 * 0.15 e.
  constexpr double kSecondOrder = 0.1;
  const double first =
      std::pow(std::max(0.0, 1 - V) * 3 * std::numbers::pi / (4 * std::sqrt(2)), 2.0 / 3);
  const double e = std::min(1.0, first * (1 + kSecondOrder * first));
  return 4.0 / 3 * e * (2 - e);
}

Eigen::Matrix2d VignettingDisplacement(
    const LensPatches& patches, size_t lens, float V, int column, int row) {
  const double shape = ApertureShape(V);
  const Eigen::Vector2d slope = patches.LogAttenuationGradient(lens, column, row).cast<double>();
  Eigen::Matrix2d displacement;
  displacement << std::sqrt(shape) * slope, shape * slope;
  return displacement;
}

}  // namespace plenocal::internal
