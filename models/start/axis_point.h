// SPDX-License-Identifier: Apache-2.0
//
// Cameras whose rays meet the optical axis in points that depend on the rays' angles from it: an
// entrance pupil that moves, a flat port.
//
// The ray at the angle theta meets the axis in (0, 0, z_p(theta)). With r = |(X, Y)|, the ray
// through the point (X, Y, Z) / h has the theta of
//
//   r cos(theta) - Z sin(theta) + h w(theta) = 0,     w = z_p sin(theta)
//
// which Newton's method finds from theta = atan2(r, Z). The lens images (X, Y, Z - h z_p).
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "models/start/lens_part.h"

namespace plenocal {

/// The point that a lens in the camera frame's origin has to image, with derivatives of its z; x
/// and y stay.
struct ShiftedPoint {
  Eigen::Vector3d p;
  Eigen::RowVector3d z_by_p;
  double z_by_h = 0;
  std::array<double, kMostPartParams> z_by_a{};
};

/// Nothing where several rays or none hit the point, and beyond the part's largest angle.
std::optional<ShiftedPoint> ShiftToLens(const LensPart& part,
                                        const double* a,
                                        const Eigen::Vector3d& p,
                                        double h);

/// z_p of the ray in a direction of length 1, m; nothing beyond the part's largest angle.
std::optional<double> AxisPointOf(const LensPart& part,
                                  const double* a,
                                  const Eigen::Vector3d& direction);

}  // namespace plenocal
