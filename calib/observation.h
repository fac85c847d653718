// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

namespace plenocal {

/// Most numbers that one observation of any camera model has.
inline constexpr int kMaxObservationSize = 4;

/// One marker seen once. What `values` mean is the camera model's affair
/// (`CameraModel::measured`, then `CameraModel::context`); ordinary cameras have x, y, the focused
/// plenoptic camera x, y, lens_x, lens_y. Image coordinates are in pixels with (0, 0) at the centre
/// of the top-left pixel.
struct Observation {
  int marker = 0;
  std::array<double, kMaxObservationSize> values{};
  /// Standard deviation of each measured coordinate; 0 when the source of the observation gives
  /// none.
  double sigma = 0;
  /// Which of the camera's kinds of observations it is (`CameraModel::kind_name`): those of one
  /// kind are alike in noise.
  int kind = 0;
};

/// All observations of one camera in one frame.
struct View {
  std::string frame;  ///< the frame's name (FORMATS.md, "Conventions")
  std::vector<Observation> observations;
  /// What errors that all of the camera's observations share move them by: per observation, or
  /// empty, measured coordinates x errors, px for one sigma, row-major. The errors are independent,
  /// and the same ones in all views of the camera (a correction that is itself uncertain).
  std::vector<std::vector<double>> shared_errors = {};
};

/// Width and height in pixels.
using ImageSize = std::array<int, 2>;

/// An image or marker that was left out, in words for the user.
struct LeftOut {
  std::string where;   ///< file or "camera frame marker"
  std::string reason;  ///< what is wrong and, where it helps, what to do
};

}  // namespace plenocal
