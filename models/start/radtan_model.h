// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with radial, tangential and thin-prism distortion: the first N = 4, 5, 8 or 12
// coefficients of OpenCV, in its order k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6 s_1 s_2 s_3 s_4.
//
// Source: OpenCV, "Camera Calibration and 3D Reconstruction"; Brown, Decentering distortion of
// lenses (Photogrammetric Engineering 32, 1966) for the first five; Claus and Fitzgibbon, A
// rational function lens distortion model (CVPR 2005) for k_4 to k_6; Weng, Cohen and Herniou (PAMI
// 14, 1992) for the thin prism. With x = x_C / z_C, y = y_C / z_C, r^2 = x^2 + y^2:
//
//   g  = (1 + k_1 r^2 + k_2 r^4 + k_3 r^6) / (1 + k_4 r^2 + k_5 r^4 + k_6 r^6)
//   x' = x g + 2 p_1 x y + p_2 (r^2 + 2 x^2) + s_1 r^2 + s_2 r^4
//   y' = y g + p_1 (r^2 + 2 y^2) + 2 p_2 x y + s_3 r^2 + s_4 r^4
//   x_Id = f_x x' + c_x, y_Id = f_y y' + c_y                         (pixels)
//
// Defined for z_C > 0 out to where the image folds over: the radial part r g ceases to grow, or the
// whole map's Jacobian becomes singular.
#pragma once

#include "calib/base/invert_map.h"
#include "models/start/central_model.h"

namespace plenocal {

template <typename M, size_t N>
struct RadtanModel : LensModel<M> {
  static constexpr std::string_view kSource =
      "OpenCV, Camera Calibration and 3D Reconstruction; Brown 1966, Weng et al. 1992";
  static constexpr auto kParams = [] {
    constexpr std::array<std::string_view, 12> kNames{
        "k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6", "s_1", "s_2", "s_3", "s_4"};
    std::array<Param, N> lens{};
    for (size_t i = 0; i < N; ++i) lens[i] = Coefficient(kNames[i]);
    return WithIntrinsics(lens);
  }();
  static constexpr auto kExample = [] {
    constexpr std::array kFull{600.0,
                               605.0,
                               322.0,
                               243.0,
                               N > 5 ? 0.15 : -0.25,
                               N > 5 ? 0.06 : 0.02,
                               0.0008,
                               -0.0005,
                               -0.008,
                               0.33,
                               0.05,
                               -0.004,
                               0.0012,
                               -0.0003,
                               -0.0007,
                               0.0002};
    std::array<double, 4 + N> example{};
    std::copy_n(kFull.begin(), example.size(), example.begin());
    return example;
  }();
  static constexpr std::array<double, N> kStart{};

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    if (!(p.z() > 0.0)) return false;
    const T x = p.x() / p.z();
    const T y = p.y() / p.z();
    std::array<double, N> k_value;
    for (size_t i = 0; i < N; ++i) k_value[i] = ValueOf(k[i]);
    if (!Lens(k_value.data()).Images(ValueOf(x), ValueOf(y))) return false;

    const T r2 = x * x + y * y;
    T g = 1.0 + r2 * (k[0] + r2 * k[1]);
    if constexpr (N >= 5) g = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    if constexpr (N >= 8) g = g / (1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
    const T &p_1 = k[2], &p_2 = k[3];
    m[0] = x * g + 2.0 * p_1 * x * y + p_2 * (r2 + 2.0 * x * x);
    m[1] = y * g + p_1 * (r2 + 2.0 * y * y) + 2.0 * p_2 * x * y;
    if constexpr (N >= 12) {
      m[0] = m[0] + r2 * (k[8] + r2 * k[9]);
      m[1] = m[1] + r2 * (k[10] + r2 * k[11]);
    }
    return true;
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const Lens lens(k);
    Eigen::Vector2d xy = m;
    constexpr int kMaxIterations = 100;
    constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding
    for (int i = 0; i < kMaxIterations && !lens.Images(xy.x(), xy.y()); ++i) xy *= 0.9;
    const auto map =
        [&](const Eigen::Vector2d& at, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
          *slope = lens.Jacobian(at.x(), at.y());
          return Map(k, Vector3<double>(at.x(), at.y(), 1), image->data());
        };
    const std::optional<Eigen::Vector2d> place = InvertMap(map, m, xy, kLastStep * (1 + m.norm()));
    if (!place) return std::nullopt;
    return place->homogeneous();
  }

 private:
  // The distortion of one set of coefficients, with derivatives.
  class Lens {
   public:
    explicit Lens(const double* k) {
      std::copy_n(k, N, k_.begin());
      P_ = {1, k_[0], k_[1], k_[4]};
      Q_ = {1};
      if constexpr (kRational) Q_ = {1, k_[5], k_[6], k_[7]};
      // (r P / Q)' Q^2 = P Q + 2 s (P' Q - P Q') with s = r^2; the term P_i Q_j s^(i + j) of P Q
      // has i P_i Q_j s^(i + j) and j P_i Q_j s^(i + j) in s P' Q and s P Q'.
      for (size_t i = 0; i < P_.size(); ++i) {
        for (size_t j = 0; j < Q_.size(); ++j) {
          slope_[i + j] +=
              P_[i] * Q_[j] * (1 + 2 * (static_cast<double>(i) - static_cast<double>(j)));
        }
      }
    }
    [[nodiscard]] double Gain(double s) const { return Value(P_, s) / Value(Q_, s); }
    // Whether r g grows over all of [0, sqrt(s)].
    [[nodiscard]] bool Grows(double s) const { return PositiveOn(Q_, s) && PositiveOn(slope_, s); }
    [[nodiscard]] Eigen::Matrix2d Jacobian(double x, double y) const {
      const double s = x * x + y * y;
      const double g = Gain(s);
      const double q = Value(Q_, s);
      const double g_s = (Slope(P_, s) - g * Slope(Q_, s)) / q;
      const double p_1 = k_[2], p_2 = k_[3];
      const double prism_x = 2 * (k_[8] + 2 * s * k_[9]), prism_y = 2 * (k_[10] + 2 * s * k_[11]);
      const double mixed = 2 * x * y * g_s + 2 * p_1 * x + 2 * p_2 * y;
      Eigen::Matrix2d J;
      J << g + 2 * x * x * g_s + 2 * p_1 * y + 6 * p_2 * x + x * prism_x, mixed + y * prism_x,
          mixed + x * prism_y, g + 2 * y * y * g_s + 6 * p_1 * y + 2 * p_2 * x + y * prism_y;
      return J;
    }
    // Whether the image has not folded over between the axis and (x, y).
    [[nodiscard]] bool Images(double x, double y) const {
      return Grows(x * x + y * y) && Jacobian(x, y).determinant() > 0;
    }

   private:
    template <size_t n>
    static double Value(const std::array<double, n>& c, double s) {
      double value = 0;
      for (size_t i = n; i-- > 0;) value = value * s + c[i];
      return value;
    }
    template <size_t n>
    static double Slope(const std::array<double, n>& c, double s) {
      double slope = 0;
      for (size_t i = n; i-- > 1;) slope = slope * s + static_cast<double>(i) * c[i];
      return slope;
    }

    static constexpr bool kRational = N >= 8;

    std::array<double, 12> k_{};
    std::array<double, 4> P_;
    std::array<double, kRational ? 4 : 1> Q_;
    std::array<double, kRational ? 7 : 4> slope_{};
  };
};

}  // namespace plenocal
