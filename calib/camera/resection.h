// SPDX-License-Identifier: Apache-2.0
//
// The pose of a camera from rays to known points.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "calib/camera/camera_model.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal {

/// Pose of a camera from rays to known points; works for planar and for spatial point sets, for
/// fields of view beyond 180 degrees, and for cameras without a single centre.
struct Resection {
  RigidTransform T_camera_target;
  double rms = 0;  ///< root mean square angle between ray and point, rad
};

/// Closed-form start (homography for points near a plane, direct linear transform otherwise; for a
/// plane also its mirrored tilt, the second minimum of far or small targets), then robust
/// refinement of the angles. `rays[i]` sees `points[i]`. Nothing for fewer than four points, for
/// points on one line, or when no pose puts the points in front of the camera.
std::optional<Resection> Resect(std::span<const Ray> rays, std::span<const Eigen::Vector3d> points);

}  // namespace plenocal
