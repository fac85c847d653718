// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/pictures.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "detectors/images/image.h"

namespace plenocal {

cv::Mat Reduced(const cv::Mat& image, double scale) {
  if (!(scale < 1)) return image;
  cv::Mat reduced;
  cv::resize(image,
             reduced,
             {},
             std::max(scale, 1.0 / image.cols),
             std::max(scale, 1.0 / image.rows),
             cv::INTER_AREA);
  return reduced;
}

namespace internal {

cv::Mat MarkerPicture(const cv::Mat& gray, const std::vector<Observation>& markers) {
  // Small images are enlarged, so that the numbers can be read.
  constexpr int kWide = 1000, kMostEnlarged = 4;
  const int factor = std::clamp(kWide / std::max(1, gray.cols), 1, kMostEnlarged);
  cv::Mat picture;
  cv::resize(gray, picture, {}, factor, factor, cv::INTER_NEAREST);
  cv::cvtColor(picture, picture, cv::COLOR_GRAY2BGR);
  constexpr int kArm = 7, kFraction = 4;  // px; bits of the drawing's sub-pixels
  constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
  constexpr double kSize = 0.4;
  // A number over another could not be read.
  std::vector<cv::Rect> numbers;
  for (const Observation& marker : markers) {
    // The centre of an enlarged pixel is not that of its first copy.
    const cv::Point2d at(factor * (marker.values[0] + 0.5) - 0.5,
                         factor * (marker.values[1] + 0.5) - 0.5);
    const auto line = [&](double x, double y) {
      const auto fixed = [](const cv::Point2d& p) {
        return cv::Point(cvRound(p.x * (1 << kFraction)), cvRound(p.y * (1 << kFraction)));
      };
      cv::line(picture,
               fixed(at - cv::Point2d(x, y)),
               fixed(at + cv::Point2d(x, y)),
               {0, 255, 0},
               1,
               cv::LINE_AA,
               kFraction);
    };
    line(kArm, 0);
    line(0, kArm);
    const std::string number = std::to_string(marker.marker);
    const cv::Point corner(cvRound(at.x) + kArm / 2, cvRound(at.y) - kArm / 2);
    const cv::Size size = cv::getTextSize(number, kFont, kSize, 1, nullptr);
    const cv::Rect place(corner - cv::Point(0, size.height), size);
    const bool is_free = std::none_of(numbers.begin(), numbers.end(), [&](const cv::Rect& other) {
      return (place & other).area() > 0;
    });
    if (!is_free) continue;
    numbers.push_back(place);
    cv::putText(picture, number, corner, kFont, kSize, {0, 200, 255}, 1, cv::LINE_AA);
  }
  return picture;
}

double SampleScale(const cv::Mat& image) {
  constexpr double kLonger = 1000;  // px
  return std::min(1.0, kLonger / std::max(image.cols, image.rows));
}

std::string EncodeSample(const cv::Mat& picture) {
  constexpr int kQuality = 85;  // per cent; a report with many cameras stays below some megabytes
  return EncodeImage(".jpg", picture, kQuality);
}

std::string SamplePicture(const cv::Mat& gray, std::vector<Observation> markers) {
  const double scale = SampleScale(gray);
  const cv::Mat small = Reduced(gray, scale);
  for (Observation& marker : markers) {
    // (0, 0) is the centre of a pixel, of whatever size.
    for (const size_t i : {0, 1}) marker.values[i] = (marker.values[i] + 0.5) * scale - 0.5;
  }
  return EncodeSample(MarkerPicture(small, markers));
}

}  // namespace internal
}  // namespace plenocal
