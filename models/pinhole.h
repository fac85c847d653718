// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera without distortion.
//
// Source: Hartley and Zisserman, Multiple View Geometry in Computer Vision, section 6.1:
//
//   x_Id = f_x x_C / z_C + c_x, y_Id = f_y y_C / z_C + c_y           (pixels)
//
// Defined for z_C > 0.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Pinhole : LensModel<Pinhole> {
  static constexpr std::string_view kName = "pinhole";
  static constexpr Usage kUsage = Usage::kCommon;
  static constexpr std::string_view kSource =
      "Hartley and Zisserman, Multiple View Geometry, section 6.1";
  static constexpr auto kParams = WithIntrinsics<0>({});
  static constexpr std::array kExample{410.0, 405.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T* /*k*/, const Vector3<T>& p, T* m) {
    if (!(p.z() > 0.0)) return false;
    m[0] = p.x() / p.z();
    m[1] = p.y() / p.z();
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* /*k*/, const Eigen::Vector2d& m) {
    return Eigen::Vector3d(m.x(), m.y(), 1);
  }
};

}  // namespace plenocal
