// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal::internal {

/// Noise of `SimulateMeasurements`, px a coordinate.
inline constexpr double kMicroNoise = 0.01;

/// Markers at many depths, each in the micro images of a hexagonal array around it, of interleaved
/// types. `offset`, position - centre, is given to `set`, which may change the observation.
template <typename Set>
std::vector<RawMeasurements> SimulateMeasurements(int types, const Set& set) {
  constexpr double kPitch = 18;
  std::mt19937 engine(7);
  std::normal_distribution<double> normal(0, kMicroNoise);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<RawMeasurements> views(10);
  for (RawMeasurements& view : views) {
    for (int marker = 0; marker < 60; ++marker) {
      const double z = 0.25 + 0.1 * uniform(engine);
      const Eigen::Vector2d q(400 + kPitch * uniform(engine), 300 + kPitch * uniform(engine));
      for (int i = -6; i <= 6; ++i) {
        for (int j = -6; j <= 6; ++j) {
          const Eigen::Vector2d c = Eigen::Vector2d(400, 300) +
                                    kPitch * Eigen::Vector2d(i + 0.5 * j, j * std::sqrt(3) / 2);
          const Eigen::Vector2d offset = (q - c) * z;
          if (offset.norm() > 0.3 * kPitch) continue;
          MarkerMeasurement o{.observation = {.marker = marker,
                                              .values = {0, 0, c.x(), c.y()},
                                              .detector_sigma = kMicroNoise},
                              .inverse_depth = z,
                              .lens_type = ((i - j) % 3 + 3) % 3 % types};
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
inline double Difference(const std::vector<RawMeasurements>& a,
                         const std::vector<RawMeasurements>& b) {
  double largest = 0;
  for (size_t v = 0; v < a.size(); ++v) {
    for (size_t i = 0; i < a[v].size(); ++i) {
      largest = std::max(largest, (a[v][i].Position() - b[v][i].Position()).cwiseAbs().maxCoeff());
    }
  }
  return largest;
}

}  // namespace plenocal::internal
