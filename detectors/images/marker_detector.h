// SPDX-License-Identifier: Apache-2.0
//
// Interface of the detectors of markers in gray images.
#pragma once

#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "detectors/images/distortion_field.h"

namespace plenocal {

/// The markers of one target in one image.
struct MarkerDetections {
  std::vector<Observation> markers;   ///< x, y, sigma set; ascending marker number, no duplicates
  std::vector<std::string> left_out;  ///< markers refused, with the reason, in words for the user
  std::string failure;                ///< why `markers` is empty; empty otherwise
  /// Measurements of the lens distortion by this image.
  std::vector<DistortionMeasurement> measurements;
  /// Dependence of the markers on the distortion assumed, in their order; empty when they do not
  /// depend on it.
  std::vector<DistortionSensitivity> sensitivities;
  /// Layout of a board that has several (`CharucoLayout::legacy`), in words; empty for one with
  /// one.
  std::string layout;
  /// Neighbours that agree by `layout` less those that agree by another; 0: undecided.
  int layout_evidence = 0;
  /// The markers by each layout, where the image fits both, with that message as `failure`: all
  /// images of the camera together decide.
  std::vector<MarkerDetections> by_layout;
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

/// Makes detectors of one target; called from several threads.
using MarkerDetectorFactory = std::function<std::unique_ptr<MarkerDetector>()>;

}  // namespace plenocal
