// SPDX-License-Identifier: Apache-2.0
//
// Pairing of several cameras' images by their times.
#pragma once

#include <algorithm>
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

/// Index of the first camera that has an image of an instant.
size_t FirstCamera(const std::vector<std::optional<size_t>>& images);

/// True when all images have a time.
template <typename Images>
bool HaveTimes(const Images& images) {
  return std::ranges::all_of(images, [](const auto& image) { return image.time.has_value(); });
}
/// The times of images that all have one.
template <typename Images>
std::vector<double> TimesOf(const Images& images) {
  std::vector<double> times;
  for (const auto& image : images) times.push_back(*image.time);
  return times;
}

/// Median of the intervals between successive values; 0 of fewer than two values.
double UsualInterval(const std::vector<double>& values);

}  // namespace plenocal
