// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/views/depth_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "detectors/images/pictures.h"

namespace plenocal::internal {
namespace {

constexpr int kBarWidth = 20, kGap = 10, kTextWidth = 70, kNumbers = 6;

}  // namespace

std::pair<float, float> UsualRange(const VirtualDepth& depth) {
  std::vector<float> values = KnownInverse(depth);
  if (values.empty()) return {0, 1};
  const auto at = [&](size_t rank) {
    const auto place = values.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(values.begin(), place, values.end());
    return *place;
  };
  const size_t outliers = values.size() / 100;
  return {at(outliers), at(values.size() - 1 - outliers)};
}

cv::Mat DepthPicture(const VirtualDepth& depth) {
  auto [low, high] = UsualRange(depth);
  if (!(high > low)) high = low + 1e-3f;

  const int rows = depth.inverse.rows, columns = depth.inverse.cols;
  cv::Mat level(rows, columns + 2 * kGap + kBarWidth + kTextWidth, CV_8U, cv::Scalar(0));
  cv::Mat shown(level.size(), CV_8U, cv::Scalar(0));
  depth.inverse.convertTo(
      level.colRange(0, columns), CV_8U, 255 / (high - low), -low * 255 / (high - low));
  depth.known.copyTo(shown.colRange(0, columns));
  const cv::Rect bar(columns + kGap, kGap, kBarWidth, std::max(1, rows - 2 * kGap));
  for (int y = 0; y < bar.height; ++y) {
    const int shade = 255 - 255 * y / bar.height;
    level(cv::Rect(bar.x, bar.y + y, bar.width, 1)).setTo(shade);
  }
  shown(bar).setTo(255);
  cv::Mat colours, picture(level.size(), CV_8UC3, cv::Scalar::all(0));
  cv::applyColorMap(level, colours, cv::COLORMAP_TURBO);
  colours.copyTo(picture, shown);
  for (int k = 0; k < kNumbers; ++k) {
    const float share = static_cast<float>(k) / (kNumbers - 1);
    const float inverse = high + share * (low - high);
    const int y = bar.y + static_cast<int>(share * static_cast<float>(bar.height - 1));
    cv::line(picture, {bar.br().x, y}, {bar.br().x + 4, y}, cv::Scalar::all(255));
    cv::putText(picture,
                fmt::format("{:.2f}", 1 / inverse),
                {bar.br().x + 8, y + 4},
                cv::FONT_HERSHEY_SIMPLEX,
                0.4,
                cv::Scalar::all(255),
                1,
                cv::LINE_AA);
  }
  return picture;
}

std::string SampleDepthPicture(const VirtualDepth& depth) {
  const double scale = SampleScale(depth.inverse);
  VirtualDepth small;
  cv::resize(depth.inverse, small.inverse, {}, scale, scale, cv::INTER_NEAREST);
  cv::resize(depth.known, small.known, {}, scale, scale, cv::INTER_NEAREST);
  return EncodeSample(DepthPicture(small));
}

cv::Mat RxLiveDepth(const VirtualDepth& depth) {
  constexpr double kFullScale = 65535;
  cv::Mat values;
  cv::Mat share = 1 - depth.inverse;
  share.setTo(0, (depth.known == 0) | (share > 1) | (share < 0));
  share.convertTo(values, CV_16U, kFullScale);
  return values;
}

}  // namespace plenocal::internal
