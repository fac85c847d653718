// SPDX-License-Identifier: Apache-2.0
//
// Equisolid-angle fisheye camera: equal solid angles have equal areas in the image. Coefficients
// are parts of it (models/parts/).
//
// Source: Ray, Applied photographic optics (3rd edition, 2002); Metashape's EquisolidFisheye. With
// d = |p_C|, theta the angle from the axis and r = sqrt(x_C^2 + y_C^2):
//
//   x_Id = 2 f_x sin(theta / 2) x_C / r + c_x = f_x x_C sqrt(2 / (d (d + z_C))) + c_x    (pixels)
//
// Defined for all directions but straight behind.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Equisolid : LensModel<Equisolid> {
  static constexpr std::string_view kName = "equisolid";
  static constexpr std::string_view kSource =
      "Ray, Applied Photographic Optics, 2002; Metashape EquisolidFisheye";
  static constexpr auto kParams = WithIntrinsics<0>({});
  static constexpr std::array kExample{230.0, 232.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T* /*k*/, const Vector3<T>& p, T* m) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    if (!(r2 > 0.0 || p.z() > 0.0)) return false;
    const T d = sqrt(r2 + p.z() * p.z());
    // Behind the camera the sum would lose digits.
    const T inverse = p.z() > 0.0 ? 2.0 / (d * (d + p.z())) : 2.0 * (d - p.z()) / (d * r2);
    const T stretch = sqrt(inverse);
    m[0] = p.x() * stretch;
    m[1] = p.y() * stretch;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* /*k*/, const Eigen::Vector2d& m) {
    const double q = m.squaredNorm();
    if (!(q < 4)) return std::nullopt;
    const double lateral = std::sqrt(1 - q / 4);
    return Eigen::Vector3d(m.x() * lateral, m.y() * lateral, 1 - q / 2);
  }
};

}  // namespace plenocal
