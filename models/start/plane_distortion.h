// SPDX-License-Identifier: Apache-2.0
//
// Distortion of the plane at distance 1 by polynomials: radial, tangential, thin prism. Models
// (radtan_model.h) and parts of lenses have it.
//
// Source: OpenCV, "Camera Calibration and 3D Reconstruction"; Brown, Decentering distortion of
// lenses (Photogrammetric Engineering 32, 1966); Claus and Fitzgibbon, A rational function lens
// distortion model (CVPR 2005) for d; Weng, Cohen and Herniou (PAMI 14, 1992) for the prism. With
// q = x^2 + y^2:
//
//   g  = (1 + k_1 q + k_2 q^2 + ...) / (1 + d_1 q + d_2 q^2 + ...)
//   x' = x g + 2 p_1 x y + p_2 (q + 2 x^2) + s_1 q + s_2 q^2
//   y' = y g + p_1 (q + 2 y^2) + 2 p_2 x y + s_3 q + s_4 q^2
//
// Defined out to where the image folds over: the radius r g ceases to grow, or the map's Jacobian
// becomes singular.
#pragma once

#include <array>
#include <numbers>

#include "calib/base/invert_map.h"
#include "models/start/central_model.h"
#include "models/start/lens_part.h"

namespace plenocal {

/// Places of the coefficients among the parameters; those that there are not are `kNone`.
template <size_t K, size_t D>
struct DistortionPlaces {
  static constexpr size_t kNone = static_cast<size_t>(-1);
  std::array<size_t, K> k{};
  std::array<size_t, D> d{};
  std::array<size_t, 2> p{kNone, kNone};
  std::array<size_t, 4> s{kNone, kNone, kNone, kNone};
};

template <DistortionPlaces kPlaces>
class Distortion {
 public:
  /// False outside the domain.
  template <typename T>
  static bool Map(const T* a, const T* m, T* mapped) {
    if (!Distortion(a).Images(ValueOf(m[0]), ValueOf(m[1]))) return false;
    const T &x = m[0], &y = m[1];
    const T q = x * x + y * y;
    T g = Polynomial(a, kPlaces.k, q);
    if constexpr (kD > 0) g = g / Polynomial(a, kPlaces.d, q);
    mapped[0] = x * g;
    mapped[1] = y * g;
    if constexpr (Has(kPlaces.p[0])) {
      const T &p_1 = a[kPlaces.p[0]], &p_2 = a[kPlaces.p[1]];
      mapped[0] = mapped[0] + 2.0 * p_1 * x * y + p_2 * (q + 2.0 * x * x);
      mapped[1] = mapped[1] + p_1 * (q + 2.0 * y * y) + 2.0 * p_2 * x * y;
    }
    if constexpr (Has(kPlaces.s[1])) {
      mapped[0] = mapped[0] + q * (a[kPlaces.s[0]] + q * a[kPlaces.s[1]]);
      mapped[1] = mapped[1] + q * (a[kPlaces.s[2]] + q * a[kPlaces.s[3]]);
    } else if constexpr (Has(kPlaces.s[0])) {
      mapped[0] += q * a[kPlaces.s[0]];
      mapped[1] += q * a[kPlaces.s[2]];
    }
    return true;
  }

  static std::optional<Eigen::Vector2d> Unmap(const double* a, const Eigen::Vector2d& mapped) {
    const Distortion distortion(a);
    Eigen::Vector2d place = mapped;
    constexpr int kMaxIterations = 100;
    constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding
    for (int i = 0; i < kMaxIterations && !distortion.Images(place.x(), place.y()); ++i) {
      place *= 0.9;
    }
    const auto map =
        [&](const Eigen::Vector2d& at, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
          *slope = distortion.Jacobian(at.x(), at.y());
          return Map(a, at.data(), image->data());
        };
    return InvertMap(map, mapped, place, kLastStep * (1 + mapped.norm()));
  }

 private:
  static constexpr size_t kK = kPlaces.k.size(), kD = kPlaces.d.size();
  static constexpr bool Has(size_t place) { return place != decltype(kPlaces)::kNone; }
  static constexpr bool IsRadial() { return !Has(kPlaces.p[0]) && !Has(kPlaces.s[0]); }

  // 1 + c_1 q + c_2 q^2 + ...
  template <typename T, size_t n>
  static T Polynomial(const T* a, const std::array<size_t, n>& places, const T& q) {
    if constexpr (n == 0) {
      return T(1.0);
    } else {
      T value = a[places[n - 1]];
      for (size_t i = n - 1; i-- > 0;) value = a[places[i]] + q * value;
      return 1.0 + q * value;
    }
  }

  template <typename T>
  explicit Distortion(const T* a) {
    const auto value = [&](size_t place) { return Has(place) ? ValueOf(a[place]) : 0.0; };
    P_[0] = Q_[0] = 1;
    for (size_t i = 0; i < kK; ++i) P_[i + 1] = value(kPlaces.k[i]);
    for (size_t i = 0; i < kD; ++i) Q_[i + 1] = value(kPlaces.d[i]);
    for (size_t i = 0; i < 2; ++i) p_[i] = value(kPlaces.p[i]);
    for (size_t i = 0; i < 4; ++i) s_[i] = value(kPlaces.s[i]);
    // (r P / Q)' Q^2 = P Q + 2 q (P' Q - P Q'); the term P_i Q_j q^(i + j) of P Q has
    // i P_i Q_j q^(i + j) and j P_i Q_j q^(i + j) in q P' Q and q P Q'.
    for (size_t i = 0; i <= kK; ++i) {
      for (size_t j = 0; j <= kD; ++j) {
        slope_[i + j] +=
            P_[i] * Q_[j] * (1 + 2 * (static_cast<double>(i) - static_cast<double>(j)));
      }
    }
  }

