// SPDX-License-Identifier: Apache-2.0
#include "detectors/sample_picture.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "detectors/depth_picture.h"
#include "detectors/marker_picture.h"

namespace plenocal::internal {
namespace {

// How much smaller an image becomes.
double Shrinking(const cv::Mat& image) {
  constexpr double kLonger = 1000;
  return std::min(1.0, kLonger / std::max(image.cols, image.rows));
}

std::string Jpeg(const cv::Mat& picture) {
  constexpr int kQuality = 85;
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return {bytes.begin(), bytes.end()};
}

}  // namespace

std::string SamplePicture(const cv::Mat& gray, std::vector<Observation> markers) {
  const double scale = Shrinking(gray);
  cv::Mat small;
  cv::resize(gray, small, {}, scale, scale, cv::INTER_AREA);
  for (Observation& marker : markers) {
    // (0, 0) is the centre of a pixel, of whatever size.
    for (const size_t i : {0, 1}) marker.values[i] = (marker.values[i] + 0.5) * scale - 0.5;
  }
  return Jpeg(MarkerPicture(small, markers));
}

std::string SampleDepthPicture(const VirtualDepth& depth) {
  const double scale = Shrinking(depth.inverse);
  VirtualDepth small;
  cv::resize(depth.inverse, small.inverse, {}, scale, scale, cv::INTER_NEAREST);
  cv::resize(depth.known, small.known, {}, scale, scale, cv::INTER_NEAREST);
  return Jpeg(DepthPicture(small));
}

}  // namespace plenocal::internal
