// SPDX-License-Identifier: Apache-2.0
//
// What a part of a lens is: a map of the plane at distance 1, after the lens and before the focal
// length. "ucm+radtan+tilt" is the lens `ucm` with two parts, which act in this order.
//
// A part is a header in models/parts/ with a struct P, named like the file in CamelCase, of
//   static constexpr std::string_view kName, kSource;
//   static constexpr std::array<Param, n> kParams;   each with a neutral value
//   static constexpr std::array<double, n> kExample;
//   template <typename T> static bool Map(const T* a, const T* m, T* mapped);
//   static std::optional<Eigen::Vector2d> Unmap(const double* a, const Eigen::Vector2d& mapped);
// `Map` is false outside the domain. In place of both, a part that moves the rays' origins along
// the optical axis has (models/start/axis_point.h)
//   static constexpr double kLargestAngle;   rad from the axis, where it ends
//   template <typename T> static T RayOffset(const T* a, const T& theta);
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string_view>

#include "calib/camera/camera_model.h"

namespace plenocal {

inline constexpr size_t kMostPartParams = 8;

/// The table of a part: data and functions.
struct LensPart {
  std::string_view name;    ///< as in "lens+name"
  std::string_view source;  ///< publication and equations
  std::span<const Param> params;
  std::span<const double> example;
  bool (*map)(const double* a, const double* m, double* mapped) = nullptr;
  /// `map` with derivatives by m_x, m_y and the parameters: 2 x (2 + n), by rows.
  bool (*map_with_jacobian)(const double* a, const double* m, double* mapped, double* J) = nullptr;
  std::optional<Eigen::Vector2d> (*unmap)(const double* a, const Eigen::Vector2d& mapped) = nullptr;
  /// Of a part that moves the rays along the axis, which has no `map`: the distance z_p sin(theta)
  /// of the ray at the angle theta from the frame's origin, m, with derivatives by theta and the
  /// parameters.
  double (*ray_offset)(const double* a, double theta, double* by_theta, double* by_a) = nullptr;
  double largest_angle = 0;  ///< of `ray_offset`, rad
};

namespace internal {

// Inlined as a whole, as derivatives of lenses.
template <typename P>
[[gnu::flatten, gnu::noinline]] bool DifferentiatePart(const double* a,
                                                       const double* m,
                                                       double* mapped,
                                                       double* J) {
  constexpr int n = static_cast<int>(P::kParams.size());
  using Jet = ceres::Jet<double, n + 2>;
  std::array<Jet, n> a_jet;
  for (int i = 0; i < n; ++i) a_jet[static_cast<size_t>(i)] = Jet(a[i], 2 + i);
  const Jet m_jet[2] = {Jet(m[0], 0), Jet(m[1], 1)};
  Jet out[2];
  if (!P::Map(a_jet.data(), m_jet, out)) return false;
  for (int r = 0; r < 2; ++r) {
    mapped[r] = out[r].a;
    for (int i = 0; i < n + 2; ++i) J[r * (n + 2) + i] = out[r].v[i];
  }
  return true;
}

template <typename P>
double DifferentiateOffset(const double* a, double theta, double* by_theta, double* by_a) {
  constexpr int n = static_cast<int>(P::kParams.size());
  using Jet = ceres::Jet<double, n + 1>;
  std::array<Jet, n> a_jet;
  for (int i = 0; i < n; ++i) a_jet[static_cast<size_t>(i)] = Jet(a[i], 1 + i);
  const Jet offset = P::RayOffset(a_jet.data(), Jet(theta, 0));
  *by_theta = offset.v[0];
  for (int i = 0; i < n; ++i) by_a[i] = offset.v[1 + i];
  return offset.a;
}

}  // namespace internal

template <typename P>
constexpr LensPart MakeLensPart() {
  static_assert(P::kParams.size() <= kMostPartParams && P::kParams.size() == P::kExample.size());
  LensPart part{
      .name = P::kName, .source = P::kSource, .params = P::kParams, .example = P::kExample};
  if constexpr (requires { P::kLargestAngle; }) {
    part.ray_offset = &internal::DifferentiateOffset<P>;
    part.largest_angle = P::kLargestAngle;
  } else {
    part.map = [](const double* a, const double* m, double* mapped) {
      return P::Map(a, m, mapped);
    };
    part.map_with_jacobian = &internal::DifferentiatePart<P>;
    part.unmap = [](const double* a, const Eigen::Vector2d& mapped) { return P::Unmap(a, mapped); };
  }
  return part;
}

}  // namespace plenocal
