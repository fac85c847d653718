// SPDX-License-Identifier: Apache-2.0
//
// Enhanced unified camera model: rays are projected onto an ellipsoid, then by a pinhole.
//
// Source: Khomutenko, Garcia and Martinet, An enhanced unified camera model (RA-L 1, 2016), in the
// form of Usenko, Demmel and Cremers, The double sphere camera model (3DV 2018). With
// r = sqrt(x_C^2 + y_C^2):
//
//   d = sqrt(beta r^2 + z_C^2),  h = alpha d + (1 - alpha) z_C
//   x_Id = f_x x_C / h + c_x, y_Id = f_y y_C / h + c_y               (pixels)
//
// Defined where z_C > -w d with w = alpha / (1 - alpha) for alpha <= 1/2 (there h vanishes) and
// w = (1 - alpha) / alpha above (there the image folds over). alpha = 0 is a pinhole; the equations
// hold for alpha < 0 too, which are lenses with pincushion distortion.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Eucm : LensModel<Eucm> {
  static constexpr std::string_view kName = "eucm";
  static constexpr Usage kUsage = Usage::kSome;
  static constexpr std::string_view kSource =
      "Khomutenko et al., An enhanced unified camera model, RA-L 2016";
  static constexpr auto kParams = WithIntrinsics<2>(
      {Param{.name = "alpha", .unit = "1", .lower = -1, .upper = 1, .scale = 1, .neutral = 0},
       Param{.name = "beta", .unit = "1", .lower = 0, .scale = 1, .neutral = 1}});
  static constexpr std::array kExample{230.0, 232.0, 322.0, 243.0, 0.61, 1.08};
  static constexpr std::array kStart{0.5, 1.0};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    using std::sqrt;
    const T &alpha = k[0], &beta = k[1];
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T d = sqrt(beta * r2 + p.z() * p.z());
    const double a = ValueOf(alpha);
    const double w = a <= 0.5 ? a / (1 - a) : (1 - a) / a;
    if (!(ValueOf(p.z()) > -w * ValueOf(d))) return false;
    const T h = alpha * d + (1.0 - alpha) * p.z();
    if (!(h > 0.0)) return false;
    m[0] = p.x() / h;
    m[1] = p.y() / h;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double alpha = k[0], beta_r2 = k[1] * m.squaredNorm();
    const double square = 1 - (2 * alpha - 1) * beta_r2;
    if (!(square >= 0)) return std::nullopt;
    // The z for which h = 1, a root of (1 - 2 alpha) z^2 - 2 (1 - alpha) z + 1 - alpha^2 beta r^2,
    // each sign of alpha in the form that does not cancel.
    const double root = alpha * std::sqrt(square);
    const double z = alpha < 0 ? (1 - alpha - root) / (1 - 2 * alpha)
                               : (1 - alpha * alpha * beta_r2) / (1 - alpha + root);
    return Eigen::Vector3d(m.x(), m.y(), z);
  }
};

}  // namespace plenocal
