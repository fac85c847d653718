// SPDX-License-Identifier: Apache-2.0
//
// The part of an image that the lens lights. Of circular fisheye lenses it is an ellipse (a circle,
// but for pixels that are not square); its outside stays black.
#pragma once

#include <Eigen/Core>

namespace plenocal {

struct ImageCircle {
  Eigen::Vector2d centre;  ///< px
  Eigen::Vector2d radii;   ///< along x and y, px

  /// Whether it contains a place of the image.
  [[nodiscard]] bool Has(const Eigen::Vector2d& u_px) const {
    return ((u_px - centre).array() / radii.array()).matrix().squaredNorm() <= 1;
  }
};

}  // namespace plenocal
