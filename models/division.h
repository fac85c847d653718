// SPDX-License-Identifier: Apache-2.0
//
// Division model: undistorted coordinates are the distorted ones divided by a polynomial of theirs.
//
// Source: Fitzgibbon, Simultaneous linear estimation of multiple view geometry and lens distortion
// (CVPR 2001). A point (x_d, y_d) of the image plane at distance 1, r_d^2 = x_d^2 + y_d^2, is seen
// in the direction
//
//   (x_d, y_d, 1 + lambda r_d^2),   x_Id = f_x x_d + c_x, y_Id = f_y y_d + c_y       (pixels)
//
// and inverted, with r = sqrt(x_C^2 + y_C^2),
//
//   x_d = 2 x_C / (z_C + sqrt(z_C^2 - 4 lambda r^2)),   y_d likewise.
//
// Defined for all directions but straight behind when lambda < 0 (barrel distortion); otherwise for
// z_C > 2 sqrt(lambda) r, where the image ends.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Division : LensModel<Division> {
  static constexpr std::string_view kName = "division";
  static constexpr std::string_view kSource = "Fitzgibbon, CVPR 2001";
  static constexpr auto kParams = WithIntrinsics<1>({Coefficient("lambda")});
  static constexpr std::array kExample{250.0, 252.0, 322.0, 243.0, -0.22};
  static constexpr std::array kStart{0.0};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T fourfold = 4.0 * k[0] * r2;
    const T square = p.z() * p.z() - fourfold;
    if (!(square > 0.0)) return false;
    const T root = sqrt(square);
    T inverse;  // 2 / (z + root), in the form that does not cancel
    if (p.z() > 0.0) {
      inverse = 2.0 / (p.z() + root);
    } else {
      if (!(fourfold < 0.0)) return false;
      inverse = 2.0 * (p.z() - root) / fourfold;
    }
    m[0] = p.x() * inverse;
    m[1] = p.y() * inverse;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double bend = k[0] * m.squaredNorm();
    if (!(bend < 1)) return std::nullopt;  // the other root of the same direction
    return Eigen::Vector3d(m.x(), m.y(), 1 + bend);
  }
};

}  // namespace plenocal
