// SPDX-License-Identifier: Apache-2.0
//
// A lens that is wider along x towards the top and the bottom of the image: x' = x (1 + c y^2),
// y' = y. An example of a part that scripts/add tries: a header in models/parts.
#pragma once

#include "models/start/lens_part.h"

namespace plenocal::parts {

struct Anamorphic {
  static constexpr std::string_view kName = "anamorphic";
  static constexpr std::string_view kSource = "example: x' = x (1 + c y^2), y' = y";
  static constexpr std::array<Param, 1> kParams{
      Param{.name = "c_xyy", .unit = "1", .scale = 1, .neutral = 0}};
  static constexpr std::array kExample{0.02};

  template <typename T>
  static bool Map(const T* c, const T* m, T* mapped) {
    const T g = 1.0 + c[0] * m[1] * m[1];
    mapped[0] = m[0] * g;
    mapped[1] = m[1];
    return ValueOf(g) > 0;
  }

  static std::optional<Eigen::Vector2d> Unmap(const double* c, const Eigen::Vector2d& mapped) {
    const double g = 1 + c[0] * mapped.y() * mapped.y();
    if (!(g > 0)) return std::nullopt;
    return Eigen::Vector2d(mapped.x() / g, mapped.y());
  }
};

}  // namespace plenocal::parts
