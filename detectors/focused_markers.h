// SPDX-License-Identifier: Apache-2.0
//
// The target in totally focused images.
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detectors/marker_detector.h"
#include "detectors/marker_planes.h"

namespace plenocal::internal {

/// Factor that brings an image (CV_32F) to 8 bits: one in a thousand pixels may saturate.
double ScaleTo8Bits(const cv::Mat& image);

/// Finds the target's markers and its flat parts.
class FocusedMarkers {
 public:
  explicit FocusedMarkers(const Target& target);

  /// `focused`: CV_32F; places in its pixels.
  [[nodiscard]] MarkerDetections Detect(const cv::Mat& focused) const;
  /// The markers of a tag, or all of another target, as one flat part of the focused image.
  [[nodiscard]] std::vector<FlatPart> FlatParts(const cv::Mat& focused) const;

 private:
  const Target& target_;
  std::unique_ptr<MarkerDetector> detector_;
};

}  // namespace plenocal::internal
