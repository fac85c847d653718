// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with three radial distortion terms.
//
// Source: Zeller et al., synchronized stereo and plenoptic VO dataset, "Stereo Camera Model". For
// p_cam = (x_C, y_C, z_C):
//
//   x = x_C / z_C, y = y_C / z_C                                     (normalised image coordinates)
//   r = sqrt(x^2 + y^2)
//   dx = x (A_0 r^2 + A_1 r^4 + A_2 r^6), dy = y (A_0 r^2 + A_1 r^4 + A_2 r^6)
//   x_Id = f_x (x + dx) + c_x, y_Id = f_y (y + dy) + c_y             (pixels)
//
// These are OpenCV's k1, k2, k3. Defined for z_C > 0 and up to the radius where the distorted
// radius r_d(r) = r (1 + A_0 r^2 + A_1 r^4 + A_2 r^6) ceases to grow: beyond it the image folds
// over and two directions would share one pixel.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct PinholeRadial3 : LensModel<PinholeRadial3> {
  static constexpr std::string_view kName = "pinhole-radial3";
  static constexpr Usage kUsage = Usage::kCommon;
  static constexpr std::string_view kSource =
      "Zeller et al., synchronized stereo and plenoptic VO dataset, \"Stereo Camera Model\"";
  static constexpr auto kParams =
      WithIntrinsics<3>({Coefficient("A_0"), Coefficient("A_1"), Coefficient("A_2")});
  static constexpr std::array kExample{400.0, 405.0, 322.0, 243.0, -0.2, 0.06, -0.008};
  static constexpr std::array<double, 3> kStart{};

  template <typename T>
  static bool Map(const T* A, const Vector3<T>& p, T* m) {
    if (!(p.z() > 0.0)) return false;
    const T z_inverse = 1.0 / p.z();
    const T x = p.x() * z_inverse, y = p.y() * z_inverse;
    const T r2 = x * x + y * y;
    if (!Grows({ValueOf(A[0]), ValueOf(A[1]), ValueOf(A[2])}, ValueOf(r2))) return false;
    const T stretch = 1.0 + r2 * (A[0] + r2 * (A[1] + r2 * A[2]));
    m[0] = x * stretch;
    m[1] = y * stretch;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* A, const Eigen::Vector2d& m) {
    const double r_d = m.norm();
    const std::optional<double> r = SolveIncreasing(
        [&](double q) { return q * (1 + q * q * (A[0] + q * q * (A[1] + q * q * A[2]))); },
        [&](double q) { return 1 + q * q * (3 * A[0] + q * q * (5 * A[1] + q * q * 7 * A[2])); },
        [&](double q) {
          return Grows({A[0], A[1], A[2]}, q * q);
        },
        r_d);
    if (!r) return std::nullopt;
    const double shrink = r_d > 0 ? *r / r_d : 1;
    return Eigen::Vector3d(m.x() * shrink, m.y() * shrink, 1);
  }

 private:
  // Whether r_d grows over all of [0, r], s = r^2.
  static bool Grows(const std::array<double, 3>& A, double s) {
    return PositiveOn(std::array{1.0, 3 * A[0], 5 * A[1], 7 * A[2]}, s);
  }
};

}  // namespace plenocal
