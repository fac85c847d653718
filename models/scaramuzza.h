// SPDX-License-Identifier: Apache-2.0
//
// Scaramuzza's omnidirectional camera: a point of the image is seen in a direction whose third
// component is a polynomial of the point's radius.
//
// Source: Scaramuzza, Martinelli and Siegwart, A flexible technique for accurate omnidirectional
// camera calibration (ICVS 2006); OCamCalib; MATLAB's fisheyeIntrinsics, whose a_0 a_2 a_3 a_4 are
// f and b_i = a_i a_0^(i - 1). A point (x_d, y_d) of the plane, rho^2 = x_d^2 + y_d^2, is seen in
// the direction
//
//   (x_d, y_d, 1 + b_2 rho^2 + b_3 rho^3 + b_4 rho^4),  x_Id = f_x x_d + c_x, y_Id = f_y y_d + c_y
//
// in pixels. Defined as far as the angle from the axis grows with rho:
// 1 - b_2 rho^2 - 2 b_3 rho^3 - 3 b_4 rho^4 > 0. With b_2 alone it is `division`.
#pragma once

#include "models/start/central_model.h"

namespace plenocal {

struct Scaramuzza : LensModel<Scaramuzza> {
  static constexpr std::string_view kName = "scaramuzza";
  static constexpr Usage kUsage = Usage::kSome;
  static constexpr std::string_view kSource =
      "Scaramuzza et al., ICVS 2006; OCamCalib, MATLAB fisheyeIntrinsics";
  // Scales: what changes the third component by as much as 1 at a radius of pi / 2.
  static constexpr auto kParams = WithIntrinsics<3>(
      {Coefficient("b_2", 0.41), Coefficient("b_3", 0.26), Coefficient("b_4", 0.16)});
  static constexpr std::array kExample{210.0, 212.0, 322.0, 243.0, -0.33, 0.01, -0.025};
  static constexpr std::array kStart{-0.33, 0.0, -0.02};  // nearly equidistant

  template <typename T>
  static bool Map(const T* b, const Vector3<T>& p, T* m) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const double r_value = std::sqrt(ValueOf(r2)), z_value = ValueOf(p.z());
    if (!(r_value > 0 || z_value > 0)) return false;  // straight behind has no azimuth
    const std::array k{ValueOf(b[0]), ValueOf(b[1]), ValueOf(b[2])};
    const std::optional<double> rho = Radius(k.data(), std::atan2(r_value, z_value));
    if (!rho) return false;
    // The stretch s = rho / r solves s z = h(s r); one step of Newton's method from there carries
    // the derivatives.
    const double s = r_value > 0 ? *rho / r_value : 1 / z_value;
    const T r = r_value > 0 ? T(sqrt(r2)) : T(0.0);
    const T at = s * r;
    const T error = s * p.z() - (1.0 + at * at * (b[0] + at * (b[1] + at * b[2])));
    const double slope = z_value - r_value * HeightSlope(k.data(), *rho);
    if (!(slope > 0)) return false;
    const T stretch = s - error / slope;
    m[0] = p.x() * stretch;
    m[1] = p.y() * stretch;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* b, const Eigen::Vector2d& m) {
    const double rho = m.norm();
    if (!Grows(b, rho)) return std::nullopt;
    return Eigen::Vector3d(m.x(), m.y(), Height(b, rho));
  }

 private:
  static double Height(const double* b, double rho) {
    return 1 + rho * rho * (b[0] + rho * (b[1] + rho * b[2]));
  }
  static double HeightSlope(const double* b, double rho) {
    return rho * (2 * b[0] + rho * (3 * b[1] + rho * 4 * b[2]));
  }
  // Whether the angle grows over all of [0, rho].
  static bool Grows(const double* b, double rho) {
    return PositiveOn(std::array{1.0, 0.0, -b[0], -2 * b[1], -3 * b[2]}, rho);
  }
  // The radius that is seen at that angle.
  static std::optional<double> Radius(const double* b, double theta) {
    return SolveIncreasing([&](double rho) { return std::atan2(rho, Height(b, rho)); },
                           [&](double rho) {
                             const double h = Height(b, rho);
                             return (h - rho * HeightSlope(b, rho)) / (rho * rho + h * h);
                           },
                           [&](double rho) { return Grows(b, rho); },
                           theta);
  }
};

}  // namespace plenocal
