// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>

#include "targets/target_drawing.h"

namespace plenocal::testing {

inline bool IsInside(const Polygon& polygon, const Eigen::Vector2d& p) {
  bool inside = false;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    if ((a.y() > p.y()) == (b.y() > p.y())) continue;
    if (p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x())) inside = !inside;
  }
  return inside;
}

/// Whether a part is black at a point of its plane.
inline bool IsBlack(const TargetPart& part, const Eigen::Vector2d& p) {
  return std::any_of(part.black.begin(),
                     part.black.end(),
                     [&](const Polygon& polygon) { return IsInside(polygon, p); }) ||
         std::any_of(part.black_discs.begin(), part.black_discs.end(), [&](const Disc& disc) {
           return (p - disc.centre).norm() < disc.radius;
         });
}

}  // namespace plenocal::testing
