// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with radial, tangential and thin-prism distortion: the first N = 4, 5, 8 or 12
// coefficients of OpenCV, in its order k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6 s_1 s_2 s_3 s_4.
//
// Source: models/start/plane_distortion.h, with k_4 to k_6 in the denominator,
// x = x_C / z_C, y = y_C / z_C and
//
//   x_Id = f_x x' + c_x, y_Id = f_y y' + c_y                         (pixels)
//
// Defined for z_C > 0 out to where the distortion folds over.
#pragma once

#include "models/start/central_model.h"
#include "models/start/plane_distortion.h"

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
    const T place[2] = {p.x() / p.z(), p.y() / p.z()};
    return Distortion<kPlaces>::Map(k, place, m);
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const std::optional<Eigen::Vector2d> place = Distortion<kPlaces>::Unmap(k, m);
    if (!place) return std::nullopt;
    return place->homogeneous();
  }

 private:
  static constexpr auto kPlaces = [] {
    constexpr size_t kRadial = N >= 5 ? 3 : 2, kDenominator = N >= 8 ? 3 : 0;
    DistortionPlaces<kRadial, kDenominator> places;
    places.k[0] = 0;
    places.k[1] = 1;
    if constexpr (N >= 5) places.k[2] = 4;
    if constexpr (N >= 8) places.d = {5, 6, 7};
    places.p = {2, 3};
    if constexpr (N >= 12) places.s = {8, 9, 10, 11};
    return places;
  }();
};

}  // namespace plenocal
