// SPDX-License-Identifier: Apache-2.0
//
// Fisheye camera whose radius in the image is the angle from the axis. Coefficients are parts of it
// (models/parts/).
//
// Source: Kannala and Brandt, A generic camera model and calibration method for conventional,
// wide-angle, and fish-eye lenses (PAMI 28, 2006), equation 2b. With r = sqrt(x_C^2 + y_C^2):
//
//   x_Id = f_x atan2(r, z_C) x_C / r + c_x, y_Id likewise                    (pixels)
//
// Defined for all directions but straight behind.
#pragma once

#include <numbers>

#include "models/start/central_model.h"

namespace plenocal {

struct Equidistant : LensModel<Equidistant> {
  static constexpr std::string_view kName = "equidistant";
  static constexpr std::string_view kSource =
      "Kannala and Brandt, PAMI 2006, equation 6 without coefficients; COLMAP SIMPLE_FISHEYE";
  static constexpr auto kParams = WithIntrinsics<0>({});
  static constexpr std::array kExample{210.0, 212.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T* /*k*/, const Vector3<T>& p, T* m) {
    const T r2 = p.x() * p.x() + p.y() * p.y();
    if (!(r2 > 0.0 || p.z() > 0.0)) return false;  // straight behind has no azimuth
    const T stretch = AngleOverRadius(r2, p.z());
    m[0] = p.x() * stretch;
    m[1] = p.y() * stretch;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* /*k*/, const Eigen::Vector2d& m) {
    const double theta = m.norm();
    if (!(theta < std::numbers::pi)) return std::nullopt;
    const double lateral = theta > 0 ? std::sin(theta) / theta : 1;
    return Eigen::Vector3d(m.x() * lateral, m.y() * lateral, std::cos(theta));
  }
};

}  // namespace plenocal
