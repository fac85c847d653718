// SPDX-License-Identifier: Apache-2.0
//
// Fisheye camera whose radius in the image is a polynomial of the angle from the axis: OpenCV's
// fisheye, Kalibr's equidistant.
//
// Source: Kannala and Brandt, A generic camera model and calibration method for conventional,
// wide-angle, and fish-eye lenses (PAMI 28, 2006), equation 6 with its first coefficient in f_x,
// f_y. With r = sqrt(x_C^2 + y_C^2):
//
//   theta   = atan2(r, z_C)
//   theta_d = theta (1 + k_1 theta^2 + k_2 theta^4 + k_3 theta^6 + k_4 theta^8)
//   x_Id = f_x theta_d x_C / r + c_x, y_Id = f_y theta_d y_C / r + c_y       (pixels)
//
// Defined for all directions out to the angle where theta_d ceases to grow.
#pragma once

#include <numbers>

#include "models/start/central_model.h"

namespace plenocal {

struct KannalaBrandt4 : LensModel<KannalaBrandt4> {
  static constexpr std::string_view kName = "kannala-brandt4";
  static constexpr Usage kUsage = Usage::kCommon;
  static constexpr std::string_view kSource =
      "Kannala and Brandt, PAMI 2006; OpenCV fisheye, Kalibr equidistant";
  // Scales: what changes theta_d by as much as itself at 90 degrees.
  static constexpr auto kParams = WithIntrinsics<4>({Coefficient("k_1", 0.41),
                                                     Coefficient("k_2", 0.16),
                                                     Coefficient("k_3", 0.067),
                                                     Coefficient("k_4", 0.027)});
  static constexpr std::array kExample{210.0, 212.0, 322.0, 243.0, -0.01, 0.003, -0.0002, 0.00001};
  static constexpr std::array<double, 4> kStart{};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    const T r2 = p.x() * p.x() + p.y() * p.y();
    if (!(r2 > 0.0 || p.z() > 0.0)) return false;  // straight behind has no azimuth
    const T angle = AngleOverRadius(r2, p.z());
    const T q = angle * angle * r2;  // theta^2
    if (!Grows(std::array{ValueOf(k[0]), ValueOf(k[1]), ValueOf(k[2]), ValueOf(k[3])}.data(),
               ValueOf(q))) {
      return false;
    }
    const T stretch = angle * (1.0 + q * (k[0] + q * (k[1] + q * (k[2] + q * k[3]))));
    m[0] = p.x() * stretch;
    m[1] = p.y() * stretch;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double theta_d = m.norm();
    const std::optional<double> theta = SolveIncreasing(
        [&](double t) {
          const double q = t * t;
          return t * (1 + q * (k[0] + q * (k[1] + q * (k[2] + q * k[3]))));
        },
        [&](double t) {
          const double q = t * t;
          return 1 + q * (3 * k[0] + q * (5 * k[1] + q * (7 * k[2] + q * 9 * k[3])));
        },
        [&](double t) { return t <= std::numbers::pi && Grows(k, t * t); },
        theta_d);
    if (!theta) return std::nullopt;
    const double lateral = theta_d > 0 ? std::sin(*theta) / theta_d : 1;
    return Eigen::Vector3d(m.x() * lateral, m.y() * lateral, std::cos(*theta));
  }

 private:
  // Whether theta_d grows over all of [0, theta], q = theta^2.
  static bool Grows(const double* k, double q) {
    return PositiveOn(std::array{1.0, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]}, q);
  }
};

}  // namespace plenocal
