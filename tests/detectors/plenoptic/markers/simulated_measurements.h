// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "detectors/micro_observation.h"

namespace plenocal::internal {

/// Noise of `MakeMicroViews`, px a coordinate.
inline constexpr double kMicroNoise = 0.01;

/// Markers at many depths, each in the micro images of a hexagonal array around it, of interleaved
/// types. `offset`, place - centre, is given to `set`, which may change the observation.
template <typename Set>
std::vector<MicroView> MakeMicroViews(int types, const Set& set) {
  constexpr double kPitch = 18;
  std::mt19937 engine(7);
  std::normal_distribution<double> normal(0, kMicroNoise);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<MicroView> views(10);
  for (MicroView& view : views) {
    for (int marker = 0; marker < 60; ++marker) {
      const double z = 0.25 + 0.1 * uniform(engine);
      const Eigen::Vector2d q(400 + kPitch * uniform(engine), 300 + kPitch * uniform(engine));
      for (int i = -6; i <= 6; ++i) {
        for (int j = -6; j <= 6; ++j) {
          const Eigen::Vector2d c = Eigen::Vector2d(400, 300) +
                                    kPitch * Eigen::Vector2d(i + 0.5 * j, j * std::sqrt(3) / 2);
          const Eigen::Vector2d offset = (q - c) * z;
          if (offset.norm() > 0.3 * kPitch) continue;
          MicroObservation o{
              .seen = {.marker = marker, .values = {0, 0, c.x(), c.y()}, .sigma = kMicroNoise},
              .inverse_depth = z,
              .type = ((i - j) % 3 + 3) % 3 % types};
          const Eigen::Vector2d noise(normal(engine), normal(engine));
          o.Move(c + offset + noise);
          set(offset, &o);
          view.push_back(o);
        }
      }
    }
  }
  return views;
}

/// Largest difference of two sets of measurements, px.
inline double Difference(const std::vector<MicroView>& a, const std::vector<MicroView>& b) {
  double largest = 0;
  for (size_t v = 0; v < a.size(); ++v) {
    for (size_t i = 0; i < a[v].size(); ++i) {
      largest = std::max(largest, (a[v][i].Place() - b[v][i].Place()).cwiseAbs().maxCoeff());
    }
  }
  return largest;
}

}  // namespace plenocal::internal
