// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/remap.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>

#include "calib/base/format_error.h"

namespace plenocal {
namespace {

/// In the order of kInterpolations.
constexpr std::array kFlags{
    cv::INTER_LINEAR, cv::INTER_NEAREST, cv::INTER_CUBIC, cv::INTER_LANCZOS4};
static_assert(kFlags.size() == kInterpolations.size());

}  // namespace

Remap::Remap(const PixelMap& map, const std::string& interpolation)
    : mask_(map.size[1], map.size[0], CV_8U) {
  const auto name = std::find(kInterpolations.begin(), kInterpolations.end(), interpolation);
  if (name == kInterpolations.end()) {
    throw InputError("interpolation: expected one of {}, found '{}'",
                     fmt::join(kInterpolations, ", "),
                     interpolation);
  }
  interpolation_ = kFlags.at(static_cast<size_t>(name - kInterpolations.begin()));
  const auto plane = [&](const std::vector<float>& values) {
    return cv::Mat(values, false).reshape(1, map.size[1]);
  };
  cv::convertMaps(
      plane(map.x), plane(map.y), place_, fraction_, CV_16SC2, interpolation_ == cv::INTER_NEAREST);
  for (size_t i = 0; i < mask_.total(); ++i) {
    mask_.at<uchar>(static_cast<int>(i) / mask_.cols, static_cast<int>(i) % mask_.cols) =
        map.HasSource(i) ? 255 : 0;
  }
}

cv::Mat Remap::operator()(const cv::Mat& image) const {
  cv::Mat remapped;
  // Half a pixel beyond the outermost centres still belongs to the image.
  cv::remap(image, remapped, place_, fraction_, interpolation_, cv::BORDER_REPLICATE);
  remapped.setTo(0, mask_ == 0);
  return remapped;
}

}  // namespace plenocal
