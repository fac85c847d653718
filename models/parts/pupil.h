// SPDX-License-Identifier: Apache-2.0
//
// An entrance pupil that moves along the optical axis with the angle theta of a ray: the ray meets
// the axis in (0, 0, z_p). The camera has no single centre then; e = 0 is the lens alone.
//
// Source: Gennery, Generalized camera calibration including fish-eye lenses (IJCV 68, 2006); the E
// terms of CAHVORE (mrcal, cahvore.cc):
//
//   z_p = (theta / sin(theta) - 1) (e_0 + e_1 theta^2 + e_2 theta^4)
//
// Ends at 150 degrees, since z_p has a pole at 180.
#pragma once

#include <cmath>
#include <numbers>

#include "models/start/lens_part.h"

namespace plenocal::parts {

struct Pupil {
  static constexpr std::string_view kName = "pupil";
  static constexpr std::string_view kSource = "Gennery, IJCV 2006; CAHVORE, E";
  static constexpr double kLargestAngle = 5 * std::numbers::pi / 6;
  // Scales: of some millimetres, as lenses have them, at 90 degrees.
  static constexpr std::array<Param, 3> kParams{
      Param{.name = "e_0", .unit = "m", .scale = 0.005, .neutral = 0},
      Param{.name = "e_1", .unit = "m", .scale = 0.002, .neutral = 0},
      Param{.name = "e_2", .unit = "m", .scale = 0.0008, .neutral = 0}};
  static constexpr std::array kExample{0.002, -0.0004, 0.0001};

  /// z_p sin(theta), the distance of the ray from the origin, m.
  template <typename T>
  static T RayOffset(const T* e, const T& theta) {
    using std::sin;
    const T q = theta * theta;
    return (theta - sin(theta)) * (e[0] + q * (e[1] + q * e[2]));
  }
};

}  // namespace plenocal::parts
