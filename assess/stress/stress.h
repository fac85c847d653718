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

/// What a test shows that fails.
enum class StressKind { kNoise, kTime, kDistance, kRegion };

std::string_view StressKindName(StressKind kind);

/// One test of one camera.
struct StressTest {
  std::string camera;
  StressKind kind = StressKind::kNoise;
  /// "odd/even", "first/second", "near/far": halves of the frames. "border", "upper left", ...: a
  /// region of the image, left out.
  std::string what;
  std::string failure = {};  ///< why there is no result
  /// Of halves: difference of both projections over the supported image after the best motion. Of
  /// a region: error with which the other points predict its points, noise included. px RMS.
  double difference = 0;
  double predicted = 0;  ///< the same by the covariances
  /// RMS residual of points that a calibration did not have over that of points that it had.
  double factor = 0;
  /// Of so large a disagreement by errors alone, corrected for the number of tests (Holm 1979).
  double probability = 1;

  [[nodiscard]] bool Fails() const;
};

struct StressOptions {
  Loss loss = Loss::kHuber;
  int threads = 0;  ///< 0: all cores
  /// Called now and then from any thread; false stops (`Stopped` is thrown).
  std::function<bool()> go_on;
};

/// Calibrates again from halves of the frames and without regions of the image, from the optimum of
/// all points. Of cameras that are not in `cameras` no region is left out. The tests of a session
/// that lacks nothing fail in 5 % of sessions.
std::vector<StressTest> TestStress(const Calibration& calibration,
                                   std::span<const size_t> cameras,
                                   const StressOptions& options);

/// "left: only near and far frames differ: ...", a line for each kind of tests that fails of a
/// camera.
std::string StressReading(const std::vector<StressTest>& tests);

}  // namespace plenocal
