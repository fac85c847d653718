// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "calib/observation.h"
#include "detectors/lens_curvature.h"
#include "targets/target.h"

namespace plenocal {

/// What a detector found in one image.
struct MarkerDetections {
  std::vector<Observation> markers;   ///< x, y, sigma set; ascending marker number, no duplicates
  std::vector<std::string> left_out;  ///< markers refused, with the reason, in words for the user
  std::string failure;                ///< why `markers` is empty; empty otherwise
  std::vector<LensReading> readings;  ///< what the image says about the lens' curvature
  /// What the markers owe to it, in their order; empty when they do not depend on it.
  std::vector<BentMarker> bent;
};

/// Finds the markers of one target in gray images. One object may be used from one thread at a
/// time; images run in parallel with one detector a thread.
class MarkerDetector {
 public:
  virtual ~MarkerDetector() = default;
  /// `gray`: CV_8UC1. Never throws for what the image shows; an image without the target gives
  /// `failure`. Results do not depend on earlier calls.
  virtual MarkerDetections Detect(const cv::Mat& gray) = 0;
};

std::unique_ptr<MarkerDetector> MakeTagDetector(const Target& target);
std::unique_ptr<MarkerDetector> MakeChessboardDetector(const Target& target);
std::unique_ptr<MarkerDetector> MakeCharucoDetector(const Target& target);
std::unique_ptr<MarkerDetector> MakeCirclesDetector(const Target& target);

/// The detector for the target's type. Throws `Error` for type `markers`, which has none.
std::unique_ptr<MarkerDetector> MakeMarkerDetector(const Target& target);

}  // namespace plenocal
