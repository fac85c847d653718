// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace plenocal {

/// The images of several cameras that belong to one instant each.
struct TimePairs {
  /// Per instant, by time, and camera the index of its image.
  std::vector<std::vector<std::optional<size_t>>> frames;
  double tolerance = 0;  ///< s
};

/// Each camera is paired with the frames so far: an image with the frame whose time is nearest to
/// its own, if it is that frame's nearest too and not farther than the tolerance. What finds no
/// partner is a frame of its own. `times` are seconds, which increase, per camera.
///
/// Without a tolerance that of the recording: five sigmas of the scatter of the differences between
/// nearest images beyond their median, and a millisecond, in which many clocks count. Beyond half
/// of an interval an image is nearer to another frame's time.
TimePairs PairTimes(const std::vector<std::vector<double>>& times, std::optional<double> tolerance);

/// Median of the intervals between successive values; 0 of fewer than two values.
double UsualInterval(const std::vector<double>& values);

}  // namespace plenocal
