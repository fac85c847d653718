// SPDX-License-Identifier: Apache-2.0
//
// Field-of-view model: the radius in the image is proportional to the angle between ray and axis
// of an ideal fisheye of field of view omega.
//
// Source: Devernay and Faugeras, Straight lines have to be straight (Machine Vision and
// Applications 13, 2001). With r = sqrt(x_C^2 + y_C^2):
//
//   r_d  = atan2(2 r tan(omega / 2), z_C) / omega
//   x_Id = f_x r_d x_C / r + c_x, y_Id = f_y r_d y_C / r + c_y       (pixels)
//
// Defined for all directions but straight behind.
#pragma once

#include <numbers>

#include "models/start/central_model.h"

namespace plenocal {

struct Fov : LensModel<Fov> {
  static constexpr std::string_view kName = "fov";
  static constexpr Usage kUsage = Usage::kSome;
  static constexpr std::string_view kSource =
      "Devernay and Faugeras, Straight lines have to be straight, 2001";
  static constexpr auto kParams = WithIntrinsics<1>(
      {Param{.name = "omega", .unit = "rad", .lower = 0, .upper = std::numbers::pi, .scale = 1}});
  static constexpr std::array kExample{260.0, 262.0, 322.0, 243.0, 0.93};
  static constexpr std::array kStart{0.9};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    using std::tan;
    const T& omega = k[0];
    const T stretch = 2.0 * tan(0.5 * omega);
    const T r2 = p.x() * p.x() + p.y() * p.y();
    if (!(r2 > 0.0 || p.z() > 0.0)) return false;
    // r_d / r, where the angle is that of a point `stretch` times as far from the axis
    const T ratio = stretch * AngleOverRadius(T(stretch * stretch * r2), p.z()) / omega;
    m[0] = p.x() * ratio;
    m[1] = p.y() * ratio;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double omega = k[0], r_d = m.norm();
    if (!(r_d * omega < std::numbers::pi)) return std::nullopt;
    const double lateral = r_d > 0 ? std::sin(r_d * omega) / r_d : omega;
    const double stretch = 2 * std::tan(omega / 2);
    return Eigen::Vector3d(
        m.x() * lateral / stretch, m.y() * lateral / stretch, std::cos(r_d * omega));
  }
};

}  // namespace plenocal
