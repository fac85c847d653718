// SPDX-License-Identifier: Apache-2.0
#include "engine/rigs/pose_text.h"

#include <fmt/format.h>

#include <numbers>

namespace plenocal {

std::string PoseText(const Vector6d& pose, const Vector6d& sigma, const std::string& rotation) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const auto text = [](const Vector6d& v, int first, double scale, int digits) {
    return fmt::format("({1:.{0}f}, {2:.{0}f}, {3:.{0}f})",
                       digits,
                       scale * v[first],
                       scale * v[first + 1],
                       scale * v[first + 2]);
  };
  return fmt::format("{} +- {} mm, {}{} +- {} degrees",
                     text(pose, 0, 1e3, 3),
                     text(sigma, 0, 1e3, 3),
                     rotation,
                     text(pose, 3, kDegrees, 4),
                     text(sigma, 3, kDegrees, 4));
}

}  // namespace plenocal
