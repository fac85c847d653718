// SPDX-License-Identifier: Apache-2.0
//
// Place of a scene point in the image of an ordinary camera.
#pragma once

#include <array>
#include <optional>

#include "calib/adjust/bundle.h"
#include "calib/camera/rays.h"

namespace plenocal {

/// px; nothing where the camera does not image the point, or less than `border` px inside.
inline std::optional<Eigen::Vector2d> PlaceInImage(const BundleCamera& camera,
                                                   const Eigen::Vector3d& p_cam,
                                                   double border) {
  std::array<double, kMaxObservationSize> values{};
  Eigen::Vector2d u;
  if (!Project(camera, values.data(), p_cam, u.data())) return std::nullopt;
  const Eigen::Vector2d end(camera.image_size[0] - 1 - border, camera.image_size[1] - 1 - border);
  if (!(u.minCoeff() >= border) || !(u.x() <= end.x()) || !(u.y() <= end.y())) return std::nullopt;
  // Models may fold places far outside the image back into it.
  values = {u.x(), u.y()};
  const std::optional<Ray> ray = Unproject(camera, values.data());
  constexpr double kSameRay = 0.999;
  if (!ray || !(ray->direction.dot(p_cam.normalized()) > kSameRay)) return std::nullopt;
  return u;
}

}  // namespace plenocal
