// SPDX-License-Identifier: Apache-2.0
//
// Equisolid-angle fisheye: equal solid angles cover equal areas of the image. Added to a copy of
// the project by scripts/add_model, which counts the files that this takes.
//
// Source: Kannala and Brandt, A generic camera model and calibration method (PAMI 28, 2006),
// equation 4. With theta the angle from the axis, d = sqrt(x_C^2 + y_C^2 + z_C^2):
//
//   r = 2 sin(theta / 2), so that (m_x, m_y) = (x_C, y_C) sqrt(2 / (d (d + z_C)))
//
// Defined for all directions but straight behind.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Equisolid : LensModel<Equisolid> {
  static constexpr std::string_view kName = "equisolid";
  static constexpr std::string_view kSource =
      "Kannala and Brandt, A generic camera model and calibration method, 2006, equation 4";
  static constexpr auto kParams = WithIntrinsics<0>({});
  static constexpr std::array kExample{220.0, 222.0, 322.0, 243.0};
  static constexpr std::array<double, 0> kStart{};

  template <typename T>
  static bool Map(const T*, const Vector3<T>& p, T* m) {
    using std::sqrt;
    const T d = sqrt(p.squaredNorm());
    const T behind = d + p.z();
    if (!(behind > 1e-9 * d)) return false;
    const T ratio = sqrt(2.0 / (d * behind));
    m[0] = p.x() * ratio;
    m[1] = p.y() * ratio;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double*, const Eigen::Vector2d& m) {
    const double square = m.squaredNorm();
    if (!(square < 4)) return std::nullopt;
    const double half_angle_cosine = std::sqrt(1 - square / 4);
    return Eigen::Vector3d(
        m.x() * half_angle_cosine, m.y() * half_angle_cosine, 1 - square / 2);
  }
};

}  // namespace plenocal
