// SPDX-License-Identifier: Apache-2.0
//
// Detection of the target in totally focused images.
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/plenoptic/depth/depth_planes.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal::internal {

/// Finds the markers of the target and its flat parts.
class FocusedImageDetector {
 public:
  explicit FocusedImageDetector(const Target& target);

  /// `focused`: CV_32F; positions in its pixels. Those in the image or, where these are few, in
  /// the sharpened image if that has more.
  [[nodiscard]] MarkerDetections Detect(const cv::Mat& focused) const;
  /// Templates of markers that were found in it.
  [[nodiscard]] std::vector<MarkerTemplate> Templates(const cv::Mat& focused,
                                                      const std::vector<Observation>& found) const;
  /// The convex hulls of the flat parts, px of the focused image: each tag, or the whole of another
  /// target.
  [[nodiscard]] std::vector<FlatPart> FlatParts(const cv::Mat& focused) const;

 private:
  const Target& target_;
  std::unique_ptr<MarkerDetector> detector_;
};

}  // namespace plenocal::internal