  // Whether the image has not folded over between the axis and (x, y).
  [[nodiscard]] bool Images(double x, double y) const {
    const double q = x * x + y * y;
    if constexpr (kD > 0) {
      if (!PositiveOn(Q_, q)) return false;
    }
    if (!PositiveOn(slope_, q)) return false;
    if constexpr (IsRadial()) return true;
    return Jacobian(x, y).determinant() > 0;
  }

  [[nodiscard]] Eigen::Matrix2d Jacobian(double x, double y) const {
    const double q = x * x + y * y;
    const double Q = Value(Q_, q);
    const double g = Value(P_, q) / Q, g_q = (Slope(P_, q) - g * Slope(Q_, q)) / Q;
    const double p_1 = p_[0], p_2 = p_[1];
    const double prism_x = 2 * (s_[0] + 2 * q * s_[1]), prism_y = 2 * (s_[2] + 2 * q * s_[3]);
    const double mixed = 2 * x * y * g_q + 2 * p_1 * x + 2 * p_2 * y;
    Eigen::Matrix2d J;
    J << g + 2 * x * x * g_q + 2 * p_1 * y + 6 * p_2 * x + x * prism_x, mixed + y * prism_x,
        mixed + x * prism_y, g + 2 * y * y * g_q + 6 * p_1 * y + 2 * p_2 * x + y * prism_y;
    return J;
  }

  template <size_t n>
  static double Value(const std::array<double, n>& c, double q) {
    double value = 0;
    for (size_t i = n; i-- > 0;) value = value * q + c[i];
    return value;
  }
  template <size_t n>
  static double Slope(const std::array<double, n>& c, double q) {
    double slope = 0;
    for (size_t i = n; i-- > 1;) slope = slope * q + static_cast<double>(i) * c[i];
    return slope;
  }

  std::array<double, kK + 1> P_{};
  std::array<double, kD + 1> Q_{};
  std::array<double, kK + kD + 1> slope_{};
  std::array<double, 2> p_{};
  std::array<double, 4> s_{};
};

/// The prism of a part: s_1 .. s_4, or of a thin one those by q alone, s_1 s_3.
enum class PrismTerms { kNone, kThin, kWhole };

/// A part with K radial terms, then p_1 p_2, then the prism.
template <size_t K, bool kTangential, PrismTerms kPrism>
struct DistortionPart {
  static constexpr size_t kPrismCount =
      kPrism == PrismTerms::kNone ? 0 : (kPrism == PrismTerms::kThin ? 2 : 4);
  static constexpr size_t kCount = K + (kTangential ? 2 : 0) + kPrismCount;
  static constexpr DistortionPlaces<K, 0> kPlaces = [] {
    DistortionPlaces<K, 0> places;
    size_t next = 0;
    for (size_t& place : places.k) place = next++;
    if constexpr (kTangential) places.p = {next, next + 1};
    next = kCount - kPrismCount;
    if constexpr (kPrism == PrismTerms::kThin) {
      places.s[0] = next;
      places.s[2] = next + 1;
    } else if constexpr (kPrism == PrismTerms::kWhole) {
      for (size_t& place : places.s) place = next++;
    }
    return places;
  }();
  static constexpr std::string_view kSource = "Brown 1966; Weng et al., PAMI 1992";
  static constexpr auto kParams = [] {
    constexpr std::array<std::string_view, 6> kRadial{"k_1", "k_2", "k_3", "k_4", "k_5", "k_6"};
    constexpr std::array<std::string_view, 4> kPrisms{"s_1", "s_2", "s_3", "s_4"};
    std::array<Param, kCount> params{};
    // Scales: what changes a radius of pi / 2 by as much as itself, as of `kannala-brandt4`.
    double scale = 1;
    for (size_t i = 0; i < K; ++i) {
      scale /= std::numbers::pi * std::numbers::pi / 4;
      params[i] = Coefficient(kRadial[i], scale);
    }
    if constexpr (kTangential) {
      params[K] = Coefficient("p_1");
      params[K + 1] = Coefficient("p_2");
    }
    for (size_t i = 0; i < 4; ++i) {
      if (kPlaces.s[i] < kCount) params[kPlaces.s[i]] = Coefficient(kPrisms[i]);
    }
    return params;
  }();
  static constexpr auto kExample = [] {
    constexpr std::array kRadial{-0.01, -5e-4, -2e-5, -1e-6, -5e-8, -2e-9};
    constexpr std::array kOthers{0.0008, -0.0005, 0.0007, -0.0003, -0.0006, 0.0002};
    std::array<double, kCount> example{};
    std::copy_n(kRadial.begin(), K, example.begin());
    std::copy_n(kOthers.begin() + (kTangential ? 0 : 2), kCount - K, example.begin() + K);
    return example;
  }();

  template <typename T>
  static bool Map(const T* a, const T* m, T* mapped) {
    return Distortion<kPlaces>::Map(a, m, mapped);
  }
  static std::optional<Eigen::Vector2d> Unmap(const double* a, const Eigen::Vector2d& mapped) {
    return Distortion<kPlaces>::Unmap(a, mapped);
  }
};

}  // namespace plenocal
