// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/focused_image_detector.h"

#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/types/marker_detectors.h"

namespace plenocal::internal {
namespace {

cv::Mat Grey(const cv::Mat& focused) {
  cv::Mat grey;
  focused.convertTo(grey, CV_8U, ScaleTo8Bits(focused));
  return grey;
}

/// An unsharp mask. A raw pixel covers v / 2 pixels of the focused image, which blurs the bits of
/// small tags until their decoder fails.
cv::Mat Sharpened(const cv::Mat& grey) {
  constexpr double kBlur = 2, kGain = 1.5;  // px; of the difference
  cv::Mat smooth, sharp;
  cv::GaussianBlur(grey, smooth, {}, kBlur);
  cv::addWeighted(grey, 1 + kGain, smooth, -kGain, 0, sharp);
  return sharp;
}

}  // namespace

FocusedImageDetector::FocusedImageDetector(const Target& target)
    : target_(target), detector_(MakeMarkerDetector(target)) {}

MarkerDetections FocusedImageDetector::Detect(const cv::Mat& focused) const {
  const cv::Mat grey = Grey(focused);
  MarkerDetections found = detector_->Detect(grey);
  constexpr std::size_t kFew = 4;  // a quarter of the target: its tags may be too blurred
  if (kFew * found.markers.size() > target_.markers.size()) return found;
  MarkerDetections sharper = detector_->Detect(Sharpened(grey));
  return sharper.markers.size() > found.markers.size() ? std::move(sharper) : std::move(found);
}

std::vector<MarkerTemplate> FocusedImageDetector::Templates(
    const cv::Mat& focused, const std::vector<Observation>& found) const {
  return MakeMarkerTemplates(target_, found, Grey(focused));
}

std::vector<FlatPart> FocusedImageDetector::FlatParts(const cv::Mat& focused) const {
  std::map<int, std::vector<cv::Point2f>> points;  // by part
  for (const Observation& marker : Detect(focused).markers) {
    points[PartOf(target_, marker.marker)].emplace_back(static_cast<float>(marker.values[0]),
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
