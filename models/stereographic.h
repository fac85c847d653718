// SPDX-License-Identifier: Apache-2.0
//
// Stereographic fisheye camera, which keeps small shapes. Coefficients are parts of it
// (models/parts/).
//
// Source: Snyder, Map projections: a working manual (USGS Professional Paper 1395, 1987), section
// 21; mrcal's LENSMODEL_STEREOGRAPHIC. With d = |p_C|:
//
//   x_Id = 2 f_x x_C / (d + z_C) + c_x, y_Id likewise                        (pixels)
//
// Defined for all directions but straight behind.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Stereographic : LensModel<Stereographic> {
  static constexpr std::string_view kName = "stereographic";
  static constexpr std::string_view kSource =
      "Snyder, USGS Professional Paper 1395, 1987; mrcal LENSMODEL_STEREOGRAPHIC";
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
    const T inverse = p.z() > 0.0 ? 2.0 / (d + p.z()) : 2.0 * (d - p.z()) / r2;
    m[0] = p.x() * inverse;
    m[1] = p.y() * inverse;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* /*k*/, const Eigen::Vector2d& m) {
    return Eigen::Vector3d(m.x(), m.y(), 1 - m.squaredNorm() / 4);
  }
};

}  // namespace plenocal
