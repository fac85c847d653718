// SPDX-License-Identifier: Apache-2.0
//
// Double sphere model: rays are projected onto two unit spheres xi apart, then by a pinhole.
//
// Source: Usenko, Demmel and Cremers, The double sphere camera model (3DV 2018), equations 40 to
// 52:
//
//   d_1 = sqrt(x_C^2 + y_C^2 + z_C^2),  z_1 = xi d_1 + z_C
//   d_2 = sqrt(x_C^2 + y_C^2 + z_1^2),  h = alpha d_2 + (1 - alpha) z_1
//   x_Id = f_x x_C / h + c_x, y_Id = f_y y_C / h + c_y               (pixels)
//
// Defined where z_C > -w_2 d_1 with w_1 = alpha / (1 - alpha) for alpha <= 1/2, (1 - alpha) / alpha
// above, and w_2 = (w_1 + xi) / sqrt(2 w_1 xi + xi^2 + 1).
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct DoubleSphere : LensModel<DoubleSphere> {
  static constexpr std::string_view kName = "double-sphere";
  static constexpr Usage kUsage = Usage::kSome;
  static constexpr std::string_view kSource =
      "Usenko, Demmel and Cremers, The double sphere camera model, 3DV 2018";
  static constexpr auto kParams = WithIntrinsics<2>(
      {Param{.name = "xi", .unit = "1", .lower = -1, .upper = 1, .scale = 1, .neutral = 0},
       Param{.name = "alpha", .unit = "1", .lower = 0, .upper = 1, .scale = 1}});
  static constexpr std::array kExample{190.0, 191.0, 322.0, 243.0, -0.18, 0.59};
  // For most lenses the sum of squares has a minimum on each side of xi = 0.
  static constexpr std::array kStart{
      std::array{0.0, 0.5}, std::array{-0.3, 0.5}, std::array{0.5, 0.5}};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    using std::sqrt;
    const T &xi = k[0], &alpha = k[1];
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T d_1 = sqrt(r2 + p.z() * p.z());
    const double a = ValueOf(alpha), x = ValueOf(xi);
    const double w_1 = a <= 0.5 ? a / (1 - a) : (1 - a) / a;
    const double w_2 = (w_1 + x) / std::sqrt(2 * w_1 * x + x * x + 1);
    if (!(ValueOf(p.z()) > -w_2 * ValueOf(d_1))) return false;
    const T z_1 = xi * d_1 + p.z();
    const T d_2 = sqrt(r2 + z_1 * z_1);
    const T h = alpha * d_2 + (1.0 - alpha) * z_1;
    if (!(h > 0.0)) return false;
    m[0] = p.x() / h;
    m[1] = p.y() / h;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double xi = k[0], alpha = k[1], r2 = m.squaredNorm();
    const double square = 1 - (2 * alpha - 1) * r2;
    if (!(square >= 0)) return std::nullopt;
    const double m_z = (1 - alpha * alpha * r2) / (alpha * std::sqrt(square) + 1 - alpha);
    const double scale = (m_z * xi + std::sqrt(m_z * m_z + (1 - xi * xi) * r2)) / (m_z * m_z + r2);
    return Eigen::Vector3d(scale * m.x(), scale * m.y(), scale * m_z - xi);
  }
};

}  // namespace plenocal
