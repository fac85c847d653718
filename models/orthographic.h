// SPDX-License-Identifier: Apache-2.0
//
// Orthographic fisheye camera, whose radius in the image is the sine of the angle from the axis.
// Coefficients are parts of it (models/parts/).
//
// Source: Ray, Applied photographic optics (3rd edition, 2002). With d = |p_C|:
//
//   x_Id = f_x x_C / d + c_x, y_Id = f_y y_C / d + c_y                       (pixels)
//
// Defined for z_C > 0.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Orthographic : LensModel<Orthographic> {
  static constexpr std::string_view kName = "orthographic";
  static constexpr std::string_view kSource =
      "Ray, Applied Photographic Optics, 2002; mrcal LENSMODEL_CAHVORE with linearity -1";
  static constexpr auto kParams = WithIntrinsics<0>({});
  static constexpr std::array kExample{480.0, 482.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T* /*k*/, const Vector3<T>& p, T* m) {
    using std::sqrt;
    if (!(p.z() > 0.0)) return false;
    const T d = sqrt(p.x() * p.x() + p.y() * p.y() + p.z() * p.z());
    m[0] = p.x() / d;
    m[1] = p.y() / d;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* /*k*/, const Eigen::Vector2d& m) {
    const double q = m.squaredNorm();
    if (!(q < 1)) return std::nullopt;
    return Eigen::Vector3d(m.x(), m.y(), std::sqrt(1 - q));
  }
};

}  // namespace plenocal
