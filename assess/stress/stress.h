// SPDX-License-Identifier: Apache-2.0
//
// Stress tests of a finished calibration: calibrations from parts of its points, which must agree
// with the other parts.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/estimate/calibrate.h"

namespace plenocal {

enum class StressKind { kChance, kTime, kDistance, kRegion };

/// What one split of the points shows of a camera.
struct StressTest {
  std::string camera;
  StressKind kind = StressKind::kChance;
  /// "odd/even", "first/second", "near/far", "left/right": halves, each predicted by the other.
  /// "outside", "upper left", ...: a region of the image, left out.
  std::string split;
  std::string failure = {};  ///< why there is no result
  size_t points = 0;    ///< that were predicted by a calibration without them
  double factor = 0;    ///< RMS of their residuals over that of points in the calibration
  /// Of a region: mean of (residual / predicted standard deviation)^2; 0: of halves.
  double square = 0;
  /// Of halves: difference of both projections over the supported image after the best motion, what
  /// both covariances predict for it, px RMS, and its part of the sum of both standard errors.
  double difference = 0, predicted = 0, ratio = 0;
  /// Of so large a disagreement by errors alone, corrected for the number of tests (Holm 1979).
  double probability = 1, raw = 1;

  [[nodiscard]] bool Fails() const;
};

struct StressOptions {
  Loss loss = Loss::kHuber;
  int threads = 0;  ///< 0: all cores
  /// Called now and then; false stops (`Stopped` is thrown).
  std::function<bool()> go_on;
};

struct StressTests {
  std::string failure = {};  ///< why there are none
  std::vector<StressTest> tests;
};

/// Calibrates again from halves and without regions, from the optimum of all points.
/// Cameras that are not in `cameras` keep all points in tests of image regions.
StressTests TestStress(const Calibration& calibration,
                       std::span<const size_t> cameras,
                       const StressOptions& options);

/// What the tests of a camera that fail say, one sentence a camera; empty where none does.
std::vector<std::string> StressReading(const StressTests& stress);

}  // namespace plenocal
