// SPDX-License-Identifier: Apache-2.0
//
// Stereographic fisheye with a radial polynomial: a lens that keeps small shapes, and how a real
// one departs from it.
//
// Source: Fleck, Perspective projection: the wrong imaging model (University of Iowa, 1995), for
// the stereographic projection; the polynomial is Brown's (1966). With d = |p_C|:
//
//   (x, y) = 2 (x_C, y_C) / (d + z_C),  s = x^2 + y^2  (the radius is 2 tan(theta / 2))
//   g = 1 + k_1 s + k_2 s^2
//   x_Id = f_x x g + c_x, y_Id = f_y y g + c_y               (pixels)
//
// Defined as far as the radius sqrt(s) g grows, at most up to straight behind.
#pragma once

#include "models/start/central_model.h"

struct Stereographic : plenocal::LensModel<Stereographic> {
  static constexpr std::string_view kName = "stereographic";
  static constexpr std::string_view kSource =
      "Fleck, Perspective projection: the wrong imaging model, 1995; polynomial: Brown 1966";
  // What is another camera: a tenth of the radius at s = 1 for k_1, at s = 3 for k_2.
  static constexpr auto kParams = plenocal::WithIntrinsics<2>(
      {plenocal::Coefficient("k_1", 0.1), plenocal::Coefficient("k_2", 0.01)});
  static constexpr std::array kExample{260.0, 262.0, 322.0, 243.0, -0.03, -0.002};
  static constexpr std::array kStart{0.0, 0.0};

  template <typename T>
  static bool Map(const T* k, const plenocal::Vector3<T>& p, T* m) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T d = sqrt(r2 + p.z() * p.z());
    T inverse;  // 2 / (d + z_C), in the form that does not cancel
    if (p.z() > 0.0) {
      inverse = 2.0 / (d + p.z());
    } else {
      if (!(r2 > 0.0)) return false;
      inverse = 2.0 * (d - p.z()) / r2;
    }
    const T s = r2 * inverse * inverse;
    if (!Grows(plenocal::ValueOf(k[0]), plenocal::ValueOf(k[1]), plenocal::ValueOf(s))) {
      return false;
    }
    const T g = 1.0 + s * (k[0] + s * k[1]);
    m[0] = p.x() * inverse * g;
    m[1] = p.y() * inverse * g;
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double radius = m.norm();
    const std::optional<double> solved = plenocal::SolveIncreasing(
        [&](double r) { return r * (1 + r * r * (k[0] + r * r * k[1])); },
        [&](double r) { return 1 + r * r * (3 * k[0] + r * r * 5 * k[1]); },
        [&](double r) { return Grows(k[0], k[1], r * r); },
        radius);
    if (!solved) return std::nullopt;
    const double inverse_g = radius > 0 ? *solved / radius : 1;
    return Eigen::Vector3d(m.x() * inverse_g, m.y() * inverse_g, 1 - *solved * *solved / 4);
  }

 private:
  // Whether the derivative of the radius, 1 + 3 k_1 s + 5 k_2 s^2, is positive up to s.
  static bool Grows(double k_1, double k_2, double s) {
    return plenocal::PositiveOn(std::array{1.0, 3 * k_1, 5 * k_2}, s);
  }
};
