// SPDX-License-Identifier: Apache-2.0
//
// A tag of no family, drawn pixel by pixel from its definition.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "detectors/tags/refine_tags.h"

namespace plenocal::testing {

constexpr double kTagWhite = 210, kTagBlack = 40;

/// Black ring of one bit around random data, on white. In its plane the unit square with y up.
struct SyntheticTag {
  explicit SyntheticTag(unsigned seed) {
    std::mt19937 random(seed);
    bits.assign(kWidth * kWidth, false);
    for (int y = 1; y < kWidth - 1; ++y) {
      for (int x = 1; x < kWidth - 1; ++x) bits[y * kWidth + x] = random() % 2 == 0;
    }
  }

  double operator()(const Eigen::Vector2d& p) const {
    const int x = static_cast<int>(std::floor(p.x() * kWidth));
    const int y = static_cast<int>(std::floor((1 - p.y()) * kWidth));
    if (x < 0 || y < 0 || x >= kWidth || y >= kWidth) return kTagWhite;
    return bits[y * kWidth + x] ? kTagWhite : kTagBlack;
  }

  static internal::TagBorder Border() {
    return {.width = kWidth, .ring = 1, .outside = 1, .outside_sign = 1, .corner_squares = false};
  }

  static constexpr int kWidth = 8;
  std::vector<bool> bits;
};

/// A view with the tag's middle at `middle` (px), `side` px wide, tilted and rolled.
inline Eigen::Matrix3d TagView(double side, double roll, const Eigen::Vector2d& middle) {
  Eigen::Matrix3d to_middle = Eigen::Matrix3d::Identity(), tilt, H = Eigen::Matrix3d::Identity();
  to_middle.topRightCorner<2, 1>() << -0.5, -0.5;
  // Upright in the image: its y axis points down.
  tilt << side, 0.1 * side, 0, 0.05 * side, -0.9 * side, 0, 0.12, 0.08, 1;
  H.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(roll).toRotationMatrix();
  H.topRightCorner<2, 1>() = middle;
  return H * tilt * to_middle;
}

/// The images of its corners: lower left, lower right, upper right, upper left.
inline internal::Quad TagCorners(const Eigen::Matrix3d& H) {
  internal::Quad corners;
  const Eigen::Vector2d places[] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  for (std::size_t k = 0; k < 4; ++k) corners[k] = (H * places[k].homogeneous()).hnormalized();
  return corners;
}

/// Each corner displaced by `off` px in another direction.
inline internal::Quad Displaced(internal::Quad corners, double off) {
  for (std::size_t k = 0; k < 4; ++k) {
    const double direction = 1 + 2.3 * static_cast<double>(k);
    corners[k] += off * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  }
  return corners;
}

}  // namespace plenocal::testing
