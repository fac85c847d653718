// SPDX-License-Identifier: Apache-2.0
//
// The part of an image that the lens lights. Of circular fisheye lenses it is an ellipse (a circle,
// but for pixels that are not square); its outside stays black.
#pragma once

#include <Eigen/Core>

#include "calib/camera/observation.h"

namespace plenocal {

struct ImageCircle {
  Eigen::Vector2d centre;  ///< px
  Eigen::Vector2d radii;   ///< along x and y, px

  /// Its middle lies in an image of that size, and it is not a small spot of it.
  [[nodiscard]] bool IsOf(ImageSize image_size) const {
    const Eigen::Array2d size(image_size[0], image_size[1]);
    return (centre.array() >= 0).all() && (centre.array() <= size).all() &&
           (radii.array() >= 0.1 * size).all();
  }
  /// Whether it contains a place of the image.
  [[nodiscard]] bool Has(const Eigen::Vector2d& u_px) const {
    return ((u_px - centre).array() / radii.array()).matrix().squaredNorm() <= 1;
  }
};

}  // namespace plenocal
