// SPDX-License-Identifier: Apache-2.0
//
// Inverse of a map of the line or the plane at one point.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <optional>

namespace plenocal {

/// The place whose image under `map` is `image`: Newton's method from `place`, each step halved
/// until it comes nearer, up to and with the first step that is no longer than `last_step`. Nothing
/// where no part of a step comes nearer. `map(place, &image, &slope)` is false outside its domain;
/// the slope, the derivatives of the image, need not be exact.
template <int N = 2, typename Map>
std::optional<Eigen::Vector<double, N>> InvertMap(const Map& map,
                                                  const Eigen::Vector<double, N>& image,
                                                  Eigen::Vector<double, N> place,
                                                  double last_step) {
  using Place = Eigen::Vector<double, N>;
  constexpr int kSteps = 100;
  constexpr double kLeastPart = 1e-6;
  Place now, next;
  Eigen::Matrix<double, N, N> slope, next_slope;
  if (!map(place, &now, &slope)) return std::nullopt;
  for (int i = 0; i < kSteps; ++i) {
    const Place off = image - now, step = slope.inverse() * off;
    if (step.norm() <= last_step) return place + step;
    double part = 1;
    while (!map(place + part * step, &next, &next_slope) || !((image - next).norm() < off.norm())) {
      part /= 2;
      if (part < kLeastPart) return std::nullopt;
    }
    place += part * step;
    now = next;
    slope = next_slope;
  }
  return std::nullopt;
}

}  // namespace plenocal
