// SPDX-License-Identifier: Apache-2.0
//
// A sensor that is tilted against the lens (Scheimpflug): the 13th and 14th coefficients of OpenCV.
//
// Source: OpenCV, calib3d, distortion_model.hpp (computeTiltProjectionMatrix); Louhichi et al.,
// Self-calibration of Scheimpflug cameras (2007). With R = R_y(tau_y) R_x(tau_x):
//
//   w (x', y', 1) = [[R_33, 0, -R_13], [0, R_33, -R_23], [0, 0, 1]] R (x, y, 1)
//
// Defined for w > 0.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "models/start/lens_part.h"

namespace plenocal::parts {

struct Tilt {
  static constexpr std::string_view kName = "tilt";
  static constexpr std::string_view kSource = "OpenCV, calib3d: tau_x, tau_y; Louhichi et al. 2007";
  static constexpr auto kParams = [] {
    constexpr double kRight = std::numbers::pi / 2;
    std::array<Param, 2> params{};
    params[0] = {.name = "tau_x", .unit = "rad", .lower = -kRight, .upper = kRight, .scale = 1};
    params[0].neutral = 0;
    params[1] = params[0];
    params[1].name = "tau_y";
    return params;
  }();
  static constexpr std::array kExample{0.03, -0.02};

  template <typename T>
  static bool Map(const T* a, const T* m, T* mapped) {
    using std::cos, std::sin;
    const T cx = cos(a[0]), sx = sin(a[0]), cy = cos(a[1]), sy = sin(a[1]);
    const T w = sy * m[0] - cy * sx * m[1] + cy * cx;
    const T R33 = cy * cx;
    if (!(w > 0.0 && R33 > 0.0)) return false;
    mapped[0] = (R33 * (cy * m[0] + sy * sx * m[1] - sy * cx) + sy * cx * w) / w;
    mapped[1] = (R33 * (cx * m[1] + sx) - sx * w) / w;
    return true;
  }

  static std::optional<Eigen::Vector2d> Unmap(const double* a, const Eigen::Vector2d& mapped) {
    const double cx = std::cos(a[0]), sx = std::sin(a[0]), cy = std::cos(a[1]), sy = std::sin(a[1]);
    Eigen::Matrix3d R;
    R << cy, sy * sx, -sy * cx, 0, cx, sx, sy, -cy * sx, cy * cx;
    const double R33 = cy * cx;
    // The inverse of the first matrix, then that of the rotation.
    const Eigen::Vector3d rotated((mapped.x() - sy * cx) / R33, (mapped.y() + sx) / R33, 1);
    const Eigen::Vector3d place = R.transpose() * rotated;
    if (!(place.z() > 0)) return std::nullopt;
    return Eigen::Vector2d(place.x() / place.z(), place.y() / place.z());
  }
};

}  // namespace plenocal::parts
