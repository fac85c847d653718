// SPDX-License-Identifier: Apache-2.0
//
// Parts of a lens that distort the plane by polynomials: radial, tangential, thin prism.
//
// Source: Brown, Decentering distortion of lenses (Photogrammetric Engineering 32, 1966); Weng,
// Cohen and Herniou (PAMI 14, 1992) for the prism. With q = x^2 + y^2:
//
//   g  = 1 + k_1 q + k_2 q^2 + ...
//   x' = x g + 2 p_1 x y + p_2 (q + 2 x^2) + s_1 q + s_2 q^2
//   y' = y g + p_1 (q + 2 y^2) + 2 p_2 x y + s_3 q + s_4 q^2
//
// Defined out to where the image folds over: the radius r g ceases to grow, or the map's Jacobian
// becomes singular.
#pragma once

#include <numbers>

#include "calib/base/invert_map.h"
#include "models/start/central_model.h"
#include "models/start/lens_part.h"

namespace plenocal {

/// Which terms a part has: K radial ones, then p_1 p_2, then s_1 .. s_4, or of a thin prism those
/// by q alone, s_1 s_3.
enum class PrismTerms { kNone, kThin, kWhole };

template <size_t K, bool kTangential, PrismTerms kPrism>
struct PlaneDistortion {
  static constexpr size_t kPrismCount =
      kPrism == PrismTerms::kNone ? 0 : (kPrism == PrismTerms::kThin ? 2 : 4);
  static constexpr size_t kCount = K + (kTangential ? 2 : 0) + kPrismCount;
  static constexpr std::string_view kSource = "Brown 1966; Weng et al., PAMI 1992";
  static constexpr auto kParams = [] {
    constexpr std::array<std::string_view, 6> kRadial{"k_1", "k_2", "k_3", "k_4", "k_5", "k_6"};
    constexpr std::array<std::string_view, 4> kPrisms{"s_1", "s_2", "s_3", "s_4"};
    std::array<Param, kCount> params{};
    size_t i = 0;
    // Scales: what changes a radius of pi / 2 by as much as itself, as of `kannala-brandt4`.
    constexpr double kSquare = std::numbers::pi * std::numbers::pi / 4;
    for (size_t k = 0; k < K; ++k) {
      params[i] = Coefficient(kRadial[k]);
      params[i].scale = (k == 0 ? 1 : params[i - 1].scale) / kSquare;
      ++i;
    }
    if constexpr (kTangential) {
      params[i++] = Coefficient("p_1");
      params[i++] = Coefficient("p_2");
    }
    for (size_t k = 0; k < kPrismCount; ++k) {
      params[i++] = Coefficient(kPrisms[kPrism == PrismTerms::kThin ? 2 * k : k]);
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
    std::array<double, kCount> value;
    for (size_t i = 0; i < kCount; ++i) value[i] = ValueOf(a[i]);
    if (!Images(value.data(), ValueOf(m[0]), ValueOf(m[1]))) return false;
    Distort(a, m, mapped);
    return true;
  }

  static std::optional<Eigen::Vector2d> Unmap(const double* a, const Eigen::Vector2d& mapped) {
    Eigen::Vector2d place = mapped;
    constexpr int kMaxIterations = 100;
    constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding
    for (int i = 0; i < kMaxIterations && !Images(a, place.x(), place.y()); ++i) place *= 0.9;
    const auto map =
        [&](const Eigen::Vector2d& at, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
          *slope = Jacobian(a, at.x(), at.y());
          return Map(a, at.data(), image->data());
        };
    return InvertMap(map, mapped, place, kLastStep * (1 + mapped.norm()));
  }

 private:
  template <typename T>
  static void Distort(const T* a, const T* m, T* mapped) {
    const T &x = m[0], &y = m[1];
    const T q = x * x + y * y;
    T g = T(0.0);
    for (size_t i = K; i-- > 0;) g = q * (a[i] + g);
    mapped[0] = x * (1.0 + g);
    mapped[1] = y * (1.0 + g);
    if constexpr (kTangential) {
      const T &p_1 = a[K], &p_2 = a[K + 1];
      mapped[0] += 2.0 * p_1 * x * y + p_2 * (q + 2.0 * x * x);
      mapped[1] += p_1 * (q + 2.0 * y * y) + 2.0 * p_2 * x * y;
    }
    const T* const s = a + kCount - kPrismCount;
    if constexpr (kPrism == PrismTerms::kThin) {
      mapped[0] += s[0] * q;
      mapped[1] += s[1] * q;
    } else if constexpr (kPrism == PrismTerms::kWhole) {
      mapped[0] += q * (s[0] + q * s[1]);
      mapped[1] += q * (s[2] + q * s[3]);
    }
  }

  static Eigen::Matrix2d Jacobian(const double* a, double x, double y) {
    const double q = x * x + y * y;
    double g = 0, g_q = 0;  // g - 1, and the derivative of g by q
    for (size_t i = K; i-- > 0;) {
      g_q = q * g_q + static_cast<double>(i + 1) * a[i];
      g = q * (a[i] + g);
    }
    const double p_1 = kTangential ? a[K] : 0, p_2 = kTangential ? a[K + 1] : 0;
    const double* const s = a + kCount - kPrismCount;
    double s_x = 0, s_y = 0;  // derivatives of the prism by q, twice
    if constexpr (kPrism == PrismTerms::kThin) {
      s_x = 2 * s[0];
      s_y = 2 * s[1];
    } else if constexpr (kPrism == PrismTerms::kWhole) {
      s_x = 2 * (s[0] + 2 * q * s[1]);
      s_y = 2 * (s[2] + 2 * q * s[3]);
    }
    const double mixed = 2 * (x * y * g_q + p_1 * x + p_2 * y);
    Eigen::Matrix2d J;
    J << 1 + g + 2 * x * x * g_q + 2 * p_1 * y + 6 * p_2 * x + x * s_x, mixed + y * s_x,
        mixed + x * s_y, 1 + g + 2 * y * y * g_q + 6 * p_1 * y + 2 * p_2 * x + y * s_y;
    return J;
  }

  // Whether the image has not folded over between the axis and (x, y).
  static bool Images(const double* a, double x, double y) {
    std::array<double, K + 1> slope{1};  // of r g, by q
    for (size_t i = 0; i < K; ++i) slope[i + 1] = static_cast<double>(2 * i + 3) * a[i];
    if (!PositiveOn(slope, x * x + y * y)) return false;
    if constexpr (kCount == K) return true;
    return Jacobian(a, x, y).determinant() > 0;
  }
};

}  // namespace plenocal
