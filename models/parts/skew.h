// SPDX-License-Identifier: Apache-2.0
//
// Axes of the image that are not normal to each other: x' = x + alpha y, y' = y.
//
// Source: OpenCV, fisheye (alpha); the skew in pixels of other tools is alpha f_x.
#pragma once

#include "models/start/lens_part.h"

namespace plenocal::parts {

struct Skew {
  static constexpr std::string_view kName = "skew";
  static constexpr std::string_view kSource =
      "OpenCV, fisheye: alpha; s = alpha f_x in other tools";
  static constexpr std::array<Param, 1> kParams{
      Param{.name = "alpha_s", .unit = "1", .scale = 1, .neutral = 0}};
  static constexpr std::array kExample{0.003};

  template <typename T>
  static bool Map(const T* a, const T* m, T* mapped) {
    mapped[0] = m[0] + a[0] * m[1];
    mapped[1] = m[1];
    return true;
  }

  static std::optional<Eigen::Vector2d> Unmap(const double* a, const Eigen::Vector2d& mapped) {
    return Eigen::Vector2d(mapped.x() - a[0] * mapped.y(), mapped.y());
  }
};

}  // namespace plenocal::parts
