// SPDX-License-Identifier: Apache-2.0
#include "detectors/focused_markers.h"

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>

namespace plenocal::internal {

double ScaleTo8Bits(const cv::Mat& image) {
  std::vector<float> values(image.begin<float>(), image.end<float>());
  const auto high =
      values.begin() + static_cast<std::ptrdiff_t>(values.size() - 1 - values.size() / 1000);
  std::nth_element(values.begin(), high, values.end());
  return *high > 0 ? 255 / *high : 1;
}

FocusedMarkers::FocusedMarkers(const Target& target)
    : target_(target), detector_(MakeMarkerDetector(target)) {}

MarkerDetections FocusedMarkers::Detect(const cv::Mat& focused) const {
  cv::Mat grey;
  focused.convertTo(grey, CV_8U, ScaleTo8Bits(focused));
  return detector_->Detect(grey);
}

std::vector<FlatPart> FocusedMarkers::FlatParts(const cv::Mat& focused) const {
  // A number for each part: four corners a tag, else the whole board.
  const bool tags = std::holds_alternative<TagLayout>(target_.layout);
  std::map<int, std::vector<cv::Point2f>> points;
  for (const Observation& marker : Detect(focused).markers) {
    points[tags ? marker.marker / 4 : 0].emplace_back(static_cast<float>(marker.values[0]),
                                                      static_cast<float>(marker.values[1]));
  }
  std::vector<FlatPart> parts;
  for (const auto& [number, corners] : points) {
    if (corners.size() < 3) continue;
    FlatPart hull;
    cv::convexHull(corners, hull);
    parts.push_back(hull);
  }
  return parts;
}

}  // namespace plenocal::internal
