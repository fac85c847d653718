// SPDX-License-Identifier: Apache-2.0
//
// Observations of markers: the input of a calibration from images.
#pragma once

#include <array>
#include <string>
#include <vector>

namespace plenocal {

/// Most numbers that one observation of any camera model has.
inline constexpr int kMaxObservationSize = 7;

/// One marker measured once. The camera model defines what `values` hold (`CameraModel::measured`,
/// then `CameraModel::context` and `optional_context`): x, y for ordinary cameras; x, y, lens_x,
/// lens_y, depth, x_depth, y_depth for the focused plenoptic camera. Image coordinates are in
/// pixels with (0, 0) at the centre of the top-left pixel.
struct Observation {
  int marker = 0;
  std::array<double, kMaxObservationSize> values{};
  /// Standard deviation of each measured coordinate, px, as stated by the detector; 0 when it
  /// states none.
  double detector_sigma = 0;
  /// Type of the micro lens through which the marker was seen: observations of one type have the
  /// same noise. 0 for ordinary cameras.
  int lens_type = 0;
};

/// All observations of one camera in one frame.
struct View {
  std::string frame;  ///< the frame's name (docs/conventions.md)
  std::vector<Observation> observations;
  /// Derivatives of the measured coordinates by the camera's nuisance parameters: the sizes of
  /// systematic displacements that all of its views share, which the bundle adjustment estimates
  /// with standard normal priors. Per observation, or empty; measured coordinates x parameters, px
  /// for one standard deviation of the prior, row-major.
  std::vector<std::vector<double>> by_nuisance = {};
};

/// Width and height in pixels.
using ImageSize = std::array<int, 2>;

/// An image or marker that was left out, in words for the user.
struct LeftOut {
  std::string where;        ///< file or "camera frame marker"
  std::string reason;       ///< what is wrong and, where it helps, what to do
  bool whole = false;       ///< the whole image or frame, not markers in it
  std::string camera = {};  ///< names, where they are known
  std::string frame = {};   ///< likewise
  std::string marker = {};  ///< number; empty: the whole image, or `reason` names it
};

}  // namespace plenocal
