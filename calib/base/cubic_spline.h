// SPDX-License-Identifier: Apache-2.0
//
// Uniform cubic B-splines (C. de Boor, "A Practical Guide to Splines", 1978).
#pragma once

#include <array>

namespace plenocal {

/// The four B-splines that are not zero between two knots, at t in [0, 1] from the first to the
/// second.
inline std::array<double, 4> CubicBSplines(double t) {
  const double u = 1 - t;
  return {u * u * u / 6,
          (3 * t * t * t - 6 * t * t + 4) / 6,
          (3 * u * u * u - 6 * u * u + 4) / 6,
          t * t * t / 6};
}

}  // namespace plenocal
